//! Named numbers of a controller or an estimator, from which another program can reproduce its results.

/// A number, a vector or a matrix.
#[derive(Clone, Debug, PartialEq)]
pub struct Constant {
    /// Its name.
    pub name: &'static str,
    /// Its sizes: none for a number, one for a vector, rows and columns for a matrix.
    pub shape: Vec<usize>,
    /// Its elements, row by row.
    pub values: Vec<f64>,
}

/// All constants of a computation, in addition to its inputs and its memory.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Constants(Vec<Constant>);

impl Constants {
    /// The constants, in the order in which they were added.
    pub fn iter(&self) -> impl Iterator<Item = &Constant> {
        self.0.iter()
    }

    /// Adds a number.
    #[must_use]
    pub fn number(mut self, name: &'static str, value: f64) -> Self {
        self.0.push(Constant { name, shape: Vec::new(), values: vec![value] });
        self
    }

    /// Adds a vector.
    #[must_use]
    pub fn vector(mut self, name: &'static str, values: &[f64]) -> Self {
        self.0.push(Constant { name, shape: vec![values.len()], values: values.to_vec() });
        self
    }

    /// Adds a matrix.
    #[must_use]
    pub fn matrix<const N: usize>(mut self, name: &'static str, rows: &[[f64; N]]) -> Self {
        self.0.push(Constant { name, shape: vec![rows.len(), N], values: rows.concat() });
        self
    }
}
