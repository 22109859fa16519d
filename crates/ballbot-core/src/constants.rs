//! The numbers of a law or of an estimator by name, from which another program can compute the same.

/// A number, a vector or a matrix.
#[derive(Clone, Debug, PartialEq)]
pub struct Constant {
    /// Its name.
    pub name: &'static str,
    /// Its sizes: none of a number, one of a vector, rows and columns of a matrix.
    pub shape: Vec<usize>,
    /// Its elements, row by row.
    pub values: Vec<f64>,
}

/// All that something computes with, besides what it is given and its memory.
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
