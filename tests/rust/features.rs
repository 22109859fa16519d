//! Without the cargo feature `rigid` the model of that name is rejected, and all others run.

use ballbot_core::{Ballbot, ModelKind, Params};

#[test]
fn models_run_or_name_their_missing_feature() {
    for kind in ModelKind::ALL {
        let robot = Ballbot::new(&Params::paper(), kind, 0.001);
        if kind == ModelKind::Rigid && cfg!(not(feature = "rigid")) {
            let error = robot.err().expect("a model that was not compiled").to_string();
            assert_eq!(
                error,
                "the model 'rigid' needs the cargo feature 'rigid' of ballbot-core, which is not enabled"
            );
        } else {
            robot.unwrap().step([0.01, 0.0, 0.0], 10).unwrap();
        }
    }
}
