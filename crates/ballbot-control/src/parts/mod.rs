//! Parts that several controllers share, and the mathematics of their design.

pub(crate) mod attitude_loop;
pub(crate) mod balance_frame;
pub(crate) mod barrier;
pub mod common_lyapunov;
pub(crate) mod delayed;
pub(crate) mod joined;
pub(crate) mod joint_friction;
pub(crate) mod lean_observer;
pub(crate) mod lean_planes;
pub(crate) mod limits;
pub(crate) mod moving_frame;
pub(crate) mod outer;
pub(crate) mod outside_force;
pub(crate) mod position_loop;
pub mod riccati;
pub(crate) mod rule_table;
pub(crate) mod switching_gain;
pub(crate) mod tracking;
