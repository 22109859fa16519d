//! Invalid events are rejected where they are given, with their term.

use super::{SEED, at, config, every, optional, scaled};
use ballbot_core::actuator::MotorOptions;
use ballbot_core::batch::{
    Autoreset, BalanceConfig, Batch, Direction, Distribution, Event, Operation, Value, When, event_sets,
    events_from_toml, events_to_toml, load_events,
};
use ballbot_core::task::Balance;
use ballbot_core::{ModelKind, Params};

/// The error of a batch with these events.
fn rejection(events: &[Event]) -> String {
    let made = Batch::new(&config(ModelKind::Contact, 10, events), 2, Autoreset::SameStep, Some(1), SEED);
    made.map(|_| ()).expect_err(&format!("{events:?}")).to_string()
}

#[track_caller]
fn rejected(event: Event, words: &[&str]) {
    let label = format!("events[0] ({})", event.term);
    let error = rejection(&[event]);
    assert!(error.contains(&label), "{error}");
    assert!(words.iter().all(|word| error.contains(word)), "{error}");
}

#[test]
fn amounts_without_a_scale() {
    let of = |term: &str| Event { operation: Operation::AddScaled, ..Event::new(term, [0.0, 0.1]) };
    rejected(of("body_mass"), &["add_scaled", "the unit 'kg'"]);
    rejected(of("color"), &["unknown term 'color'"]);
    rejected(every([1.0, 2.0], of("push")), &["op of a push is 'abs'"]);
}

#[test]
fn invalid_numbers() {
    let nan = f64::NAN;
    rejected(Event::new("color", [0.0, 1.0]), &["unknown term 'color'", "body_mass", "push"]);
    rejected(Event::new("gravity", [10.0, 9.0]), &["range[1] = 9", "at least range[0] = 10"]);
    rejected(Event::new("gravity", [nan, 9.0]), &["range[0] = NaN"]);
    rejected(Event::new("gravity", [9.0, f64::INFINITY]), &["range[1] = inf"]);
    rejected(Event { distribution: Distribution::LogUniform, ..Event::new("gravity", [0.0, 9.0]) }, &["> 0"]);
    rejected(Event { distribution: Distribution::Normal, ..Event::new("gravity", [9.0, -1.0]) }, &["deviation", "-1"]);
    rejected(Event { distribution: Distribution::Normal, ..Event::new("gravity", [9.0, 4.0]) }, &["gravity = -3"]);
    rejected(Event { range: vec![[9.0, 9.0]; 2], ..Event::new("gravity", [0.0; 2]) }, &["2 pairs", "expected one"]);
    rejected(Event { range: vec![[1.0, 1.0]; 2], ..scaled("body_inertia", [0.0; 2]) }, &["2 pairs", "one, or 3"]);
    rejected(Event { range: vec![], ..scaled("body_inertia", [0.0; 2]) }, &["0 pairs"]);
    rejected(Event { range: vec![[1.0, 1.0]; 3], shared: true, ..scaled("body_inertia", [0.0; 2]) }, &["shared"]);
    rejected(Event { id: Some(0), ..Event::new("gravity", [9.0, 9.1]) }, &["id = 0"]);
    rejected(every([0.005, 1.0], Event::new("gravity", [9.0, 9.1])), &["every[0] = 0.005", "control_dt = 0.01"]);
    rejected(every([2.0, 1.0], Event::new("gravity", [9.0, 9.1])), &["every[1] = 1"]);
    rejected(every([nan, 1.0], Event::new("gravity", [9.0, 9.1])), &["every[0] = NaN"]);
    rejected(at(-1.0, Event::new("gravity", [9.0, 9.1])), &["at = -1"]);
    rejected(at(nan, Event::new("gravity", [9.0, 9.1])), &["at = NaN"]);
    assert!(rejection(&vec![Event::new("gravity", [9.0, 9.1]); 65]).contains("64"));
}

#[test]
fn invalid_robots() {
    rejected(Event::new("gravity", [0.0, 9.0]), &["gravity = 0"]);
    rejected(Event::new("floor_tilt", [0.0, 1.0]), &["floor_tilt[0] = 1 ", "<= 0.5"]);
    // Each number is within its range, but not the slope.
    rejected(Event::new("floor_tilt", [-0.4, 0.4]), &["floor_tilt", "at most 0.5 rad"]);
    rejected(scaled("body_mass", [-0.1, 1.0]), &["range = -0.1", ">= 0"]);
    rejected(scaled("body_inertia", [0.5, 1.5]), &["triangle inequality"]);
    rejected(scaled("ball_inertia", [1.0, 1.3]), &["ball_inertia", "thin shell"]);
    rejected(scaled("body_mass", [0.1, 1.0]), &["wheel_mass"]);
    rejected(Event::new("wheel_static_friction", [0.5, 1.1]), &["wheel_static_friction = 0.5", "1"]);
    rejected(Event::new("max_wheel_torque", [0.0, 5.0]), &["max_wheel_torque = 0"]);
    // Each corner is a robot that balances on its ball; robots between the corners do not.
    let turn = 2.0 * std::f64::consts::TAU;
    let azimuths = Params::paper().wheel_azimuths.map(|a| [a, a + turn]).to_vec();
    rejected(
        Event { range: azimuths, ..Event::new("wheel_azimuths", [0.0; 2]) },
        &["wheel_azimuths", "the load of wheel"],
    );
    let turned = Event { operation: Operation::Add, shared: true, ..Event::new("wheel_azimuths", [0.0, turn]) };
    Batch::new(&config(ModelKind::Contact, 10, &[turned]), 2, Autoreset::SameStep, Some(1), SEED).unwrap();
    // Shape changes only at resets.
    let radius = || scaled("ball_radius", [0.99, 1.01]);
    rejected(every([0.1, 0.2], radius()), &["shape", "'reset'"]);
    rejected(at(0.1, radius()), &["shape"]);
    // Each of two events is possible by itself.
    let events = [scaled("body_mass", [0.3, 1.0]), scaled("wheel_mass", [1.0, 2.0])];
    let error = rejection(&events);
    assert!(error.contains("events[0] (body_mass): with events[1] (wheel_mass)"), "{error}");
    // An error of a single term is not attributed to the terms before it.
    let error = rejection(&[scaled("gravity", [0.9, 1.1]), scaled("ball_inertia", [1.0, 1.3])]);
    assert!(error.contains("events[1] (ball_inertia): its range contains an invalid robot"), "{error}");
    // And any two of three.
    let events = [
        scaled("body_mass", [0.4, 1.0]),
        scaled("wheel_mass", [1.0, 1.6]),
        Event { operation: Operation::Add, ..Event::new("wheel_mass", [0.0, 0.13]) },
    ];
    let events = [events[0].clone(), events[1].clone(), Event { id: Some(1), ..events[2].clone() }];
    let error = rejection(&events);
    assert!(error.contains("events[0] (body_mass): with events[1] (wheel_mass), events[2] (wheel_mass)"), "{error}");
}

#[test]
fn invalid_starts() {
    // Tilted farther than a robot with its wheels at the equator of the ball can be.
    let task = Balance { reset_tilt: 0.5, fall_tilt: 3.0, ..Balance::default() };
    let events = [scaled("wheel_zenith", [1.0, 1.99])];
    for model in [ModelKind::Contact, ModelKind::Rigid] {
        let with = |events: &[Event]| {
            let config = BalanceConfig { task: task.clone(), ..config(model, 10, events) };
            Batch::new(&config, 1, Autoreset::SameStep, Some(1), SEED)
        };
        with(&[]).unwrap();
        let error = with(&events).map(|_| ()).expect_err("wheels reach the floor").to_string();
        assert!(error.contains("events[0] (wheel_zenith)"), "{error}");
    }
}

#[test]
fn events_that_change_nothing() {
    let error = |config: BalanceConfig| {
        let made = Batch::new(&config, 2, Autoreset::SameStep, Some(1), SEED);
        made.map(|_| ()).map_err(|error| error.to_string())
    };
    let slip = [
        "wheel_static_friction",
        "wheel_dynamic_friction",
        "floor_static_friction",
        "floor_dynamic_friction",
        "friction_critical_velocity",
    ];
    for term in slip {
        let event = scaled(term, [1.0, 1.05]);
        for model in [ModelKind::Planar, ModelKind::Spatial] {
            let found = error(config(model, 10, std::slice::from_ref(&event))).unwrap_err();
            let words =
                [&format!("events[0] ({term})"), &format!("the model '{model}' has no slip"), "optional = true"];
            assert!(words.iter().all(|word| found.contains(*word)), "{found}");
            error(config(model, 10, &[optional(event.clone())])).unwrap();
        }
        for model in [ModelKind::Contact, ModelKind::Rigid] {
            error(config(model, 10, std::slice::from_ref(&event))).unwrap();
        }
    }
    // The rollers slip along their axles on any model but `planar`, at most with the friction of the wheel.
    let caps = [scaled("wheel_dynamic_friction", [0.9, 1.0]), Event::new("roller_friction", [0.0, 0.1])];
    error(config(ModelKind::Spatial, 10, &caps)).unwrap();

    for term in ["roller_count", "roller_phases"] {
        let event = Event::new(term, [5.0, 5.0]);
        let found = error(config(ModelKind::Contact, 10, std::slice::from_ref(&event))).unwrap_err();
        assert!(found.contains(&format!("events[0] ({term})")) && found.contains("roller_ripple"), "{found}");
        error(config(ModelKind::Contact, 10, &[event, Event::new("roller_ripple", [0.0, 1e-4])])).unwrap();
    }

    // `config` has actions of 0.3 N·m.
    let strong = Event::new("max_wheel_torque", [0.31, 5.0]);
    let with = |events: &[Event], actuators: MotorOptions| {
        error(BalanceConfig { actuators, ..config(ModelKind::Contact, 10, events) })
    };
    let ideal = MotorOptions::default;
    let found = with(std::slice::from_ref(&strong), ideal()).unwrap_err();
    assert!(found.contains("events[0] (max_wheel_torque)") && found.contains("0.31 N·m"), "{found}");
    assert!(found.contains("0.3 N·m, the option max_wheel_torque times actuators.strength"), "{found}");
    with(&[optional(strong.clone())], ideal()).unwrap();
    with(&[Event::new("max_wheel_torque", [0.29, 5.0])], ideal()).unwrap();
    with(&[strong.clone(), Event::new("actuators.strength", [1.0, 1.1])], ideal()).unwrap();
    let curve = MotorOptions { stall_torque: 1.0, no_load_speed: 300.0, ..ideal() };
    with(std::slice::from_ref(&strong), curve).unwrap();
    let found = with(&[strong], MotorOptions { peak_torque: 0.2, ..ideal() }).unwrap_err();
    assert!(found.contains("peak_torque = 0.2 N·m"), "{found}");
}

#[test]
fn invalid_pushes() {
    let push = |range: [f64; 2]| at(1.0, Event::new("push", range));
    rejected(Event::new("push", [0.0, 1.0]), &["'interval' or 'at'"]);
    rejected(Event { when: When::Startup, ..Event::new("push", [0.0, 1.0]) }, &["'interval' or 'at'"]);
    rejected(push([-1.0, 1.0]), &["range = -1"]);
    rejected(push([0.0, 2e4]), &["impulse", "10000"]);
    rejected(Event { operation: Operation::Scale, ..push([0.0, 1e4]) }, &["impulse[0] = 22280"]);
    rejected(Event { operation: Operation::Add, ..push([0.0, 1.0]) }, &["'abs'", "'scale'"]);
    rejected(Event { height: Some([0.0, 200.0]), ..push([0.0, 1.0]) }, &["point[2] = 200"]);
    rejected(Event { height: Some([0.2, 0.1]), ..push([0.0, 1.0]) }, &["height[1] = 0.1"]);
    rejected(Event { direction: Direction::Azimuth(f64::NAN), ..push([0.0, 1.0]) }, &["direction = NaN"]);
    rejected(Event { duration: -0.1, ..push([0.0, 1.0]) }, &["duration = -0.1", "from 0 to"]);
    let often = Event { when: When::Every([0.5, 1.0]), ..push([0.0, 1.0]) };
    rejected(Event { duration: 0.6, ..often }, &["duration = 0.6", "0.5 s"]);
}

#[test]
fn two_events_of_one_id() {
    let twice = [scaled("body_mass", [0.9, 1.1]), scaled("body_mass", [0.9, 1.1])];
    let error = rejection(&twice);
    assert!(error.contains("events[1] (body_mass)") && error.contains("another id"), "{error}");
    let same = ["body_mass", "gravity"].map(|term| Event { id: Some(7), ..scaled(term, [0.9, 1.1]) });
    let error = rejection(&same);
    assert!(error.contains("events[1] (gravity)") && error.contains("events[0] (body_mass)"), "{error}");
}

#[test]
fn invalid_toml() {
    for (text, words) in [
        ("events = 3", &["'events' is not a list"][..]),
        ("x = 3", &["unknown key 'x'"]),
        ("[[events]]", &["events[0]", "'term'"]),
        ("[[events]]\nterm = 3", &["term = 3"]),
        ("[[events]]\nterm = 'gravity'", &["events[0] (gravity)", "'range'"]),
        ("[[events]]\nterm = 'gravity'\nrange = 'wide'", &["(gravity)", "range = 'wide'"]),
        ("[[events]]\nterm = 'gravity'\nrange = [1, 2, 3]", &["(gravity)", "range = [1, 2, 3]"]),
        (
            "[[events]]\nterm = 'gravity'\nrange = [9, 10]\nop = 'mul'",
            &["(gravity)", "unknown op 'mul'", "abs, add, scale"],
        ),
        ("[[events]]\nterm = 'gravity'\nrange = [9, 10]\ndist = 'flat'", &["(gravity)", "unknown dist 'flat'"]),
        ("[[events]]\nterm = 'gravity'\nrange = [9, 10]\nmode = 'step'", &["(gravity)", "unknown mode 'step'"]),
        ("[[events]]\nterm = 'gravity'\nrange = [9, 10]\nrnge = 3", &["(gravity)", "unknown key 'rnge'"]),
        ("[[events]]\nterm = 'gravity'\nrange = [9, 10]\nmode = 'interval'", &["(gravity)", "'every'"]),
        ("[[events]]\nterm = 'gravity'\nrange = [9, 10]\nmode = 'at'", &["(gravity)", "'at'"]),
        ("[[events]]\nterm = 'gravity'\nrange = [9, 10]\nmode = 'reset'\nat = 1", &["(gravity)", "'reset'"]),
        ("[[events]]\nterm = 'gravity'\nrange = [9, 10]\nat = 1\nevery = [1, 2]", &["(gravity)", "both"]),
        ("[[events]]\nterm = 'gravity'\nrange = [9, 10]\nid = -1", &["(gravity)", "id = -1"]),
        ("[[events]]\nterm = 'gravity'\nrange = [9, 10]\nid = 1.5", &["(gravity)", "id = 1.5"]),
        ("[[events]]\nterm = 'gravity'\nrange = [9, 10]\nshared = 1", &["(gravity)", "shared = 1"]),
        ("[[events]]\nterm = 'gravity'\nrange = [9, 10]\nheight = 1", &["(gravity)", "height", "push"]),
        ("[[events]]\nterm = 'push'\nrange = [9, 10]\nat = 1\ndirection = 'up'", &["(push)", "direction = 'up'"]),
        ("[[events]\n", &["events.toml"]),
    ] {
        let error = events_from_toml(text, "events.toml").expect_err(text).to_string();
        assert!(error.contains("events.toml") && words.iter().all(|word| error.contains(word)), "{text}: {error}");
    }
    let error = load_events("wild").unwrap_err().to_string();
    assert!(error.contains("'wild'") && error.contains("mild, hard"), "{error}");
    assert!(load_events("none.toml").unwrap_err().to_string().contains("none.toml"));
}

#[test]
fn events_read_back_what_they_write() {
    let mut events: Vec<_> = event_sets().into_iter().flat_map(|set| load_events(set).unwrap()).collect();
    events.extend(super::several());
    events.push(Event {
        distribution: Distribution::Normal,
        range: vec![[1.0, 0.1], [1.0 / 3.0, 1e-17], [-0.0, 0.0]],
        id: Some(9),
        ..Event::new("wheel_azimuths", [0.0; 2])
    });
    events.push(at(
        0.1,
        Event { direction: Direction::Azimuth(0.1), height: Some([0.1, 0.2]), ..Event::new("push", [0.0, 1.0]) },
    ));
    assert_eq!(events_from_toml(&events_to_toml(&events), "").unwrap(), events);
    for (place, event) in events.iter().enumerate() {
        let entries: Vec<_> = event.entries().into_iter().map(|(key, value)| (key.to_owned(), value)).collect();
        assert_eq!(&Event::from_entries(place, &entries).unwrap(), event);
    }
    // A height may be one number.
    let entries = [("term", Value::Text("push".into())), ("range", [0.0, 1.0].into()), ("height", Value::Number(0.2))];
    let entries = entries.map(|(key, value)| (key.to_owned(), value));
    assert_eq!(Event::from_entries(0, &entries).unwrap().height, Some([0.2; 2]));
}
