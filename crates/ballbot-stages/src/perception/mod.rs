//! Perception of the ground: a height scan and a depth camera.
//!
//! Both observe the terrain that models roll on. A reading is a row of numbers in a robot's observation, after the rows
//! of its task.

mod channel;
pub mod clock;
mod depth;
mod options;
mod scan;
mod view;

pub use channel::Reading;
pub use options::{DepthOptions, Instrument, ScanOptions};
pub use view::View;

use ballbot_base::error::{Result, check};
use ballbot_base::params::Params;
use ballbot_base::terrain::Terrain;
use channel::{Channel, Source};
use depth::Depth;
use scan::Scan;

/// The instruments of all robots of a batch.
#[derive(Clone, Debug)]
pub struct Perception {
    scan: Option<Channel<Scan>>,
    depth: Option<Channel<Depth>>,
}

/// The readings of one robot.
#[derive(Clone, Debug, Default)]
pub struct Seen {
    /// Reading of the height scan; empty without a scan.
    pub scan: Reading,
    /// Reading of the depth camera; empty without a camera.
    pub depth: Reading,
    key: [u32; 2],
    episode: u32,
}

impl Perception {
    /// Instruments that are read every `control_dt`, s. Numbers of observations are scaled if `scaled`; otherwise they are
    /// in m. `None` without instruments.
    ///
    /// # Errors
    /// The errors of [`Instrument::validate`] and [`Instrument::clock`]; [`ballbot_base::Error::OutOfRange`] for a
    /// camera inside the ball.
    pub fn new(
        scan: Option<&ScanOptions>,
        depth: Option<&DepthOptions>,
        params: &Params,
        control_dt: f64,
        scaled: bool,
    ) -> Result<Option<Self>> {
        let scan = scan.map(|options| {
            let gain = if scaled { 1.0 / scan::TYPICAL } else { 1.0 };
            Channel::new(options, Scan::new, gain, control_dt)
        });
        let depth = depth.map(|options| {
            let distance = options.position.iter().map(|part| part * part).sum::<f64>().sqrt();
            let words = format_args!("above ball_radius = {} m: the camera is outside of the ball", params.ball_radius);
            check("distance of depth.position from the ball's center", distance, words, |d| d > params.ball_radius)?;
            let gain = if scaled { (1.0 / options.far) as f32 } else { 1.0 };
            Channel::new(options, Depth::new, gain, control_dt)
        });
        let (scan, depth) = (scan.transpose()?, depth.transpose()?);
        Ok((scan.is_some() || depth.is_some()).then_some(Self { scan, depth }))
    }

    /// Count of numbers that it adds to an observation.
    pub fn width(&self) -> usize {
        self.scan_len() + self.depth_len()
    }

    /// Count of numbers of the height scan; they come first.
    pub fn scan_len(&self) -> usize {
        self.scan.as_ref().map_or(0, Channel::len)
    }

    /// Count of numbers of the depth camera.
    pub fn depth_len(&self) -> usize {
        self.depth.as_ref().map_or(0, Channel::len)
    }

    /// Rows and columns of a reading of the height scan: heading y and x.
    pub fn scan_shape(&self) -> Option<[usize; 2]> {
        self.scan.as_ref().map(Channel::shape)
    }

    /// Rows and columns of a picture of the depth camera.
    pub fn depth_shape(&self) -> Option<[usize; 2]> {
        self.depth.as_ref().map(Channel::shape)
    }

    /// Approximate memory for each robot, bytes.
    pub fn bytes(&self) -> usize {
        self.scan.as_ref().map_or(0, Channel::bytes) + self.depth.as_ref().map_or(0, Channel::bytes)
    }

    /// The readings of a robot before its first episode: zeros.
    pub fn nothing(&self) -> Seen {
        Seen {
            scan: self.scan.as_ref().map_or_else(Reading::default, Channel::nothing),
            depth: self.depth.as_ref().map_or_else(Reading::default, Channel::nothing),
            ..Seen::default()
        }
    }

    /// Begins an episode under the key of a robot's random numbers, and reads for the first time.
    pub fn begin(&self, seen: &mut Seen, key: [u32; 2], episode: u32, view: &View, terrain: Option<&Terrain>) {
        let source = self.restore(seen, key, episode);
        if let Some(scan) = &self.scan {
            scan.begin(&mut seen.scan, view, terrain, &source);
        }
        if let Some(depth) = &self.depth {
            depth.begin(&mut seen.depth, view, terrain, &source);
        }
    }

    /// Continues an episode whose readings were restored.
    pub fn restore(&self, seen: &mut Seen, key: [u32; 2], episode: u32) -> Source {
        (seen.key, seen.episode) = (key, episode);
        let source = Source { key, episode };
        if let Some(scan) = &self.scan {
            scan.fix(&mut seen.scan, &source);
        }
        if let Some(depth) = &self.depth {
            depth.fix(&mut seen.depth, &source);
        }
        source
    }

    /// Takes the samples and readings that are due at a step of the episode.
    pub fn step(&self, seen: &mut Seen, step: u64, view: &dyn Fn() -> View, terrain: Option<&Terrain>) {
        let source = Source { key: seen.key, episode: seen.episode };
        if let Some(scan) = &self.scan {
            scan.step(&mut seen.scan, step, view, terrain, &source);
        }
        if let Some(depth) = &self.depth {
            depth.step(&mut seen.depth, step, view, terrain, &source);
        }
    }

    /// Writes the readings in the form of an observation.
    pub fn write(&self, seen: &Seen, out: &mut [f32]) {
        let (heights, depths) = out.split_at_mut(self.scan_len());
        if let Some(scan) = &self.scan {
            scan.write(&seen.scan, heights);
        }
        if let Some(depth) = &self.depth {
            depth.write(&seen.depth, depths);
        }
    }
}
