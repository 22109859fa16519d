//! Between a robot's memory and the processor's registers.

use super::memory::Memory;
use super::quantities::{PerRow, Pose, Velocities};
use crate::lanes::{Lane, Quat, Vec3};

/// Squared speeds and rates from which arithmetic would overflow soon.
const BEYOND_MEANING: f64 = 1e30;

impl<T> Memory<T> {
    #[inline(always)]
    pub fn pose<L: Lane<Cell = T>>(&self, token: L::Token) -> Pose<L> {
        Pose {
            ball: Vec3::load(token, &self.ball_position),
            ball_quaternion: Quat::load(token, &self.ball_quaternion),
            body: Vec3::load(token, &self.body_position),
            body_quaternion: Quat::load(token, &self.body_quaternion),
            wheel_angles: load3(token, &self.wheel_angles),
        }
    }

    #[inline(always)]
    pub fn velocities<L: Lane<Cell = T>>(&self, token: L::Token) -> Velocities<L> {
        Velocities {
            ball: Vec3::load(token, &self.ball_velocity),
            ball_rate: Vec3::load(token, &self.ball_rate),
            body: Vec3::load(token, &self.body_velocity),
            body_rate: Vec3::load(token, &self.body_rate),
            spins: load3(token, &self.wheel_spins),
        }
    }

    #[inline(always)]
    pub fn impulses<L: Lane<Cell = T>>(&self, token: L::Token) -> PerRow<L> {
        PerRow {
            floor: load3(token, &self.floor_impulse),
            normals: load3(token, &self.normal_impulses),
            drives: load3(token, &self.drive_impulses),
            joints: load3(token, &self.joint_impulses),
        }
    }

    /// Takes over what a step led to; a robot whose velocities are beyond meaning stays where it was and is marked.
    #[inline(always)]
    pub fn take<L: Lane<Cell = T>>(
        &mut self,
        token: L::Token,
        pose: &Pose<L>,
        velocities: &Velocities<L>,
        impulses: &PerRow<L>,
        on_floor: L,
    ) {
        let size = velocities.norm_squared();
        let sound = size.lt(size.splat(BEYOND_MEANING));
        if !L::any(!sound) {
            self.write(pose, velocities, impulses, on_floor);
            return;
        }
        let marked = L::load(token, &self.diverged);
        L::select(sound, marked, size.splat(1.0)).store(&mut self.diverged);
        let pose = Pose::select(sound, pose, &self.pose(token));
        let velocities = Velocities::select(sound, velocities, &self.velocities(token));
        let impulses = PerRow::select(sound, impulses, &self.impulses(token));
        let on_floor = L::select(sound, on_floor, L::load(token, &self.bot_on_floor));
        self.write(&pose, &velocities, &impulses, on_floor);
    }

    #[inline(always)]
    fn write<L: Lane<Cell = T>>(
        &mut self,
        pose: &Pose<L>,
        velocities: &Velocities<L>,
        impulses: &PerRow<L>,
        on_floor: L,
    ) {
        pose.ball.store(&mut self.ball_position);
        pose.ball_quaternion.store(&mut self.ball_quaternion);
        pose.body.store(&mut self.body_position);
        pose.body_quaternion.store(&mut self.body_quaternion);
        store3(pose.wheel_angles, &mut self.wheel_angles);
        velocities.ball.store(&mut self.ball_velocity);
        velocities.ball_rate.store(&mut self.ball_rate);
        velocities.body.store(&mut self.body_velocity);
        velocities.body_rate.store(&mut self.body_rate);
        store3(velocities.spins, &mut self.wheel_spins);
        store3(impulses.floor, &mut self.floor_impulse);
        store3(impulses.normals, &mut self.normal_impulses);
        store3(impulses.drives, &mut self.drive_impulses);
        store3(impulses.joints, &mut self.joint_impulses);
        on_floor.store(&mut self.bot_on_floor);
    }
}

#[inline(always)]
fn load3<L: Lane>(token: L::Token, [a, b, c]: &[L::Cell; 3]) -> [L; 3] {
    [L::load(token, a), L::load(token, b), L::load(token, c)]
}

#[inline(always)]
fn store3<L: Lane>([a, b, c]: [L; 3], cells: &mut [L::Cell; 3]) {
    a.store(&mut cells[0]);
    b.store(&mut cells[1]);
    c.store(&mut cells[2]);
}
