//! The URDF loader: the shipped robot is Table II of the paper, other ballbots load, anything else is rejected.

use ballbot_core::urdf::{
    motors_from_urdf_text, params_from_urdf, params_from_urdf_text, visuals_from_urdf, visuals_from_urdf_text,
};
use ballbot_core::{Error, Params};
use nalgebra::{Matrix3, Rotation3, Vector3};
use std::f64::consts::{FRAC_PI_2, FRAC_PI_4, TAU};
use std::path::{Path, PathBuf};

const BOT: &str = include_str!("../../../assets/bot.urdf");
const BALL: &str = include_str!("../../../assets/ball.urdf");

/// `text` with the first `from` replaced.
fn edit(text: &str, from: &str, to: &str) -> String {
    assert!(text.contains(from), "nothing to edit: {from}");
    text.replacen(from, to, 1)
}

/// The shipped bot with `elements` added.
fn bot_with(elements: &str) -> String {
    edit(BOT, "</robot>", &format!("{elements}</robot>"))
}

fn load(bot: &str) -> Params {
    params_from_urdf_text(bot, BALL).unwrap()
}

/// File and reason of a rejection.
fn rejection(bot: &str, ball: &str) -> (String, String) {
    match params_from_urdf_text(bot, ball) {
        Err(Error::Urdf { file, reason }) => (file, reason),
        other => panic!("expected an error, got {other:?}"),
    }
}

#[track_caller]
fn assert_close(found: &Params, expected: &Params, tolerance: f64) {
    for ((name, found), (_, expected)) in found.fields().zip(expected.fields()) {
        for (a, b) in found.iter().zip(expected) {
            assert!((a - b).abs() <= tolerance * b.abs().max(1e-3), "{name} = {a}, expected {b}");
        }
    }
}

/// Numbers of the attribute `name` in the first element that starts with `element` after `start` in the shipped bot.
fn numbers(start: &str, element: &str, name: &str) -> Vec<f64> {
    let after = |text: &'static str, what: &str| {
        let at = text.find(what).unwrap_or_else(|| panic!("no {what}"));
        &text[at + what.len()..]
    };
    let value = after(after(after(BOT, start), element), &format!("{name}=\""));
    value[..value.find('"').unwrap()].split(' ').map(|v| v.parse().unwrap()).collect()
}

/// Inertia about the link's CoM in the link's axes, from its diagonal.
fn inertia(link: &str) -> Matrix3<f64> {
    let moment = |name: &str| numbers(link, "<inertia ", name)[0];
    Matrix3::from_diagonal(&Vector3::new(moment("ixx"), moment("iyy"), moment("izz")))
}

/// Independent of the loader: sums the files' numbers by hand.
#[test]
fn sums_of_the_links_are_table_ii() {
    let mut parts = vec![(
        numbers("link name=\"body\"", "<mass ", "value")[0],
        Vector3::from_row_slice(&numbers("link name=\"body\"", "<origin ", "xyz")),
        inertia("link name=\"body\""),
    )];
    let mut spin = Matrix3::zeros();
    for i in 0..3 {
        let (link, joint) = (format!("link name=\"wheel_{i}\""), format!("joint name=\"wheel_joint_{i}\""));
        let at = Vector3::from_row_slice(&numbers(&joint, "<origin ", "xyz"));
        let rpy = numbers(&joint, "<origin ", "rpy");
        let axes = Rotation3::from_euler_angles(rpy[0], rpy[1], rpy[2]);
        let axle = axes * Vector3::from_row_slice(&numbers(&joint, "<axis ", "xyz"));
        let (mass, tensor) = (numbers(&link, "<mass ", "value")[0], inertia(&link));
        assert_eq!(mass, 0.1192);
        spin += axle * axle.transpose() * 0.000149;
        parts.push((mass, at, axes.matrix() * tensor * axes.matrix().transpose()));
    }
    let mass: f64 = parts.iter().map(|(m, ..)| m).sum();
    let com = parts.iter().map(|(m, c, _)| c * *m).sum::<Vector3<f64>>() / mass;
    let total: Matrix3<f64> = parts
        .iter()
        .map(|(m, c, j)| {
            let d = c - com;
            j + (Matrix3::identity() * d.norm_squared() - d * d.transpose()) * *m
        })
        .sum();
    let table = Matrix3::from_diagonal(&Vector3::new(0.0583, 0.0583, 0.0137));
    assert!((mass - 2.228).abs() <= 1e-12 * 2.228, "{mass}");
    assert!((com - Vector3::new(0.0, 0.0, 0.142)).norm() <= 1e-12 * 0.142, "{com}");
    assert!((total - spin - table).amax() <= 1e-12 * 0.0137, "{total}");
}

#[test]
fn shipped_urdfs_equal_the_paper_preset() {
    let assets = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../assets");
    let files = params_from_urdf(&assets.join("bot.urdf"), &assets.join("ball.urdf")).unwrap();
    assert_close(&files, &Params::paper(), 1e-12);
    assert_eq!(files, load(BOT));
}

#[test]
fn joint_dynamics_and_limits_are_read() {
    let bot = BOT.replace("damping=\"0\" friction=\"0\"", "damping=\"0.02\" friction=\"0.003\"");
    let params = load(&bot.replace("effort=\"5\"", "effort=\"2.5\""));
    assert_eq!(params.wheel_viscous_friction, 0.02);
    assert_eq!(params.wheel_coulomb_friction, 0.003);
    assert_eq!(params.max_wheel_torque, 2.5);
}

#[test]
fn velocity_limit_is_the_speed_limit_of_the_motors() {
    let limit = |bot: &str| motors_from_urdf_text(bot).map(|motors| motors.speed_limit);
    assert_eq!(limit(BOT).unwrap(), 100.0);
    for none in ["<limit effort=\"5\" velocity=\"0\"/>", "<limit effort=\"5\" velocity=\"inf\"/>", ""] {
        let bot = BOT.replace("<limit effort=\"5\" velocity=\"100\"/>", none);
        assert!(motors_from_urdf_text(&bot).unwrap().is_ideal(), "{none}");
    }
    for (velocity, parts) in [
        ("-1", &["actuators.speed_limit = -1", "bot URDF"][..]),
        ("1e-9", &["at least 0.001 rad/s"]),
        ("1e9", &["<= 1e6"]),
        ("NaN", &["the wheels differ"]),
    ] {
        let error =
            limit(&BOT.replace("velocity=\"100\"", &format!("velocity=\"{velocity}\""))).unwrap_err().to_string();
        assert!(parts.iter().all(|part| error.contains(part)), "{velocity}: {error}");
    }
    let error = limit(&BOT.replacen("velocity=\"100\"", "velocity=\"90\"", 1)).unwrap_err().to_string();
    assert!(error.contains("joint velocity limit = 100") && error.contains("90 of joint"), "{error}");
    assert!(limit(BALL).unwrap_err().to_string().contains("0 joints are continuous or revolute"));
}

#[test]
fn missing_effort_limit_gives_the_default() {
    let default = Params::paper().max_wheel_torque;
    for limit in ["<limit effort=\"0\" velocity=\"1\"/>", "<limit velocity=\"1\"/>", ""] {
        let bot = BOT.replace("<limit effort=\"5\" velocity=\"100\"/>", limit);
        assert_eq!(load(&bot).max_wheel_torque, default, "{limit}");
        let version_1_2 = bot.replace("<robot name", "<robot version=\"1.2\" name");
        assert_eq!(load(&version_1_2).max_wheel_torque, default, "{limit}");
    }
}

#[test]
fn root_frame_may_be_anywhere_on_the_mast() {
    for height in [-250.0, -0.4, 0.112] {
        let base = format!(
            r#"<link name="base"/><joint name="base_joint" type="fixed">
            <origin xyz="0 0 {height}" rpy="0 0 {FRAC_PI_2}"/><parent link="base"/><child link="body"/></joint>"#
        );
        let params = load(&bot_with(&base));
        let turned = Params { wheel_azimuths: [0.25, 7.0 / 12.0, 11.0 / 12.0].map(|t| t * TAU), ..Params::paper() };
        assert_close(&params, &turned, if height < -1.0 { 1e-11 } else { 1e-12 });
    }
}

#[test]
fn inertial_frames_may_be_rotated() {
    let (from, to) = (
        " iyy=\"0.05546522290637172\" iyz=\"0\" izz=\"0.0088958228\"",
        " iyy=\"0.0088958228\" iyz=\"0\" izz=\"0.05546522290637172\"",
    );
    let bot = edit(BOT, from, to);
    let bot = edit(&bot, "0.14724789116644882\"", &format!("0.14724789116644882\" rpy=\"{FRAC_PI_2} 0 0\""));
    assert_close(&load(&bot), &Params::paper(), 1e-12);
}

#[test]
fn links_fixed_to_the_body_are_part_of_it() {
    let (mass, z, moment) = (0.4, 0.5, 0.001);
    let sensors = format!(
        r#"<link name="lidar"><inertial><mass value="{mass}"/>
        <inertia ixx="{moment}" ixy="0" ixz="0" iyy="{moment}" iyz="0" izz="{moment}"/></inertial></link>
        <link name="optical_frame"/>
        <joint name="a" type="fixed"><origin xyz="0.1 0.2 0.3" rpy="0.1 0.2 0.3"/>
        <parent link="lidar"/><child link="optical_frame"/></joint>
        <joint name="b" type="fixed"><origin xyz="0 0 {z}"/><parent link="body"/><child link="lidar"/></joint>"#
    );
    let (params, paper) = (load(&bot_with(&sensors)), Params::paper());
    let body_mass = paper.body_mass + mass;
    let body_com_height = (paper.body_mass * paper.body_com_height + mass * z) / body_mass;
    let lever = paper.body_mass * mass / body_mass * (z - paper.body_com_height).powi(2);
    let [x, y, yaw] = paper.body_inertia;
    let body_inertia = [x + moment + lever, y + moment + lever, yaw + moment];
    assert_close(&params, &Params { body_mass, body_com_height, body_inertia, ..paper }, 1e-12);
}

#[test]
fn links_fixed_to_a_wheel_are_part_of_it() {
    let mut bot = BOT.replace("<mass value=\"0.1192\"/>", "<mass value=\"0.0592\"/>");
    for i in 0..3 {
        // Two weights on opposite sides would not be symmetric; a ring of three is.
        for k in 0..3 {
            let (y, x) = (TAU * f64::from(k) / 3.0).sin_cos();
            let roller = format!(
                r#"<link name="roller_{i}{k}"><inertial><mass value="0.02"/>
                <inertia ixx="0" ixy="0" ixz="0" iyy="0" iyz="0" izz="0"/></inertial>
                <collision><geometry><sphere radius="0.01"/></geometry></collision></link>
                <joint name="roller_joint_{i}{k}" type="fixed"><origin xyz="{} {} 0"/>
                <parent link="wheel_{i}"/><child link="roller_{i}{k}"/></joint></robot>"#,
                0.04 * x,
                0.04 * y
            );
            bot = edit(&bot, "</robot>", &roller);
        }
    }
    let (params, paper) = (load(&bot), Params::paper());
    assert!((params.wheel_mass - 0.1192).abs() < 1e-15);
    assert!((params.wheel_inertia - (paper.wheel_inertia + 3.0 * 0.02 * 0.04_f64.powi(2))).abs() < 1e-15);
    assert_eq!(params.wheel_radius, 0.05);
    assert!((params.body_mass - paper.body_mass).abs() < 1e-14);
}

#[test]
fn wheels_are_in_document_order_of_the_joints() {
    let (start, end) =
        (BOT.find("  <joint name=\"wheel_joint_0\"").unwrap(), BOT.find("  <joint name=\"wheel_joint_1\"").unwrap());
    let bot = edit(&edit(BOT, &BOT[start..end], ""), "</robot>", &format!("{}</robot>", &BOT[start..end]));
    let azimuths = [TAU / 3.0, 2.0 * TAU / 3.0, 0.0];
    assert_close(&load(&bot), &Params { wheel_azimuths: azimuths, ..Params::paper() }, 1e-12);
}

/// Zenith of each wheel, and its azimuth offset from a symmetric wheel.
struct Uneven {
    zeniths: [f64; 3],
    turns: [f64; 3],
}

/// The shipped bot with its wheels at another zenith and turned about the mast.
fn rearranged(zenith: f64, turn: f64) -> String {
    arranged(&Uneven { zeniths: [zenith; 3], turns: [turn; 3] })
}

/// The shipped bot with its wheels elsewhere, joints revolute, the axle along the wheels' x axis, radii from visual shapes.
fn arranged(places: &Uneven) -> String {
    let mut bot = BOT[..BOT.find("  <joint").unwrap()].replace("collision>", "visual>");
    let (tensor, turned) = (
        "ixx=\"7.45e-05\" ixy=\"0\" ixz=\"0\" iyy=\"7.45e-05\" iyz=\"0\" izz=\"0.000149\"",
        "ixx=\"0.000149\" ixy=\"0\" ixz=\"0\" iyy=\"7.45e-05\" iyz=\"0\" izz=\"7.45e-05\"",
    );
    bot = bot.replace(tensor, turned);
    let (ball, disc) = ("<geometry><sphere radius=\"0.05\"/>", "<geometry><cylinder radius=\"0.05\" length=\"0.02\"/>");
    assert!(bot.contains(ball));
    bot = bot.replace(ball, &format!("<origin xyz=\"0 0 0\" rpy=\"0 {FRAC_PI_2} 0\"/>{disc}"));
    for i in 0..3 {
        let (zenith, turn) = (places.zeniths[i], places.turns[i]);
        let azimuth = turn + TAU / 3.0 * i as f64;
        let (x, y, z) =
            (0.162 * zenith.sin() * azimuth.cos(), 0.162 * zenith.sin() * azimuth.sin(), 0.162 * zenith.cos());
        bot += &format!(
            r#"<joint name="motor {i}" type="revolute"><origin xyz="{x} {y} {z}" rpy="0 {zenith} {azimuth}"/>
            <parent link="body"/><child link="wheel_{i}"/><axis xyz="2 0 0"/><limit velocity="1"/></joint>"#
        );
    }
    bot + "</robot>"
}

#[test]
fn other_zeniths_and_azimuths_load() {
    for (zenith, turn) in [(0.6, 0.0), (FRAC_PI_4, 1.0), (1.2, 0.3)] {
        let params = load(&rearranged(zenith, turn));
        assert!((params.wheel_zenith - zenith).abs() < 1e-12, "{}", params.wheel_zenith);
        for (i, azimuth) in params.wheel_azimuths.into_iter().enumerate() {
            assert!((azimuth - turn - TAU / 3.0 * i as f64).abs() < 1e-12, "{azimuth}");
        }
        let (rest, wheels, wheel_height) = (1.8704, 3.0 * 0.1192, 0.162 * zenith.cos());
        let height = (rest * 0.147_247_891_166_448_82 + wheels * wheel_height) / (rest + wheels);
        assert!((params.body_com_height - height).abs() < 1e-12);
        let yaw =
            0.008_895_822_8 + wheels * (0.162 * zenith.sin()).powi(2) + 7.45e-5 * (3.0 - 3.0 * zenith.sin().powi(2));
        assert!((params.body_inertia[2] - yaw).abs() < 1e-12);
        assert_eq!(params.wheel_radius, 0.05);
    }
}

#[test]
fn moments_about_x_and_y_may_differ() {
    let params = load(&edit(BOT, "ixx=\"0.0554652", "ixx=\"0.0454652"));
    assert!((params.body_inertia[0] - 0.0483).abs() < 1e-14);
    assert!((params.body_inertia[1] - 0.0583).abs() < 1e-14);
}

/// The shipped bot with the body's CoM moved by (x, y): the total CoM moves by the body's fraction of the mass.
fn off_mast(x: f64, y: f64) -> Params {
    load(&edit(BOT, "<origin xyz=\"0 0 0.147", &format!("<origin xyz=\"{x} {y} 0.147")))
}

#[test]
fn a_center_of_mass_off_the_mast_is_read() {
    let share = 1.8704 / 2.228;
    for (x, y) in [(0.35e-6, 0.0), (0.0, -0.35e-6), (5e-3, 0.0), (-3e-3, 4e-3)] {
        let params = off_mast(x / share, y / share);
        // The wheels stay where they are, so the parallel axes change.
        let (link, wheels) = (1.8704, 3.0 * 0.1192);
        let spread = link * (1.0 - share) / (share * share);
        let (xx, yy, xy) = (spread * y * y, spread * x * x, -spread * x * y);
        let height = 0.147_247_891_166_448_82 - 0.162 * FRAC_PI_4.cos();
        let lever = link * wheels / (link + wheels) * height / share;
        let [jx, jy, jz] = Params::paper().body_inertia;
        let expected = Params {
            body_com_offset: [x, y],
            body_inertia: [jx + xx, jy + yy, jz + xx + yy],
            body_products_of_inertia: [xy, -lever * x, -lever * y],
            ..Params::paper()
        };
        for ((name, found), (_, required)) in params.fields().zip(expected.fields()) {
            for (a, b) in found.iter().zip(required) {
                // Products below 1e-6 of the largest moment count as rounding.
                let rounding = name == "body_products_of_inertia" && b.abs() <= 1e-6 * 0.0584;
                let tolerance = if rounding { 1e-6 * 0.0584 } else { 1e-12 };
                assert!((a - b).abs() <= tolerance, "{name} = {a}, expected {b}");
            }
        }
        let lean = params.equilibrium_attitude(0.0).angle();
        assert!((lean - x.hypot(y).atan2(0.142)).abs() < 1e-9, "leans {lean} rad");
        assert!(!params.is_symmetric());
    }
    // 0.1 µm at 142 mm is rounding.
    assert_close(&off_mast(1e-7, 0.0), &Params::paper(), 1e-12);
    assert!(off_mast(1e-7, 0.0).is_symmetric());
}

#[test]
fn products_of_inertia_are_read_with_their_signs() {
    let bot = edit(BOT, "ixy=\"0\" ixz=\"0\"", "ixy=\"1e-5\" ixz=\"-2e-5\"");
    let params = load(&edit(&bot, "iyz=\"0\"", "iyz=\"3e-5\""));
    let expected = Params { body_products_of_inertia: [1e-5, -2e-5, 3e-5], ..Params::paper() };
    for (found, required) in params.body_products_of_inertia.iter().zip(expected.body_products_of_inertia) {
        assert!((found - required).abs() < 1e-15, "{found}, expected {required}");
    }
    assert_close(&Params { body_products_of_inertia: [0.0; 3], ..params }, &Params::paper(), 1e-12);
    // 5e-8 of 0.0583 kg·m² is rounding.
    assert!(load(&edit(BOT, "ixy=\"0\"", "ixy=\"5e-8\"")).is_symmetric());
    // In a frame rotated about the mast, the same body has other products.
    let turned = edit(BOT, "ixx=\"0.05546522290637172\"", "ixx=\"0.04546522290637172\"");
    let turned = edit(&turned, "0.14724789116644882\"", "0.14724789116644882\" rpy=\"0 0 0.5\"");
    let (sin, cos) = 0.5_f64.sin_cos();
    let found = load(&turned).body_products_of_inertia;
    assert!((found[0] + 0.01 * sin * cos).abs() < 1e-14, "{found:?}");
}

#[test]
fn wheels_may_be_uneven() {
    let uneven = Uneven { zeniths: [FRAC_PI_4, 0.8, 0.7], turns: [0.0, 1.0_f64.to_radians(), -0.5_f64.to_radians()] };
    let params = load(&arranged(&uneven));
    assert!(!params.is_symmetric());
    let mean = uneven.zeniths.iter().sum::<f64>() / 3.0;
    assert!((params.wheel_zenith - mean).abs() < 1e-12, "{}", params.wheel_zenith);
    for i in 0..3 {
        let azimuth = TAU / 3.0 * i as f64 + uneven.turns[i];
        assert!((params.wheel_azimuths[i] - azimuth).abs() < 1e-12, "{}", params.wheel_azimuths[i]);
        assert!((params.wheel_zeniths()[i] - uneven.zeniths[i]).abs() < 1e-12, "{}", params.wheel_zeniths()[i]);
    }
    // Three wheels off their symmetric positions move the CoM, and with it the equilibrium.
    let wheels: Vector3<f64> = (0..3)
        .map(|i| {
            let (sin, cos) = uneven.zeniths[i].sin_cos();
            let (y, x) = params.wheel_azimuths[i].sin_cos();
            Vector3::new(sin * x, sin * y, cos) * (0.162 * 0.1192)
        })
        .sum();
    let com = (wheels + Vector3::z() * (1.8704 * 0.147_247_891_166_448_82)) / 2.228;
    assert!((params.body_com() - com).norm() < 1e-12, "{}", params.body_com());
}

/// Edits of the shipped bot, each with what the rejection must contain.
const BAD_BOTS: &[(&str, &str, &[&str])] = &[
    ("</robot>", "", &["not a readable URDF"]),
    ("<robot name=\"ballbot\">", "<robot name=\"ballbot\"><link name=\"body\"/>", &["two links", "'body'"]),
    ("<parent link=\"body\"/>", "<parent link=\"torso\"/>", &["'wheel_joint_0'", "'torso'", "does not exist"]),
    ("<child link=\"wheel_1\"/>", "<child link=\"wheel_0\"/>", &["'wheel_0'", "child of two joints"]),
    ("<parent link=\"body\"/>", "<parent link=\"wheel_0\"/>", &["'wheel_0' does not hang on the root", "loop"]),
    ("</robot>", "<link name=\"spare\"/></robot>", &["'body'", "'spare'", "exactly one root"]),
    ("type=\"continuous\"", "type=\"fixed\"", &["2 joints", "exactly 3", "'wheel_joint_0' fixed"]),
    ("type=\"continuous\"", "type=\"prismatic\"", &["'wheel_joint_0' is prismatic"]),
    (
        "<parent link=\"body\"/>\n    <child link=\"wheel_2\"/>",
        "<parent link=\"wheel_1\"/><child link=\"wheel_2\"/>",
        &["'wheel_joint_2' hangs on the wheel of 'wheel_joint_1'"],
    ),
    (
        "<axis xyz=\"0 0 1\"/>",
        "<axis xyz=\"0 0 1\"/><mimic joint=\"wheel_joint_1\"/>",
        &["'wheel_joint_0' mimics 'wheel_joint_1'"],
    ),
    (
        "<axis xyz=\"0 0 1\"/>",
        "<axis xyz=\"0 0 -1\"/>",
        &["wheel 0 (joint 'wheel_joint_0')", "wrong way", "(0.707107, 0.000000, -0.707107)", "flip"],
    ),
    ("<axis xyz=\"0 0 1\"/>", "<axis xyz=\"1 0 0\"/>", &["wheel 0", "not perpendicular", "cosine is -1.000e0", "1e-6"]),
    ("<axis xyz=\"0 0 1\"/>", "<axis xyz=\"0 0.6 0.8\"/>", &["wheel 0", "meridian plane", "6.000e-1", "1e-6"]),
    ("<axis xyz=\"0 0 1\"/>", "<axis xyz=\"0 0 0\"/>", &["wheel 0", "length 0"]),
    ("<axis xyz=\"0 0 1\"/>", "<axis xyz=\"0 NaN 1\"/>", &["axis of wheel 0", "NaN", "finite"]),
    ("0.1145512985522207\" rpy", "0.1155\" rpy", &["do not all touch one ball", "1e-6 m"]),
    ("xyz=\"0.1145512985522207 0 ", "xyz=\"0.1146 0 ", &["do not all touch one ball", "0.1146 m off the mast"]),
    ("0.1145512985522207\" rpy", "inf\" rpy", &["origin of joint 'wheel_joint_0'", "inf", "finite"]),
    (
        "<origin xyz=\"0 0 0.147",
        "<origin xyz=\"-0.12 0 0.147",
        &["load of wheel 0", "at least 0.02", "pass between the wheels"],
    ),
    ("ixy=\"0\"", "ixy=\"0.06\"", &["the body has moments of inertia", "positive definite"]),
    ("ixz=\"0\"", "ixz=\"0.02\"", &["principal moment", "triangle inequality"]),
    ("<mass value=\"1.8704\"/>", "<mass value=\"0\"/>", &["'body' has an inertia but mass = 0 kg"]),
    ("<mass value=\"1.8704\"/>", "<mass value=\"-1\"/>", &["'body'", "mass = -1 kg", ">= 0"]),
    ("<mass value=\"1.8704\"/>", "<mass value=\"NaN\"/>", &["'body'", "mass = NaN kg"]),
    ("izz=\"0.0088958228\"", "izz=\"-0.0088958228\"", &["the body", "-0.0088958228", "positive definite"]),
    ("ixx=\"7.45e-05\"", "ixx=\"NaN\"", &["inertial of link 'wheel_0'", "NaN", "finite"]),
    ("<mass value=\"0.1192\"/>", "<mass value=\"0.12\"/>", &["wheels differ", "mass", "0.1192", "0.12 of wheel 0"]),
    ("izz=\"0.000149\"", "izz=\"0.000148\"", &["wheels differ", "inertia about the axle", "0.000148"]),
    ("<sphere radius=\"0.05\"/>", "<sphere radius=\"0.051\"/>", &["wheels differ", "radius", "0.051"]),
    ("<sphere radius=\"0.05\"/>", "<sphere radius=\"-0.05\"/>", &["'wheel_0'", "radius = -0.05 m", "> 0"]),
    ("iyy=\"7.45e-05\"", "iyy=\"8e-05\"", &["wheel 0", "not symmetric about its axle", "1e-6"]),
    (
        "<mass value=\"0.1192\"/>",
        "<origin xyz=\"0.001 0 0\"/><mass value=\"0.1192\"/>",
        &["wheel 0", "1.000e-3 m off its axle", "1e-6 m"],
    ),
    ("damping=\"0\"", "damping=\"0.1\"", &["wheels differ", "joint damping", "0.1"]),
    ("friction=\"0\"", "friction=\"-0.1\"", &["wheel 0", "friction = -0.1", ">= 0"]),
    ("effort=\"5\"", "effort=\"4\"", &["wheels differ", "joint effort limit", "5", "4"]),
    ("effort=\"5\"", "effort=\"NaN\"", &["wheel 0", "effort limit = NaN"]),
];

#[test]
fn urdfs_that_are_not_bots_are_rejected() {
    for &(from, to, expected) in BAD_BOTS {
        let (file, reason) = rejection(&edit(BOT, from, to), BALL);
        // Invalid parameters are reported for both files.
        assert!(file == "bot URDF" || file == "bot URDF and ball URDF", "{file}");
        for part in expected {
            assert!(reason.contains(part), "{from} -> {to}\nexpected: {part}\nfound: {reason}");
        }
    }
}

#[test]
fn missing_parts_are_rejected() {
    let cut = |text: &str, start: &str, end: &str| {
        let from = text.find(start).unwrap();
        let to = from + text[from..].find(end).unwrap() + end.len();
        format!("{}{}", &text[..from], &text[to..])
    };
    let without_mass = cut(BOT, "<inertial>", "</inertial>");
    assert!(rejection(&without_mass, BALL).1.contains("the body has mass = 0 kg"));
    let (wheel, rest) = BOT.split_at(BOT.find("<link name=\"wheel_0\">").unwrap());
    let reason = rejection(&format!("{wheel}{}", cut(rest, "<inertial>", "</inertial>")), BALL).1;
    assert!(reason.contains("wheel 0 (joint 'wheel_joint_0') has mass = 0 kg"), "{reason}");
    let boxes = BOT.replace("<sphere radius=\"0.05\"/>", "<box size=\"1 1 1\"/>");
    assert!(rejection(&boxes, BALL).1.contains("wheel 0 (joint 'wheel_joint_0') has no collision or visual sphere"));
    assert!(rejection("<robot name=\"empty\"/>", BALL).1.contains("no links"));
    assert!(rejection("<robot name=\"one\"><link name=\"body\"/></robot>", BALL).1.contains("0 joints are continuous"));
}

#[test]
fn urdfs_that_are_not_balls_are_rejected() {
    let cases: &[(&str, &str, &[&str])] = &[
        ("</robot>", "", &["not a readable URDF"]),
        ("<mass value=\"1.437\"/>", "<mass value=\"0\"/>", &["'ball' has an inertia but mass = 0 kg"]),
        ("iyy=\"0.0112\"", "iyy=\"0.0113\"", &["'ball' is not the inertia of a ball", "1e-6"]),
        ("ixy=\"0\"", "ixy=\"NaN\"", &["NaN", "finite"]),
        (
            "<mass value",
            "<origin xyz=\"0 0 0.01\"/><mass value",
            &["1.000e-2 m off the center of its sphere", "1e-6 m"],
        ),
        ("inertial>\n      <mass value=\"1.437\"/>", "inertial><mass/>", &["not a readable URDF"]),
    ];
    for &(from, to, expected) in cases {
        let (file, reason) = rejection(BOT, &edit(BALL, from, to));
        assert_eq!(file, "ball URDF");
        for part in expected {
            assert!(reason.contains(part), "{from} -> {to}\nexpected: {part}\nfound: {reason}");
        }
    }
    let cube = BALL.replace("<sphere radius=\"0.112\"/>", "<box size=\"1 1 1\"/>");
    assert!(rejection(BOT, &cube).1.contains("no collision or visual sphere"));
    assert!(rejection(BOT, BOT).1.contains("4 links have a mass, expected exactly one"));
    assert!(rejection(BOT, "<robot name=\"b\"><link name=\"ball\"/></robot>").1.contains("0 links have a mass"));
    let large = BALL.replace("radius=\"0.112\"", "radius=\"0.113\"");
    assert!(rejection(BOT, &large).1.contains("not perpendicular to the line from the ball center"));
    let small = BALL.replace("radius=\"0.112\"", "radius=\"0.05\"");
    assert!(rejection(BOT, &small).1.contains("closer than ball radius + wheel radius = 0.1 m"));
}

#[test]
fn impossible_values_are_out_of_range() {
    let heavy = edit(BALL, "<mass value=\"1.437\"/>", "<mass value=\"0.1\"/>");
    let (file, reason) = rejection(BOT, &heavy);
    assert_eq!(file, "bot URDF and ball URDF");
    assert!(reason.starts_with("ball_inertia = 0.0112 is out of range"), "{reason}");
    let steered = BOT.replacen("type=\"continuous\"", "type=\"revolute\"", 1).replacen(
        "<limit ",
        "<limit lower=\"-0.1\" upper=\"0.1\" ",
        1,
    );
    assert!(rejection(&steered, BALL).1.contains("its limits leave 0.2 rad"));
}

#[test]
fn errors_of_unreadable_files_name_the_file() {
    let missing = PathBuf::from("no/such/bot.urdf");
    let error = params_from_urdf(&missing, &missing).unwrap_err();
    assert!(matches!(&error, Error::Io { path, .. } if *path == missing), "{error}");
    let manifest = Path::new(env!("CARGO_MANIFEST_DIR")).join("Cargo.toml");
    let error = params_from_urdf(&manifest, &manifest).unwrap_err();
    assert!(matches!(&error, Error::Urdf { file, .. } if file.ends_with("Cargo.toml")), "{error}");
}

#[test]
#[cfg(unix)]
fn devices_and_pipes_are_rejected_without_being_read() {
    let pipe = std::env::temp_dir().join(format!("ballbot-pipe-{}", std::process::id()));
    assert!(std::process::Command::new("mkfifo").arg(&pipe).status().unwrap().success());
    for path in [Path::new("/dev/zero"), &pipe, Path::new("/")] {
        for error in [params_from_urdf(path, path).unwrap_err(), Params::from_toml_file(path).unwrap_err()] {
            let expected = format!("cannot read {}: not a regular file", path.display());
            assert_eq!(error.to_string(), expected);
        }
    }
    std::fs::remove_file(pipe).unwrap();
}

#[test]
fn a_file_that_is_too_large_is_rejected() {
    let path = std::env::temp_dir().join(format!("ballbot-large-{}", std::process::id()));
    // Without contents on the disk.
    std::fs::File::create(&path).and_then(|file| file.set_len(1 << 40)).unwrap();
    let errors = [params_from_urdf(&path, &path).unwrap_err(), Params::from_toml_file(&path).unwrap_err()];
    std::fs::remove_file(&path).unwrap();
    for (error, limit) in errors.iter().zip([16 << 20, 1 << 20]) {
        assert!(error.to_string().ends_with(&format!("more than {limit} bytes")), "{error}");
    }
}

#[test]
fn visuals_of_texts_match_files() {
    let assets = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../assets");
    let of_files = visuals_from_urdf(&assets.join("bot.urdf"), &assets.join("ball.urdf")).unwrap();
    let of_texts = visuals_from_urdf_text(BOT, BALL).unwrap();
    assert_eq!(of_files.len(), of_texts.len());
    for (one, other) in of_files.iter().zip(&of_texts) {
        assert_eq!((one.link, one.pose, one.color), (other.link, other.pose, other.color));
    }
}

#[test]
fn truncated_text_is_rejected() {
    for end in (0..BOT.len() - 10).step_by(50) {
        if let Some(cut) = BOT.get(..end) {
            rejection(cut, BALL);
        }
    }
    for end in (0..BALL.len() - 10).step_by(50) {
        if let Some(cut) = BALL.get(..end) {
            rejection(BOT, cut);
        }
    }
}

#[test]
fn attribute_values_never_panic() {
    let quotes: Vec<usize> = BOT.match_indices('"').map(|(at, _)| at).skip(2).collect();
    for pair in quotes.chunks_exact(2) {
        let (before, value, after) = (&BOT[..=pair[0]], &BOT[pair[0] + 1..pair[1]], &BOT[pair[1]..]);
        for replacement in ["", "NaN", "-1", "0", "1e308", "inf NaN -inf", "1e300 1e300 1e300"] {
            if let Ok(params) = params_from_urdf_text(&format!("{before}{replacement}{after}"), BALL) {
                params.validate().unwrap_or_else(|e| panic!("{value} -> {replacement}: {e}"));
            }
        }
    }
}

#[test]
fn deeply_nested_text_is_rejected() {
    let nested = "<a>".repeat(100_000) + &"</a>".repeat(100_000);
    assert!(rejection(&nested, BALL).1.contains("nested more than 64 deep"));
    assert!(rejection(&"<a>".repeat(100_000), BALL).1.contains("nested more than 64 deep"));
}

/// Corpus of the fuzzer: each input is a robot or is rejected, and the shipped input is the shipped robot.
#[test]
fn corpus_of_the_fuzzer_is_read_or_rejected() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fuzz/corpus/urdf");
    let mut read = 0;
    for entry in std::fs::read_dir(&folder).unwrap() {
        let path = entry.unwrap().path();
        let text = std::fs::read_to_string(&path).unwrap();
        let (bot, ball) = text.split_once("<!--ball-->").unwrap_or((&text, BALL));
        match params_from_urdf_text(bot, ball) {
            Ok(params) => {
                params.validate().unwrap();
                read += 1;
            }
            Err(Error::Urdf { .. }) => (),
            Err(other) => panic!("{}: {other:?}", path.display()),
        }
    }
    assert!(read >= 5, "only {read} of the kept inputs are robots");
}
