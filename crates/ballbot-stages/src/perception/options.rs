//! Options of the height scan and of the depth camera.

use super::clock::Clock;
use ballbot_base::error::{Result, check};
use ballbot_base::fields;
use ballbot_base::fields::{Fields, Limit};
use std::f64::consts::{FRAC_PI_2, PI};

/// Maximum count of numbers in a reading.
const MOST_NUMBERS: f64 = 65536.0;

/// Whether a number of points or pixels is whole.
fn is_whole(number: f64) -> bool {
    number.fract() == 0.0
}

fields! {
    /// Heights of the ground at the points of a grid about the ball that turns with the robot's heading. SI units and
    /// radians.
    pub struct ScanOptions {
        /// Points along heading x and y, whole numbers.
        pub points: [f64; 2] = [11.0, 11.0], "", Limit::from(1.0).to(256.0);
        /// Distance of neighboring points.
        pub spacing: f64 = 0.1, "m", Limit::from(1e-3).to(10.0);
        /// Middle of the grid from the ball's center, heading x and y.
        pub offset: [f64; 2] = [0.0; 2], "m", Limit::from(-10.0).to(10.0);
        /// Scans in a second, held in between; 0: one at each control step, which is also the maximum.
        pub rate: f64 = 25.0, "Hz", Limit::from(0.0).to(1e6);
        /// Age of a scan when it is read, a whole number of control steps; at most 100 of them.
        pub latency: f64 = 0.0, "s", Limit::from(0.0).to(100.0);
        /// Standard deviation of the noise of each height.
        pub noise: f64 = 0.0, "m", Limit::from(0.0).to(10.0);
        /// Fraction of the heights that are missing in a scan; they keep what was read before.
        pub dropout: f64 = 0.0, "", Limit::from(0.0).to(1.0);
        /// Standard deviations of an error of the whole grid along each horizontal axis, and of all heights, sampled for each
        /// episode.
        pub drift: [f64; 2] = [0.0; 2], "m", Limit::from(0.0).to(10.0);
    }
}

fields! {
    /// A camera on the body that reads distances along its optical axis. SI units and radians.
    pub struct DepthOptions {
        /// Columns and rows of pixels, whole numbers.
        pub size: [f64; 2] = [32.0, 24.0], "", Limit::from(1.0).to(256.0);
        /// Angle between the upper and the lower edge of the picture; pixels are square.
        pub field_of_view: f64 = 1.0, "rad", Limit::above(0.0).below(PI);
        /// The camera in the body frame, whose origin is the ball's center; outside of the ball.
        pub position: [f64; 3] = [0.2, 0.0, 0.3], "m", Limit::from(-10.0).to(10.0);
        /// Angle of the optical axis below the horizontal plane of the body.
        pub pitch: f64 = 0.6, "rad", Limit::from(-FRAC_PI_2).to(FRAC_PI_2);
        /// Angle of the optical axis from body x towards body y.
        pub yaw: f64 = 0.0, "rad", Limit::from(-PI).to(PI);
        /// Smaller depths read as this value.
        pub near: f64 = 0.05, "m", Limit::from(1e-3).to(100.0);
        /// Larger depths, and pixels without a surface, read as this value.
        pub far: f64 = 3.0, "m", Limit::from(1e-2).to(100.0);
        /// Pictures in a second, held in between; 0: one at each control step, which is also the maximum.
        pub rate: f64 = 25.0, "Hz", Limit::from(0.0).to(1e6);
        /// Age of a picture when it is read, a whole number of control steps; at most 100 of them.
        pub latency: f64 = 0.0, "s", Limit::from(0.0).to(100.0);
        /// Standard deviation of the noise of a pixel: the first number, m, and the second, 1/m, times its squared depth.
        pub noise: [f64; 2] = [0.0; 2], "", Limit::from(0.0).to(10.0);
        /// Fraction of the pixels that are holes, which read as `far`.
        pub dropout: f64 = 0.0, "", Limit::from(0.0).to(1.0);
        /// Fraction of the pictures that are dropped; the previous picture stays.
        pub freeze: f64 = 0.0, "", Limit::from(0.0).to(1.0);
        /// Standard deviation of the camera's mounting error about each body axis, sampled for each episode.
        pub misalignment: f64 = 0.0, "rad", Limit::from(0.0).to(0.5);
    }
}

/// Options of an instrument.
pub trait Instrument: Fields {
    /// Name of the environment option that holds them.
    const NAME: &'static str;

    /// Name of its options in messages.
    const KIND: &'static str;

    /// Lengths of a reading along its fast and its slow index.
    fn counts(&self) -> [f64; 2];

    /// Rate, Hz, and latency, s.
    fn timing(&self) -> [f64; 2];

    /// Checks options against each other.
    ///
    /// # Errors
    /// [`ballbot_base::Error::OutOfRange`] naming the value and the limit.
    fn check_own(&self) -> Result<()>;

    /// Options from named numbers, the others at their defaults.
    ///
    /// # Errors
    /// [`ballbot_base::Error::UnknownName`] and [`ballbot_base::Error::Length`]; [`ballbot_base::Error::OutOfRange`] for numbers beyond their
    /// limits.
    fn from_fields<'n, 'v>(fields: impl IntoIterator<Item = (&'n str, &'v [f64])>) -> Result<Self> {
        let options = Self::with_fields(Self::KIND, Self::NAME, fields)?;
        options.validate()?;
        Ok(options)
    }

    /// Checks all numbers.
    ///
    /// # Errors
    /// [`ballbot_base::Error::OutOfRange`] naming the value and the limit.
    fn validate(&self) -> Result<()> {
        let check_all = || {
            self.check_limits()?;
            let [fast, slow] = self.counts();
            for count in [fast, slow] {
                check("number of points or pixels", count, "whole", is_whole)?;
            }
            check("number of points or pixels", fast * slow, format_args!("at most {MOST_NUMBERS}"), |n| {
                n <= MOST_NUMBERS
            })?;
            self.check_own()
        };
        check_all().map_err(|error| error.of_option(Self::NAME))
    }

    /// Sampling times on robots with a control step of `control_dt`, s.
    ///
    /// # Errors
    /// [`ballbot_base::Error::OutOfRange`] for a latency that is not a whole number of at most 100 control steps.
    fn clock(&self, control_dt: f64) -> Result<Clock> {
        let [rate, latency] = self.timing();
        Clock::new(rate, latency, control_dt).map_err(|error| error.of_option(Self::NAME))
    }

    /// Rows and columns of a reading.
    fn shape(&self) -> [usize; 2] {
        let [fast, slow] = self.counts();
        [slow as usize, fast as usize]
    }

    /// All numbers, in the order of the fields.
    fn numbers(&self) -> impl Iterator<Item = f64> + '_ {
        (0..Self::FIELDS.len()).flat_map(|index| self.values(index)).copied()
    }
}

impl Instrument for ScanOptions {
    const NAME: &'static str = "scan";
    const KIND: &'static str = "option of scan";

    fn counts(&self) -> [f64; 2] {
        self.points
    }

    fn timing(&self) -> [f64; 2] {
        [self.rate, self.latency]
    }

    fn check_own(&self) -> Result<()> {
        Ok(())
    }
}

impl Instrument for DepthOptions {
    const NAME: &'static str = "depth";
    const KIND: &'static str = "option of depth";

    fn counts(&self) -> [f64; 2] {
        self.size
    }

    fn timing(&self) -> [f64; 2] {
        [self.rate, self.latency]
    }

    fn check_own(&self) -> Result<()> {
        check("near", self.near, format_args!("below far = {} m", self.far), |near| near < self.far)?;
        Ok(())
    }
}
