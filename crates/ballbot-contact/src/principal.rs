//! Body frame of the solver: the principal axes at the CoM.
//!
//! In this frame the inertia of every body is diagonal, so a general body costs the solver nothing. Wheels and
//! collision cylinder, which are fixed in body axes, are constant in the principal frame too.

use ballbot_base::params::Params;
use nalgebra::{Matrix3, Rotation3, UnitQuaternion, Vector3};

/// Principal axes of a body.
pub struct PrincipalAxes {
    /// Rotation from the principal frame to the body frame; `None` if the body axes are principal axes, so that vectors
    /// keep every bit.
    pub rotation: Option<UnitQuaternion<f64>>,
    /// Principal moments of inertia, kg·m².
    pub moments: [f64; 3],
}

impl PrincipalAxes {
    /// Principal axes of the body of `params`.
    pub fn new(params: &Params) -> Self {
        if params.body_products_of_inertia == [0.0; 3] {
            return Self { rotation: None, moments: params.body_inertia };
        }
        let inertia = params.body_inertia_matrix();
        let mut axes = inertia.symmetric_eigen().eigenvectors;
        if axes.determinant() < 0.0 {
            axes.neg_mut();
        }
        let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(axes));
        // Computed from the rotation itself, so that its rounding changes the moments only to second order.
        let axes: Matrix3<f64> = rotation.to_rotation_matrix().into_inner();
        let moments = [0, 1, 2].map(|i| axes.column(i).dot(&(inertia * axes.column(i))));
        Self { rotation: Some(rotation), moments }
    }

    /// Rotation from the principal frame to the body frame.
    pub fn rotation(&self) -> UnitQuaternion<f64> {
        self.rotation.unwrap_or_else(UnitQuaternion::identity)
    }

    /// Whether the body axes are not the principal axes.
    pub fn turned(&self) -> bool {
        self.rotation.is_some()
    }

    /// A vector of the body frame in the principal frame.
    pub fn of_body(&self, vector: &Vector3<f64>) -> Vector3<f64> {
        self.rotation.map_or(*vector, |rotation| rotation.inverse_transform_vector(vector))
    }
}
