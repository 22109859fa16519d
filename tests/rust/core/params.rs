//! Parameters: what is rejected with which message, and that no conversion loses a value.

use ballbot_core::fields::Fields;
use ballbot_core::{Error, Params};
use std::f64::consts::{FRAC_PI_2, FRAC_PI_4, PI, TAU};
use std::fmt::Write;
use std::fs;
use std::path::{Path, PathBuf};

/// A change that must be rejected, and what the message must contain: the name, the value, the limit.
type Refusal<'a> = (&'a str, &'a [f64], [&'a str; 2]);

#[track_caller]
fn assert_rejected(rejections: &[Refusal<'_>]) {
    for (name, values, words) in rejections {
        let result = Params::paper().replace([(*name, *values)]);
        let error = result.expect_err(&format!("{name} = {values:?} is accepted"));
        assert!(matches!(error, Error::OutOfRange { .. }), "{name} = {values:?}: {error:?}");
        for word in words {
            assert!(error.to_string().contains(word), "{name} = {values:?}: '{error}' does not contain '{word}'");
        }
    }
}

#[test]
fn parameters_that_are_not_finite_are_rejected() {
    for ((name, values), field) in Params::paper().fields().zip(Params::FIELDS) {
        let limit = format!("{} {}", field.limit, field.unit);
        for index in 0..values.len() {
            for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
                let mut values = values.to_vec();
                values[index] = bad;
                let error = Params::paper().replace([(name, values.as_slice())]).unwrap_err().to_string();
                let place = if values.len() == 1 { name.to_owned() } else { format!("{name}[{index}]") };
                assert_eq!(error, format!("{place} = {bad} is out of range: it must be {}", limit.trim_end()));
            }
        }
    }
}

#[test]
fn parameters_that_are_not_positive_are_rejected() {
    for name in [
        "ball_mass",
        "ball_inertia",
        "ball_radius",
        "body_mass",
        "body_com_height",
        "wheel_mass",
        "wheel_inertia",
        "wheel_radius",
        "max_wheel_torque",
        "gravity",
        "friction_critical_velocity",
    ] {
        for value in [0.0, -1.5] {
            assert_rejected(&[(name, &[value], [&format!("{name} = {value} "), "must be >= 1e-"])]);
        }
    }
    assert_rejected(&[(
        "body_inertia",
        &[0.01, 0.0, 0.01],
        ["body_inertia[1] = 0 ", "must be >= 1e-18 and <= 1e9 kg·m²"],
    )]);
}

/// `values` with one of them replaced.
fn with_value(values: &[f64], index: usize, value: f64) -> Vec<f64> {
    let mut values = values.to_vec();
    values[index] = value;
    values
}

#[test]
fn parameters_beyond_their_documented_range_are_rejected() {
    let page = fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/conventions.md")).unwrap();
    for ((name, values), field) in Params::paper().fields().zip(Params::FIELDS) {
        let limit = field.limit;
        let row = page.lines().find(|line| line.starts_with(&format!("| `{name}` |"))).unwrap();
        assert!(row.contains(&format!("| {limit} |")), "the range of {name} is {limit}: {row}");
        for index in 0..values.len() {
            for value in [1e-300, 5e-324, 1e10, 1e155, f64::MAX] {
                let values = with_value(values, index, value);
                let result = Params::paper().replace([(name, values.as_slice())]);
                assert!(limit.contains(value) || result.is_err(), "{name} = {value:e} is accepted");
            }
        }
    }
    // A rim so heavy that everything else is negligible.
    let error = Params::paper().replace([("wheel_radius", &[1e-6][..]), ("wheel_inertia", &[1.0][..])]).unwrap_err();
    assert!(error.to_string().starts_with("wheel_inertia / wheel_radius^2 = 1"), "{error}");
}

#[test]
fn negative_friction_is_rejected() {
    for name in [
        "ball_viscous_friction",
        "wheel_viscous_friction",
        "wheel_coulomb_friction",
        "wheel_dynamic_friction",
        "floor_dynamic_friction",
        "floor_rolling_friction",
        "floor_spinning_friction",
        "roller_friction",
        "roller_friction_slope",
        "roller_ripple",
        "wheel_preload",
    ] {
        assert_rejected(&[(name, &[-0.1], [&format!("{name} = -0.1 "), ">= 0"])]);
        let changed = Params::paper().replace([(name, &[0.0][..])]).unwrap();
        assert_eq!(changed.fields().find(|(n, _)| *n == name).unwrap().1, [0.0]);
    }
}

#[test]
fn static_friction_is_at_least_dynamic_friction() {
    assert_rejected(&[
        ("wheel_static_friction", &[0.9], ["wheel_static_friction = 0.9 ", "at least the dynamic coefficient, 1"]),
        ("floor_dynamic_friction", &[1.2], ["floor_static_friction = 1.1 ", "at least the dynamic coefficient, 1.2"]),
    ]);
    assert!(Params::paper().replace([("wheel_static_friction", &[1.0][..])]).is_ok());
}

#[test]
fn invalid_rollers_are_rejected() {
    // Twelve straight rollers on the paper's wheels of 50 mm.
    let straight = 0.05 * (1.0 - (std::f64::consts::PI / 12.0).cos());
    let words = format!("at most {straight} m, wheel_radius (1 - cos(pi / roller_count))");
    assert_rejected(&[
        ("roller_ripple", &[2e-3], ["roller_ripple = 0.002 ", &words]),
        ("roller_count", &[12.5], ["roller_count = 12.5 ", "a whole number"]),
        ("roller_count", &[2.0], ["roller_count = 2 ", ">= 3"]),
        ("roller_angle", &[1.3], ["roller_angle = 1.3 ", "<= 1.2"]),
        ("roller_angle", &[-1.3], ["roller_angle = -1.3 ", ">= -1.2"]),
    ]);
    for (count, ripple) in [(12.0, straight), (24.0, 4e-4), (3.0, 0.02)] {
        let fields = [("roller_count", &[count][..]), ("roller_ripple", &[ripple])];
        assert!(Params::paper().replace(fields).unwrap().has_ripple());
    }
}

#[test]
fn a_preload_is_at_most_a_thousand_weights() {
    let words = format!("at most {} N, 1000 times the body's weight", 1e3 * 2.228 * 9.81);
    assert_rejected(&[("wheel_preload", &[3e4], ["wheel_preload = 30000 ", &words])]);
    // A mast that does not pass between the wheels: the preload lifts one of them.
    let azimuths = [0.0, 1.5, 3.0];
    let fields = [("wheel_azimuths", &azimuths[..]), ("body_com_offset", &[0.0, 0.05])];
    let leaning = Params::paper().replace(fields).unwrap();
    let error = leaning.replace([("wheel_preload", &[1e3][..])]).unwrap_err().to_string();
    assert!(error.contains("wheel_preload, along the mast, must pass between the wheels"), "{error}");
}

#[test]
fn impossible_inertia_is_rejected() {
    // No moment exceeds the sum of the other two; a ball has at most the moment of a thin shell.
    assert_rejected(&[
        ("body_inertia", &[0.05, 0.02, 0.02], ["body_inertia[0] = 0.05 ", "at most 0.04"]),
        ("body_inertia", &[0.02, 0.02, 0.05], ["body_inertia[2] = 0.05 ", "triangle inequality"]),
        ("ball_inertia", &[0.0122], ["ball_inertia = 0.0122 ", "thin shell"]),
    ]);
    // The limits themselves: a flat body, a thin shell.
    assert!(Params::paper().replace([("body_inertia", &[0.05, 0.03, 0.02][..])]).is_ok());
    let shell = 2.0 / 3.0 * 1.437 * 0.112 * 0.112;
    assert!(Params::paper().replace([("ball_inertia", &[shell][..])]).is_ok());
}

#[test]
fn wheels_are_part_of_the_body() {
    assert_rejected(&[("wheel_mass", &[0.75], ["wheel_mass = 0.75 ", "below a third of body_mass = 2.228"])]);
    assert!(Params::paper().replace([("wheel_mass", &[0.742][..])]).is_ok());
}

#[test]
fn wheels_must_be_on_the_upper_half_of_the_ball_and_apart() {
    for zenith in [0.0, FRAC_PI_2, -0.3, 2.0] {
        assert_rejected(&[("wheel_zenith", &[zenith], ["wheel_zenith = ", "must be >= 0.001 and <= 1.569"])]);
    }
    for (offset, zenith) in [(FRAC_PI_4, FRAC_PI_2), (-FRAC_PI_4, 0.0), (FRAC_PI_4 - 5e-4, FRAC_PI_2 - 5e-4)] {
        let error = Params::paper().replace([("wheel_zenith_offsets", &[0.0, offset, 0.0][..])]).unwrap_err();
        let expected = format!("wheel_zenith + wheel_zenith_offsets[1] = {zenith} is out of range");
        assert!(error.to_string().starts_with(&expected), "{error}");
    }
    assert_rejected(&[
        // Two wheels at the same position turn the ball only about their axis.
        ("wheel_azimuths", &[0.0, 0.0, PI], ["volume spanned by the axles of the wheels = 0 ", "at least 0.000001"]),
        ("wheel_azimuths", &[0.0, TAU, 4.0], ["volume spanned by the axles", "turn the ball about every axis"]),
        // Apart, but all on one side of the mast: the body topples over wheel 1.
        ("wheel_azimuths", &[-0.5, 0.0, 0.5], ["load of wheel 1 in equilibrium = -", "pass between the wheels"]),
    ]);
    // Two full turns more, 2e-6 rad off, 5 deg off.
    for (turn, even) in [(2.0 * TAU, true), (2e-6, false), (0.09, false)] {
        let azimuths = [0.5 + TAU / 3.0 + turn, 0.5 - TAU / 3.0, 0.5];
        let params = Params::paper().replace([("wheel_azimuths", &azimuths[..])]).unwrap();
        assert_eq!((params.has_even_wheels(), params.is_symmetric()), (even, even), "{azimuths:?}");
    }
}

#[test]
fn the_center_of_mass_must_be_between_the_wheels() {
    let height = Params::paper().body_com_height;
    // Between wheels 1 and 2 the edge of their triangle is at half the tangent of the zenith, 1.
    for (share, load) in [(0.49, Ok(())), (0.51, Err(()))] {
        let result = Params::paper().replace([("body_com_offset", &[-share * height, 0.0][..])]);
        assert_eq!(result.as_ref().map(|_| ()).map_err(|_| ()), load, "{share}: {result:?}");
        if let Err(error) = result {
            assert!(matches!(error, Error::OutOfRange { .. }), "{error:?}");
            let (text, limit) = (error.to_string(), 1e-3 * (2.228 * 9.81));
            assert!(text.starts_with("the load of wheel 0 in equilibrium = -"), "{text}");
            assert!(text.contains(&format!("at least {limit} N")), "{text}");
        }
    }
    let leaning = Params::paper().replace([("body_com_offset", &[0.03, -0.04][..])]).unwrap();
    assert_eq!(leaning.body_com().as_slice(), [0.03, -0.04, height]);
    assert!(!leaning.is_symmetric() && leaning.has_even_wheels());
}

/// Products of inertia turn the principal axes; the moments about them decide.
#[test]
fn impossible_products_of_inertia_are_rejected() {
    let with = |products: [f64; 3]| Params::paper().replace([("body_products_of_inertia", &products[..])]);
    for (products, words) in [
        // Principal moments 0.0583 ± 0.06 and 0.0137.
        ([0.06, 0.0, 0.0], ["[0] = -0.00169999", "> 0"]),
        // 0.0883, above 0.0283 + 0.0137.
        ([0.03, 0.0, 0.0], ["[2] = 0.088", "triangle inequality"]),
        ([0.0, 0.0, 0.03], ["principal moments of body_inertia with body_products_of_inertia, [0] = -0.001", "> 0"]),
    ] {
        let error = with(products).unwrap_err();
        assert!(matches!(error, Error::OutOfRange { .. }), "{error:?}");
        for word in words {
            assert!(error.to_string().contains(word), "{products:?}: '{error}' does not contain '{word}'");
        }
    }
    let params = with([6e-3, -2e-3, 1e-3]).unwrap();
    let expected = [[0.0583, 6e-3, -2e-3], [6e-3, 0.0583, 1e-3], [-2e-3, 1e-3, 0.0137]];
    for (i, row) in expected.iter().enumerate() {
        assert_eq!(params.body_inertia_matrix().row(i).iter().copied().collect::<Vec<_>>(), row);
    }
    assert!(!params.is_symmetric());
    // From the smallest to the largest numbers that are allowed.
    for scale in [1e-15, 1e8] {
        let (moments, products) = ([scale, 1.1 * scale, 0.9 * scale], [0.1 * scale, -0.05 * scale, 0.0]);
        let result = Params::paper().replace([("body_inertia", &moments[..]), ("body_products_of_inertia", &products)]);
        assert!(result.is_ok(), "{scale}: {result:?}");
    }
}

#[test]
fn unknown_names_and_wrong_lengths_are_rejected() {
    let error = Params::paper().replace([("ball_weight", &[1.0][..])]).unwrap_err();
    assert!(matches!(&error, Error::UnknownName { name, .. } if name == "ball_weight"), "{error:?}");
    for known in Params::FIELDS {
        assert!(error.to_string().contains(known.name), "{error} does not list {}", known.name);
    }
    for (name, values, expected) in
        [("body_inertia", &[0.05, 0.05][..], 3), ("ball_mass", &[1.0, 2.0][..], 1), ("ball_mass", &[][..], 1)]
    {
        let error = Params::paper().replace([(name, values)]).unwrap_err();
        assert_eq!(error.to_string(), format!("{name} has {} values, expected {expected}", values.len()));
    }
}

/// All fields of the paper's robot but one.
fn fields_without(params: &Params, left_out: &str) -> Vec<(&'static str, Vec<f64>)> {
    params.fields().filter(|(name, _)| *name != left_out).map(|(name, values)| (name, values.to_vec())).collect()
}

fn from_fields(fields: &[(&'static str, Vec<f64>)]) -> Result<Params, Error> {
    Params::from_fields(fields.iter().map(|(name, values)| (*name, values.as_slice())))
}

#[test]
fn missing_parameters_are_named_and_optional_ones_have_defaults() {
    let required = [
        "ball_mass",
        "ball_inertia",
        "ball_radius",
        "body_mass",
        "body_inertia",
        "body_com_height",
        "wheel_mass",
        "wheel_inertia",
        "wheel_radius",
        "wheel_zenith",
    ];
    let paper = Params::paper();
    for name in Params::FIELDS.iter().map(|field| field.name) {
        match from_fields(&fields_without(&paper, name)) {
            Err(error) => {
                assert!(required.contains(&name), "{name} has no default: {error}");
                assert_eq!(error.to_string(), format!("parameter {name} is missing"));
            }
            // The paper's robot has every optional value at its default.
            Ok(params) => {
                assert!(!required.contains(&name), "{name} is not required");
                assert_eq!(params, paper, "default of {name}");
            }
        }
    }
    // A value that is given as NaN is not missing.
    let mut fields = fields_without(&paper, "ball_mass");
    fields.push(("ball_mass", vec![f64::NAN]));
    assert!(from_fields(&fields).unwrap_err().to_string().starts_with("ball_mass = NaN "));
}

/// A robot whose values are all different and not at their defaults.
fn unlike_any_other() -> Params {
    let mut fields: Vec<_> = fields_without(&Params::paper(), "");
    for (i, (_, values)) in fields.iter_mut().enumerate() {
        for (j, value) in values.iter_mut().enumerate() {
            *value = *value * (1.0 - 0.003 * (i as f64 + 1.0)) + 1e-5 * (j as f64 + 1.0);
        }
    }
    let turned = fields.iter_mut().find(|(name, _)| *name == "wheel_azimuths").unwrap();
    turned.1 = [0.1, 0.2 + TAU / 3.0, 0.15 + 2.0 * TAU / 3.0].to_vec();
    let rollers = fields.iter_mut().find(|(name, _)| *name == "roller_count").unwrap();
    rollers.1 = vec![9.0];
    let patches = fields.iter_mut().find(|(name, _)| *name == "floor_patch_size").unwrap();
    patches.1 = vec![0.5];
    from_fields(&fields).unwrap()
}

#[test]
fn fields_round_trip() {
    let params = unlike_any_other();
    assert!(params.fields().map(|(name, _)| name).eq(Params::FIELDS.iter().map(|field| field.name)));
    // Fifteen vectors of three and seven of two.
    assert_eq!(params.fields().map(|(_, values)| values.len()).sum::<usize>(), Params::FIELDS.len() + 15 * 2 + 7);
    for ((name, changed), (_, default)) in params.fields().zip(Params::paper().fields()) {
        assert!(changed.iter().zip(default).all(|(a, b)| a != b), "{name} is as before");
    }
    assert_eq!(params.fields().find(|(name, _)| *name == "wheel_radius").unwrap().1, [params.wheel_radius]);
    assert_eq!(params.fields().find(|(name, _)| *name == "body_inertia").unwrap().1, params.body_inertia);
    assert_eq!(Params::from_fields(params.fields()).unwrap(), params);
    assert_eq!(Params::paper().replace(params.fields()).unwrap(), params);
}

#[test]
fn replace_changes_the_given_fields_only() {
    let paper = Params::paper();
    let changed = paper.replace([("ball_mass", &[2.0][..]), ("body_inertia", &[0.06, 0.05, 0.02])]).unwrap();
    assert_eq!(changed, Params { ball_mass: 2.0, body_inertia: [0.06, 0.05, 0.02], ..Params::paper() });
    assert_eq!(paper, Params::paper());
}

#[test]
fn toml_keeps_all_values_exactly() {
    let params = unlike_any_other();
    let mut text = String::from("# a robot\n");
    for (name, values) in params.fields() {
        match values {
            [value] => writeln!(text, "{name} = {value:?}").unwrap(),
            values => writeln!(text, "{name} = {values:?}").unwrap(),
        }
    }
    assert_eq!(Params::from_toml(&text).unwrap(), params);
    // Whole numbers need no decimal point.
    let whole = format!("{}\nmax_wheel_torque = 3", text.replace("max_wheel_torque", "# max_wheel_torque"));
    assert_eq!(Params::from_toml(&whole).unwrap().max_wheel_torque, 3.0);
}

#[test]
fn parameters_written_as_toml_round_trip() {
    let tiny = Params { wheel_viscous_friction: 1e-300, max_wheel_torque: 1e9, ..unlike_any_other() };
    for params in [Params::paper(), unlike_any_other(), tiny] {
        assert_eq!(Params::from_toml(&params.to_toml()).unwrap(), params, "{}", params.to_toml());
    }
}

/// A file of this test only, deleted at its end.
struct TestFile(PathBuf);

impl TestFile {
    fn new(name: &str, text: &str) -> Self {
        let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("{}-{name}", std::process::id()));
        fs::write(&path, text).unwrap();
        Self(path)
    }
}

impl Drop for TestFile {
    fn drop(&mut self) {
        drop(fs::remove_file(&self.0));
    }
}

#[test]
fn parameters_are_read_from_a_file() {
    let file = TestFile::new("robot.toml", &unlike_any_other().to_toml());
    assert_eq!(Params::from_toml_file(&file.0).unwrap(), unlike_any_other());
}

#[test]
fn errors_of_a_file_name_file_key_and_value() {
    let paper = Params::paper().to_toml();
    for (text, words) in [
        (paper.replace("ball_mass = 1.437", "ball_mass = -1.5"), "ball_mass = -1.5 is out of range"),
        (paper.replace("ball_mass = 1.437", "ball_mass = \"heavy\""), "ball_mass = \"heavy\" is not a number"),
        (paper.replace("ball_mass", "ball_weight"), "unknown parameter 'ball_weight'"),
        (paper.replace("ball_mass = 1.437", ""), "parameter ball_mass is missing"),
        (paper.replace("ball_mass =", "ball_mass"), "line"),
    ] {
        let file = TestFile::new("rejected.toml", &text);
        let error = Params::from_toml_file(&file.0).unwrap_err().to_string();
        assert!(error.starts_with(&format!("cannot decode {}: ", file.0.display())), "{error}");
        assert!(error.contains(words), "'{error}' lacks '{words}'");
    }
    let error = Params::from_toml_file(Path::new("no/such/robot.toml")).unwrap_err();
    assert!(matches!(&error, Error::Io { path, .. } if path == Path::new("no/such/robot.toml")), "{error}");
}

#[test]
fn malformed_toml_is_rejected_with_the_reason() {
    for (text, word) in [
        ("ball_mass = ", "robot parameters"),
        ("ball_mass = \"heavy\"", "ball_mass = \"heavy\" is not a number"),
        ("body_inertia = [0.1, true, 0.1]", "is not a number"),
        ("[ball]\nmass = 1.0", "ball = "),
    ] {
        let error = Params::from_toml(text).unwrap_err();
        assert!(matches!(error, Error::Decode { .. }), "{text}: {error:?}");
        assert!(error.to_string().contains(word), "{text}: '{error}' does not contain '{word}'");
    }
    assert!(matches!(Params::from_toml("ball_wait = 1.0"), Err(Error::UnknownName { .. })));
    assert!(matches!(Params::from_toml("ball_mass = [1.0, 2.0]"), Err(Error::Length { .. })));
    assert!(matches!(Params::from_toml("ball_mass = 1.0"), Err(Error::MissingParameters { .. })));
    assert!(matches!(Params::from_toml("body_inertia = []"), Err(Error::Length { .. })));
}

#[test]
fn derived_numbers_follow_from_table_ii() {
    let params = Params::paper();
    assert!((params.gear_ratio() - 2.24).abs() < 1e-15);
    assert!((params.static_wheel_load() - 10.303_337_76).abs() < 1e-7);
    let high = Params { wheel_zenith: 0.6, ..Params::paper() };
    assert!((high.static_wheel_load() - 2.228 * 9.81 / (3.0 * 0.6_f64.cos())).abs() < 1e-12);
    assert_eq!(params.body_inertia_matrix().diagonal().as_slice(), params.body_inertia);
}
