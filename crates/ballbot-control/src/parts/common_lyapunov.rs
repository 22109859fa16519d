//! A common Lyapunov function of several linear systems, by the ellipsoid method.

use nalgebra::{Matrix4, SMatrix, SVector, SymmetricEigen, Vector4};

/// Number of elements of a symmetric matrix of four rows.
const ELEMENTS: usize = 10;

/// Radius of the ball around the initial guess, in units in which the guess is the identity.
const RADIUS: f64 = 2.0;

/// Largest number of cuts: each removes at least 4 % of the volume, so 3000 cuts leave 1e-57 of it.
const MAX_CUTS: usize = 3000;

/// Largest number of steps of the eigenvalue search; each eigenvalue needs about two.
const MAX_EIGENVALUE_STEPS: usize = 1000;

/// P > 0 with GᵀPG − P < 0 for all G in `steps`, which makes xᵀPx a Lyapunov function of all their blends. Returns P
/// and the largest ratio xᵀGᵀPGx / xᵀPx; `None` if no such P is found. `guess` is tried first; it must be positive
/// definite.
///
/// The conditions are linear in P. The ellipsoid method (Boyd, El Ghaoui, Feron & Balakrishnan, Linear Matrix Inequalities
/// in System and Control Theory, 1994, ch. 2) cuts off the half of the matrices for which an x of the worst G does not
/// decay.
pub fn common_lyapunov(steps: &[Matrix4<f64>], guess: &Matrix4<f64>) -> Option<(Matrix4<f64>, f64)> {
    let root = guess.cholesky()?.l();
    let inverse = root.try_inverse()?;
    // In coordinates in which the guess is the identity.
    let steps: Vec<_> = steps.iter().map(|g| root.transpose() * g * inverse.transpose()).collect();
    let mut center = elements(&Matrix4::identity());
    let mut shape = SMatrix::<f64, ELEMENTS, ELEMENTS>::identity() * (RADIUS * RADIUS);
    for _ in 0..MAX_CUTS {
        let p = symmetric(&center);
        let mut worst = (f64::NEG_INFINITY, Vector4::zeros(), Vector4::zeros());
        for g in &steps {
            let change = g.transpose() * p * g - p;
            let eigen = SymmetricEigen::try_new(change, f64::EPSILON, MAX_EIGENVALUE_STEPS)?;
            let place = eigen.eigenvalues.imax();
            if eigen.eigenvalues[place] > worst.0 {
                let x = eigen.eigenvectors.column(place).into_owned();
                worst = (eigen.eigenvalues[place], x, g * x);
            }
        }
        let (change, x, next) = worst;
        if change < 0.0 {
            let ratio = largest_ratio(&steps, &p)?;
            return (ratio < 1.0).then(|| (root * p * root.transpose(), ratio));
        }
        // The change of xᵀPx, linear in the elements of P; off-diagonal elements count twice.
        let per_element = next * next.transpose() - x * x.transpose();
        let cut = elements(&(per_element * 2.0 - Matrix4::from_diagonal(&per_element.diagonal())));
        let width = cut.dot(&(shape * cut)).sqrt();
        let depth = change / width;
        if depth.is_nan() || depth >= 1.0 {
            return None;
        }
        let n = ELEMENTS as f64;
        let along = shape * cut / width;
        center -= along * ((1.0 + n * depth) / (n + 1.0));
        let narrower = 2.0 * (1.0 + n * depth) / ((n + 1.0) * (1.0 + depth));
        let wider = n * n * (1.0 - depth * depth) / (n * n - 1.0);
        shape = (shape - along * along.transpose() * narrower) * wider;
    }
    None
}

/// The largest ratio xᵀGᵀPGx / xᵀPx; `None` if P is not positive definite.
fn largest_ratio(steps: &[Matrix4<f64>], p: &Matrix4<f64>) -> Option<f64> {
    let root = p.cholesky()?.l();
    let inverse = root.try_inverse()?;
    let mut largest = 0.0_f64;
    for g in steps {
        let step = root.transpose() * g * inverse.transpose();
        let eigen = SymmetricEigen::try_new(step.transpose() * step, f64::EPSILON, MAX_EIGENVALUE_STEPS)?;
        largest = largest.max(eigen.eigenvalues.max());
    }
    Some(largest)
}

/// Upper triangle of a symmetric matrix.
fn elements(matrix: &Matrix4<f64>) -> SVector<f64, ELEMENTS> {
    let mut places = (0..4).flat_map(|i| (i..4).map(move |j| (i, j)));
    SVector::from_fn(|_, _| places.next().map_or(0.0, |place| matrix[place]))
}

fn symmetric(elements: &SVector<f64, ELEMENTS>) -> Matrix4<f64> {
    let mut matrix = Matrix4::zeros();
    for (k, (i, j)) in (0..4).flat_map(|i| (i..4).map(move |j| (i, j))).enumerate() {
        (matrix[(i, j)], matrix[(j, i)]) = (elements[k], elements[k]);
    }
    matrix
}
