//! Linear colors, sRGB encoding, and patterns that make rotation visible.

use nalgebra::Vector3;
use std::f64::consts::TAU;

/// Red, green and blue, linear, in [0, 1].
pub type Color = Vector3<f64>;

/// Color pattern of a part, in the frame of the part.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Paint {
    /// One color.
    Plain(Color),
    /// Two colors alternating over the eight octants about the origin.
    Octants(Color, Color),
    /// Two colors alternating over sectors about z, and a mark in the sector at angle zero.
    Sectors {
        /// Number of sectors, even.
        count: u32,
        /// The first color.
        first: Color,
        /// The second color.
        second: Color,
        /// Color of the mark.
        mark: Color,
    },
}

impl Paint {
    /// Color at a point of the part.
    pub(super) fn at(&self, point: &Vector3<f64>) -> Color {
        match self {
            Self::Plain(color) => *color,
            Self::Octants(first, second) => {
                if (point.x * point.y * point.z) < 0.0 {
                    *first
                } else {
                    *second
                }
            }
            Self::Sectors { count, first, second, mark } => {
                let turn = point.y.atan2(point.x).rem_euclid(TAU) / TAU;
                let sector = turn * f64::from(*count);
                match () {
                    () if sector < 1.0 => *mark,
                    () if (sector as u32).is_multiple_of(2) => *first,
                    () => *second,
                }
            }
        }
    }
}

/// Linear color of an sRGB color written as 0xRRGGBB.
pub fn srgb(hex: u32) -> Color {
    let channel = |shift: u32| {
        let value = f64::from((hex >> shift) & 0xff) / 255.0;
        if value <= 0.04045 { value / 12.92 } else { ((value + 0.055) / 1.055).powf(2.4) }
    };
    Color::new(channel(16), channel(8), channel(0))
}

/// Table from linear light to sRGB bytes. Without the table the power function would dominate the cost of a pixel.
pub(super) struct Display {
    table: Vec<u8>,
}

impl Display {
    const STEPS: usize = 4096;

    pub fn new() -> Self {
        let encode = |i: usize| {
            let value = i as f64 / Self::STEPS as f64;
            let encoded = if value <= 0.003_130_8 { value * 12.92 } else { 1.055 * value.powf(1.0 / 2.4) - 0.055 };
            (encoded * 255.0).round() as u8
        };
        Self { table: (0..=Self::STEPS).map(encode).collect() }
    }

    pub fn bytes(&self, color: &Color) -> [u8; 3] {
        let byte = |value: f64| self.table[(value.clamp(0.0, 1.0) * Self::STEPS as f64 + 0.5) as usize];
        [byte(color.x), byte(color.y), byte(color.z)]
    }
}
