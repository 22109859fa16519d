//! An instrument of another crate.

use crate::run::Run;
use ballbot_core::Result;
use ballbot_core::batch::{Autoreset, task_kind};
use ballbot_core::fields::Limit;
use ballbot_core::options::OptionTable;
use ballbot_core::perception::{
    Instrument, Range, Reads, Sample, instrument_kind, instrument_kinds, register_instrument,
};

ballbot_core::fields! {
    /// Heights of corners of a square above level ground.
    pub struct Corners {
        /// Corners.
        pub corners: f64 = 4.0, "", Limit::from(1.0).to(8.0);
        /// Half diagonal.
        pub reach: f64 = 0.2, "m", Limit::from(0.0).to(1.0);
        /// Readings in a second.
        pub rate: f64 = 0.0, "Hz", Limit::from(0.0).to(1e3);
    }
}

impl OptionTable for Corners {
    const NAME: &'static str = "corners";
}

impl Instrument for Corners {
    const TITLE: &'static str = "Corners";
    const ABOUT: &'static str = "Heights of points of the body.";

    fn lengths(&self) -> (&'static str, &[f64]) {
        ("corners", std::slice::from_ref(&self.corners))
    }

    fn timing(&self) -> [f64; 2] {
        [self.rate, 0.0]
    }

    fn range(&self) -> Range {
        Range { low: -2.0, high: 2.0, typical: 0.5 }
    }

    fn reader(&self) -> Box<dyn Reads> {
        Box::new(self.clone())
    }
}

impl Reads for Corners {
    fn read(&self, sample: &Sample, out: &mut [f32]) {
        for (k, height) in out.iter_mut().enumerate() {
            let angle = std::f64::consts::TAU * k as f64 / self.corners;
            let point = [self.reach * angle.cos(), self.reach * angle.sin(), 0.0];
            *height = (sample.view.ball[2] + (sample.view.rotation() * nalgebra::Vector3::from(point)).z) as f32;
        }
    }
}

#[test]
fn instruments_of_another_crate_are_found_by_name() -> Result<()> {
    register_instrument::<Corners>()?;
    let again = register_instrument::<Corners>().unwrap_err().to_string();
    assert!(again.contains("there is an instrument 'corners' already"), "{again}");
    assert_eq!(instrument_kinds().last().unwrap().name, "corners");
    let unknown = instrument_kind("corner").unwrap_err().to_string();
    assert!(unknown.contains("did you mean 'corners'?"), "{unknown}");
    let mut config = task_kind("balance")?.config();
    config.instruments_mut().set((instrument_kind("scan")?.make)(&[("points", &[3.0, 2.0])])?);
    config.instruments_mut().set((instrument_kind("corners")?.make)(&[("reach", &[0.1])])?);
    let mut run = Run::new(config.batch(3, Autoreset::SameStep, Some(1), 5)?);
    let width = run.batch.observation_len();
    for _ in 0..5 {
        run.step(&[0.2; 9])?;
        for i in 0..3 {
            let state = run.batch.state(i)?;
            let corner = state.ball_position.z + (state.body_quaternion * nalgebra::Vector3::x() * 0.1).z;
            let read = run.batch.perceived(i, "corners")?;
            assert!((f64::from(read[0]) - corner).abs() < 1e-6);
            let scaled: Vec<_> = read.iter().map(|height| height * 2.0).collect();
            assert_eq!(run.observations[(i + 1) * width - 4..(i + 1) * width], scaled, "after the scan");
        }
    }
    let saved = run.batch.save(1)?;
    let reading = run.batch.perceived(1, "corners")?.to_vec();
    run.batch.load(0, &saved)?;
    assert_eq!(run.batch.perceived(0, "corners")?, reading);
    Ok(())
}
