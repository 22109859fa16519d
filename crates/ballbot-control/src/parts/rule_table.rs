//! Fuzzy rules with two inputs.

use ballbot_base::error::{Result, check};
use ballbot_base::lanes::Lane;

/// Number of fuzzy sets of an input.
pub const SETS: usize = 7;

/// Index of the set that is centered at zero.
const MIDDLE: usize = SETS / 2;

/// Rules "if the error is in set i and its rate in set j, then the output is c_ij", with inputs and outputs from −1 to 1.
///
/// The sets are triangles centered at −1, −2/3, ..., 1 that overlap, with memberships of an input that add up to 1;
/// beyond ±1 an input belongs to the last set. With the product as the conjunction, sums as the aggregation and
/// singletons as the consequents, the output Σ μ_i μ_j c_ij is the bilinear interpolation of the table.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RuleTable {
    consequents: [[f64; SETS]; SETS],
}

impl Default for RuleTable {
    /// c_ij = (i + j) / 3, i and j from −3 to 3, cut at ±1: the usual diagonal table.
    fn default() -> Self {
        let sum = |i: usize, j: usize| (i + j) as f64 - (SETS - 1) as f64;
        let consequents = std::array::from_fn(|i| std::array::from_fn(|j| (sum(i, j) / 3.0).clamp(-1.0, 1.0)));
        Self { consequents }
    }
}

impl RuleTable {
    /// A custom table, c_ij with the sets of the error as rows.
    ///
    /// # Errors
    /// [`ballbot_base::Error::OutOfRange`] for a number outside −1 to 1.
    pub fn new(consequents: [[f64; SETS]; SETS]) -> Result<Self> {
        for (i, row) in consequents.iter().enumerate() {
            for (j, value) in row.iter().enumerate() {
                check(format_args!("consequents[{i}][{j}]"), *value, "from -1 to 1", |c| c.abs() <= 1.0)?;
            }
        }
        Ok(Self { consequents })
    }

    /// Derivatives of the output with respect to the error and its rate where both are zero, mean of both sides.
    pub fn slopes(&self) -> [f64; 2] {
        let c = &self.consequents;
        let per_set = 0.5 * MIDDLE as f64;
        [
            (c[MIDDLE + 1][MIDDLE] - c[MIDDLE - 1][MIDDLE]) * per_set,
            (c[MIDDLE][MIDDLE + 1] - c[MIDDLE][MIDDLE - 1]) * per_set,
        ]
    }

    /// The output for an error and its rate.
    #[inline(always)]
    pub fn output<L: Lane>(&self, error: L, rate: L) -> L {
        let (of_error, of_rate) = (memberships(error), memberships(rate));
        let mut output = error.zero();
        for (row, of_error) in self.consequents.iter().zip(of_error) {
            let mut sum = output.zero();
            for (consequent, of_rate) in row.iter().zip(of_rate) {
                sum = of_rate.mul_add_all(*consequent, sum);
            }
            output = of_error.mul_add(sum, output);
        }
        output
    }
}

/// Memberships of an input in the sets; NaN for NaN.
#[inline(always)]
pub fn memberships<L: Lane>(input: L) -> [L; SETS] {
    let one = input.splat(1.0);
    let within = L::select(one.lt(input.abs()), input.max(-one).min(one), input);
    let scaled = within * MIDDLE as f64;
    let mut memberships = [scaled; SETS];
    for (i, membership) in memberships.iter_mut().enumerate() {
        let inside = one - (scaled - (i as f64 - MIDDLE as f64)).abs();
        *membership = L::select(inside.lt(one.zero()), one.zero(), inside);
    }
    memberships
}
