//! What a robot carries from one step to the next.

use crate::lanes::{EIGHT, Eight};
use serde::{Deserialize, Serialize};

/// Torques of the three motors, N·m.
pub type Torques<T> = [T; 3];

/// State and contact impulses of one robot (`T` = `f64`) or of eight ([`Eight`]). Inertial frame and SI units unless said.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Memory<T> {
    pub ball_position: [T; 3],
    pub ball_quaternion: [T; 4],
    pub ball_velocity: [T; 3],
    pub ball_rate: [T; 3],
    /// Of the CoM.
    pub body_position: [T; 3],
    pub body_quaternion: [T; 4],
    /// Of the CoM.
    pub body_velocity: [T; 3],
    /// Body frame.
    pub body_rate: [T; 3],
    pub wheel_angles: [T; 3],
    /// Absolute spins about the axles: encoder rate less u_i · Ω.
    pub wheel_spins: [T; 3],
    /// Impulses of the last step: floor (normal, x, y), wheels' normals, drive frictions (on the bot), joint frictions.
    pub floor_impulse: [T; 3],
    pub normal_impulses: [T; 3],
    pub drive_impulses: [T; 3],
    pub joint_impulses: [T; 3],
    /// Impulse on the body and angular impulse about its CoM that act in the next step.
    pub push: [T; 6],
    pub joint_viscous_friction: T,
    pub joint_coulomb_friction: T,
    /// 1 while the bot touches the floor, else 0.
    pub bot_on_floor: T,
    /// 1 once a step met numbers that are not finite, else 0.
    pub diverged: T,
}

impl<T> Memory<T> {
    /// All numbers, in order.
    fn cells(&self) -> impl Iterator<Item = &T> {
        let lone = [&self.joint_viscous_friction, &self.joint_coulomb_friction, &self.bot_on_floor, &self.diverged];
        self.ball_position
            .iter()
            .chain(&self.ball_quaternion)
            .chain(&self.ball_velocity)
            .chain(&self.ball_rate)
            .chain(&self.body_position)
            .chain(&self.body_quaternion)
            .chain(&self.body_velocity)
            .chain(&self.body_rate)
            .chain(&self.wheel_angles)
            .chain(&self.wheel_spins)
            .chain(&self.floor_impulse)
            .chain(&self.normal_impulses)
            .chain(&self.drive_impulses)
            .chain(&self.joint_impulses)
            .chain(&self.push)
            .chain(lone)
    }

    fn cells_mut(&mut self) -> impl Iterator<Item = &mut T> {
        let lone = [
            &mut self.joint_viscous_friction,
            &mut self.joint_coulomb_friction,
            &mut self.bot_on_floor,
            &mut self.diverged,
        ];
        self.ball_position
            .iter_mut()
            .chain(&mut self.ball_quaternion)
            .chain(&mut self.ball_velocity)
            .chain(&mut self.ball_rate)
            .chain(&mut self.body_position)
            .chain(&mut self.body_quaternion)
            .chain(&mut self.body_velocity)
            .chain(&mut self.body_rate)
            .chain(&mut self.wheel_angles)
            .chain(&mut self.wheel_spins)
            .chain(&mut self.floor_impulse)
            .chain(&mut self.normal_impulses)
            .chain(&mut self.drive_impulses)
            .chain(&mut self.joint_impulses)
            .chain(&mut self.push)
            .chain(lone)
    }
}

impl Memory<Eight> {
    /// That of one of the eight robots.
    pub fn lane(&self, index: usize) -> Memory<f64> {
        assert!(index < EIGHT);
        let mut out = Memory::default();
        for (cell, eight) in out.cells_mut().zip(self.cells()) {
            *cell = eight.0[index];
        }
        out
    }

    /// Replaces that of one of the eight robots.
    pub fn set_lane(&mut self, index: usize, memory: &Memory<f64>) {
        assert!(index < EIGHT);
        for (eight, cell) in self.cells_mut().zip(memory.cells()) {
            eight.0[index] = *cell;
        }
    }
}
