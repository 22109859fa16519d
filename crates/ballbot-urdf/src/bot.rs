//! The bot of a URDF: a body on three equal wheels.

use super::checked::{Checked, TOLERANCE};
use super::mass::RigidMass;
use super::placement::Placement;
use super::tree::Tree;
use super::wheel::Wheel;
use nalgebra::Matrix3;
use std::slice;

/// Parameters of the bot, as [`ballbot_base::Params`] defines them.
pub(super) struct Bot {
    /// Height of the ball center above the origin of the root frame, m.
    pub ball_height: f64,
    mass: f64,
    inertia: [f64; 3],
    products_of_inertia: [f64; 3],
    com_height: f64,
    com_offset: [f64; 2],
    zenith: f64,
    zenith_offsets: [f64; 3],
    azimuths: [f64; 3],
    wheel: Wheel,
}

impl Bot {
    /// Reads the URDF `text` of a bot on a ball of radius `ball_radius`.
    pub fn read(text: &str, ball_radius: f64) -> Checked<Self> {
        let tree = Tree::read(text)?;
        let wheels = wheels(&tree)?;
        check_equal(&wheels, &GEOMETRY)?;
        let placement = Placement::solve(&wheels, ball_radius)?;
        // Inertias about the axles are compared only after the axles have been checked.
        check_equal(&wheels, &DYNAMICS)?;
        wheels.iter().try_for_each(Wheel::check_balance)?;
        let body = tree.mass(None, "the body")?;
        let parts = [&body, &wheels[0].body, &wheels[1].body, &wheels[2].body].map(Clone::clone);
        let total = RigidMass::combined(&parts).ok_or("the bot has no mass")?;
        let com_height = total.center.z - placement.ball_height;
        let com_offset = unless_rounding([total.center.x, total.center.y], com_height);
        // `body_inertia` excludes the inertia of the wheels about their axles.
        let spin: Matrix3<f64> = wheels.iter().map(|w| w.axle * w.axle.transpose() * w.axial_inertia).sum();
        let inertia = total.inertia - spin;
        let products = [inertia[(0, 1)], inertia[(0, 2)], inertia[(1, 2)]];
        let Placement { ball_height, zenith, zenith_offsets, azimuths } = placement;
        let [wheel, ..] = wheels;
        Ok(Self {
            ball_height,
            mass: total.mass,
            inertia: inertia.diagonal().into(),
            products_of_inertia: unless_rounding(products, inertia.diagonal().amax()),
            com_height,
            com_offset,
            zenith,
            zenith_offsets,
            azimuths,
            wheel,
        })
    }

    /// Names and values of the parameters of the bot.
    pub fn fields(&self) -> impl Iterator<Item = (&'static str, &[f64])> {
        let scalars = [
            ("body_mass", &self.mass),
            ("body_com_height", &self.com_height),
            ("wheel_mass", &self.wheel.body.mass),
            ("wheel_inertia", &self.wheel.axial_inertia),
            ("wheel_radius", &self.wheel.radius),
            ("wheel_zenith", &self.zenith),
            ("wheel_viscous_friction", &self.wheel.damping),
            ("wheel_coulomb_friction", &self.wheel.friction),
        ];
        // Without an effort limit the parameter keeps its default.
        let effort = (self.wheel.effort > 0.0).then_some(("max_wheel_torque", &self.wheel.effort));
        scalars.into_iter().chain(effort).map(|(name, value)| (name, slice::from_ref(value))).chain([
            ("body_inertia", &self.inertia[..]),
            ("body_products_of_inertia", &self.products_of_inertia[..]),
            ("body_com_offset", &self.com_offset[..]),
            ("wheel_azimuths", &self.azimuths[..]),
            ("wheel_zenith_offsets", &self.zenith_offsets[..]),
        ])
    }
}

/// The three wheels, in document order of their joints.
fn wheels(tree: &Tree) -> Checked<[Wheel; 3]> {
    let joints = tree.turning_joints();
    let Ok(joints) = <[usize; 3]>::try_from(joints.as_slice()) else {
        let names: Vec<String> = tree
            .joints
            .iter()
            .map(|j| format!("'{}' {}", j.name, format!("{:?}", j.joint_type).to_lowercase()))
            .collect();
        return Err(format!(
            "{} joints are continuous or revolute, expected exactly 3, one a wheel (joints: {})",
            joints.len(),
            if names.is_empty() { "none".into() } else { names.join(", ") }
        ));
    };
    let [a, b, c] = joints;
    Ok([Wheel::read(tree, 0, a)?, Wheel::read(tree, 1, b)?, Wheel::read(tree, 2, c)?])
}

/// Name and value of a quantity that is equal for all wheels.
type Quantity = (&'static str, fn(&Wheel) -> f64);

const GEOMETRY: [Quantity; 1] = [("radius", |w| w.radius)];

const DYNAMICS: [Quantity; 5] = [
    ("mass", |w| w.body.mass),
    ("inertia about the axle", |w| w.axial_inertia),
    ("joint damping", |w| w.damping),
    ("joint friction", |w| w.friction),
    ("joint effort limit", |w| w.effort),
];

/// Rejects wheels that differ in one of the `quantities`.
fn check_equal(wheels: &[Wheel; 3], quantities: &[Quantity]) -> Checked<()> {
    for (name, value) in quantities {
        let first = value(&wheels[0]);
        for wheel in &wheels[1..] {
            let other = value(wheel);
            if !(..=TOLERANCE * first).contains(&(other - first).abs()) {
                return Err(format!(
                    "the wheels differ: {name} = {other} of {}, {first} of {}: at most {TOLERANCE:e} of it apart",
                    wheel.what, wheels[0].what
                ));
            }
        }
    }
    Ok(())
}

/// `values`, or zeros if all are within rounding of zero relative to `scale`.
fn unless_rounding<const N: usize>(values: [f64; N], scale: f64) -> [f64; N] {
    let rounding = values.iter().all(|value| value.abs() <= TOLERANCE * scale.abs());
    if rounding { [0.0; N] } else { values }
}
