//! The published robots: every preset describes a robot that can be built from a body and three wheels.

use ballbot_core::{Error, Params};
use nalgebra::{Matrix3, Vector3};
use std::collections::BTreeSet;
use std::f64::consts::{FRAC_PI_2, FRAC_PI_4};
use std::fs;
use std::path::Path;

/// Inertia of only the body about its own CoM: Params' body without three wheels of transverse inertia J_w / 2.
fn inertia_without_wheels(p: &Params) -> Matrix3<f64> {
    let com = Vector3::new(0.0, 0.0, p.body_com_height);
    let mut mass = p.body_mass;
    let mut moment = com * p.body_mass;
    // About the ball center until all wheels are off.
    let steiner = |m: f64, r: &Vector3<f64>| (Matrix3::identity() * r.norm_squared() - r * r.transpose()) * m;
    let mut inertia = p.body_inertia_matrix() + steiner(p.body_mass, &com);
    for azimuth in p.wheel_azimuths {
        let (sin, cos) = p.wheel_zenith.sin_cos();
        let contact = Vector3::new(sin * azimuth.cos(), sin * azimuth.sin(), cos);
        let drive = Vector3::new(-azimuth.sin(), azimuth.cos(), 0.0);
        let axle = drive.cross(&contact);
        let center = contact * (p.ball_radius + p.wheel_radius);
        mass -= p.wheel_mass;
        moment -= center * p.wheel_mass;
        inertia -= steiner(p.wheel_mass, &center);
        inertia -= (Matrix3::identity() - axle * axle.transpose()) * (p.wheel_inertia / 2.0);
    }
    inertia - steiner(mass, &(moment / mass))
}

#[test]
fn presets_are_valid() {
    for name in Params::preset_names() {
        let params = Params::preset(name).unwrap_or_else(|e| panic!("{name}: {e}"));
        params.validate().unwrap_or_else(|e| panic!("{name}: {e}"));
        assert!(params.wheel_zenith > 0.0 && params.wheel_zenith < FRAC_PI_2);
    }
}

#[test]
fn presets_are_files_of_the_robots_folder() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../crates/ballbot-base/robots");
    let mut found = BTreeSet::new();
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_stem().unwrap().to_str().unwrap().to_owned();
        assert_eq!(Params::preset(&name).unwrap(), Params::from_toml_file(&path).unwrap(), "{name}");
        found.insert(name);
    }
    let names = Params::preset_names();
    assert_eq!(names[0], "paper");
    assert!(names[1..].is_sorted(), "{names:?}");
    assert_eq!(names.iter().map(|name| name.to_string()).collect::<BTreeSet<_>>(), found);
}

#[test]
fn bodies_of_presets_have_mass_besides_the_wheels() {
    for name in Params::preset_names() {
        let params = Params::preset(name).unwrap();
        let moments = inertia_without_wheels(&params).symmetric_eigenvalues();
        let largest = moments.max();
        assert!(moments.min() > 0.0, "{name}: {moments}");
        assert!(largest < moments.sum() - largest, "{name}: {moments} break the triangle inequality");
        assert!(params.body_mass > 3.0 * params.wheel_mass, "{name}");
    }
}

#[test]
fn presets_keep_the_published_values() {
    let values = |name: &str| {
        let p = Params::preset(name).unwrap();
        [p.body_mass, p.ball_mass, p.ball_radius, p.wheel_radius, p.body_com_height, p.ball_inertia]
    };
    assert_eq!(values("paper"), [2.228, 1.437, 0.112, 0.05, 0.142, 0.0112]);
    assert_eq!(values("kugle"), [16.154, 1.478, 0.129, 0.05, 0.42125, 0.015_395_8]);
    // Body and wheels together: 9.2 kg at 0.338 m, and three wheels of 0.5 kg at 0.131 m.
    assert_eq!(values("rezero"), [10.7, 2.29, 0.125, 0.06, 0.309, 0.0239]);
    let height = (9.2 * 0.338 + 1.5 * 0.185 * FRAC_PI_4.cos()) / 10.7;
    assert!((height - 0.309).abs() < 5e-4);
    assert_eq!(values("asroballet"), [13.371_87, 3.021_14, 0.115, 0.05, 0.529_046, 0.024_537_1]);
}

#[test]
fn unknown_presets_are_rejected_with_the_known_names() {
    let error = Params::preset("roomba").unwrap_err();
    assert!(matches!(&error, Error::UnknownName { name, .. } if name == "roomba"));
    for known in Params::preset_names() {
        assert!(error.to_string().contains(known), "{error}");
    }
}
