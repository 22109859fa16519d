//! Body axes with their origin on the mast at the height of the CoM: the frame of the body's cylinder.

use crate::constants::Constants;
use ballbot_base::lanes::{Lane, Rotation, Value, Vec3};

/// The frame, in the principal frame.
pub struct MastFrame<L> {
    axes: Rotation<L>,
    /// The CoM in this frame.
    com: Vec3<L>,
}

impl<L: Lane> MastFrame<L> {
    #[inline(always)]
    pub fn new<V: Value<L>>(c: &Constants<V>, like: L) -> Self {
        let axes = c.principal_axes(like).rotation();
        let com = axes.apply(c.com(like));
        Self { axes, com: Vec3::new(com.x, com.y, like.zero()) }
    }

    /// A vector of the principal frame in this frame.
    #[inline(always)]
    pub fn vector(&self, vector: Vec3<L>) -> Vec3<L> {
        self.axes.apply(vector)
    }

    /// A point of the principal frame in this frame.
    #[inline(always)]
    pub fn point(&self, point: Vec3<L>) -> Vec3<L> {
        self.axes.apply(point) + self.com
    }

    /// Inverse of [`MastFrame::vector`].
    #[inline(always)]
    pub fn principal_vector(&self, vector: Vec3<L>) -> Vec3<L> {
        self.axes.apply_transposed(vector)
    }

    /// Inverse of [`MastFrame::point`].
    #[inline(always)]
    pub fn principal_point(&self, point: Vec3<L>) -> Vec3<L> {
        self.axes.apply_transposed(point - self.com)
    }
}
