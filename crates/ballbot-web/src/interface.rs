//! The functions that a page calls. Text goes in through [`input`] and comes out through [`output`]; a scene is a number.
//! Functions that may fail return a negative number and leave the reason in the output.

// `no_mangle` counts as unsafe: another function could have the name, as `time` of the C library has elsewhere.
#![allow(unsafe_code)]

use crate::catalog::catalog;
use crate::scene::Scene;
use ballbot_core::{Error, Result};
use std::cell::RefCell;

thread_local! {
    static SCENES: RefCell<Vec<Option<Scene>>> = const { RefCell::new(Vec::new()) };
    static INPUT: RefCell<Vec<u8>> = const { RefCell::new(Vec::new()) };
    static OUTPUT: RefCell<Vec<u8>> = const { RefCell::new(Vec::new()) };
}

/// Most steps of a call, which nothing interrupts.
const MOST_STEPS: usize = 100_000;

/// Longest text that a page may give, bytes.
const LONGEST: usize = 1 << 20;

/// Where to write a text of `len` bytes in UTF-8; null if it is too long.
#[cfg_attr(target_arch = "wasm32", unsafe(no_mangle))]
pub extern "C" fn input(len: usize) -> *mut u8 {
    INPUT.with_borrow_mut(|input| {
        input.clear();
        if len > LONGEST {
            return std::ptr::null_mut();
        }
        input.resize(len, 0);
        input.as_mut_ptr()
    })
}

/// The text of the last function that has one.
#[cfg_attr(target_arch = "wasm32", unsafe(no_mangle))]
pub extern "C" fn output() -> *const u8 {
    OUTPUT.with_borrow(|output| output.as_ptr())
}

/// Its length, bytes.
#[cfg_attr(target_arch = "wasm32", unsafe(no_mangle))]
pub extern "C" fn output_len() -> usize {
    OUTPUT.with_borrow(Vec::len)
}

fn write(text: &str) {
    OUTPUT.with_borrow_mut(|output| {
        output.clear();
        output.extend_from_slice(text.as_bytes());
    });
}

/// The number of a result, or −1 and its error as output.
fn answer(result: Result<i32>) -> i32 {
    result.unwrap_or_else(|error| {
        write(&error.to_string());
        -1
    })
}

fn with(scene: usize, act: impl FnOnce(&mut Scene) -> Result<()>) -> i32 {
    SCENES.with_borrow_mut(|scenes| match scenes.get_mut(scene) {
        Some(Some(scene)) => answer(act(scene).map(|()| 0)),
        _ => {
            write(&format!("there is no scene {scene}"));
            -1
        }
    })
}

fn text() -> String {
    INPUT.with_borrow(|input| String::from_utf8_lossy(input).into_owned())
}

/// Writes [`catalog`].
#[cfg_attr(target_arch = "wasm32", unsafe(no_mangle))]
pub extern "C" fn describe() -> i32 {
    answer(catalog().map(|lines| {
        write(&lines);
        0
    }))
}

/// Opens the scene of the settings in the input; returns its number.
#[cfg_attr(target_arch = "wasm32", unsafe(no_mangle))]
pub extern "C" fn open_scene() -> i32 {
    answer(Scene::new(&text()).map(|scene| {
        SCENES.with_borrow_mut(|scenes| {
            let place = scenes.iter().position(Option::is_none).unwrap_or_else(|| {
                scenes.push(None);
                scenes.len() - 1
            });
            scenes[place] = Some(scene);
            place as i32
        })
    }))
}

/// Closes a scene.
#[cfg_attr(target_arch = "wasm32", unsafe(no_mangle))]
pub extern "C" fn close_scene(scene: usize) {
    SCENES.with_borrow_mut(|scenes| {
        if let Some(scene) = scenes.get_mut(scene) {
            *scene = None;
        }
    });
}

/// [`Scene::advance`].
#[cfg_attr(target_arch = "wasm32", unsafe(no_mangle))]
pub extern "C" fn advance(scene: usize, steps: usize) -> i32 {
    with(scene, |scene| {
        if steps > MOST_STEPS {
            let limit = format!("at most {MOST_STEPS}");
            return Err(Error::OutOfRange { name: "steps".into(), value: steps as f64, limit });
        }
        scene.advance(steps);
        Ok(())
    })
}

/// [`Scene::rows`]; null for a scene that is not open. It moves when a scene opens.
#[cfg_attr(target_arch = "wasm32", unsafe(no_mangle))]
pub extern "C" fn rows(scene: usize) -> *const f64 {
    SCENES.with_borrow(|scenes| match scenes.get(scene) {
        Some(Some(scene)) => scene.rows().as_ptr(),
        _ => std::ptr::null(),
    })
}

/// [`Scene::heights`] of count × count places; null for a scene that is not open, or more than 1000 × 1000 places.
#[cfg_attr(target_arch = "wasm32", unsafe(no_mangle))]
pub extern "C" fn heights(scene: usize, x: f64, y: f64, half: f64, count: usize) -> *const f64 {
    SCENES.with_borrow_mut(|scenes| match scenes.get_mut(scene) {
        Some(Some(scene)) if count <= 1000 => scene.heights([x, y], half, count).as_ptr(),
        _ => std::ptr::null(),
    })
}

/// [`Scene::obstacles`]; null for a scene that is not open.
#[cfg_attr(target_arch = "wasm32", unsafe(no_mangle))]
pub extern "C" fn obstacles(scene: usize) -> *const f64 {
    SCENES.with_borrow(|scenes| match scenes.get(scene) {
        Some(Some(scene)) => scene.obstacles().as_ptr(),
        _ => std::ptr::null(),
    })
}

/// Number of rows of [`obstacles`]; 0 for a scene that is not open.
#[cfg_attr(target_arch = "wasm32", unsafe(no_mangle))]
pub extern "C" fn obstacle_count(scene: usize) -> usize {
    SCENES.with_borrow(|scenes| match scenes.get(scene) {
        Some(Some(scene)) => scene.obstacles().len() / 7,
        _ => 0,
    })
}

/// [`Scene::time`]; NaN for a scene that is not open.
#[cfg_attr(target_arch = "wasm32", unsafe(no_mangle))]
pub extern "C" fn time(scene: usize) -> f64 {
    SCENES.with_borrow(|scenes| scenes.get(scene).and_then(Option::as_ref).map_or(f64::NAN, Scene::time))
}

/// [`Scene::push`].
#[cfg_attr(target_arch = "wasm32", unsafe(no_mangle))]
pub extern "C" fn push(scene: usize, robot: usize, x: f64, y: f64, z: f64) -> i32 {
    with(scene, |scene| scene.push(robot, [x, y, z]))
}

/// [`Scene::pull`].
#[cfg_attr(target_arch = "wasm32", unsafe(no_mangle))]
pub extern "C" fn pull(scene: usize, robot: usize, x: f64, y: f64, z: f64) -> i32 {
    with(scene, |scene| scene.pull(robot, [x, y, z]))
}

/// [`Scene::drive`].
#[cfg_attr(target_arch = "wasm32", unsafe(no_mangle))]
pub extern "C" fn drive(scene: usize, forward: f64, left: f64, turn: f64) -> i32 {
    with(scene, |scene| scene.drive([forward, left, turn]))
}

/// [`Scene::go_to`].
#[cfg_attr(target_arch = "wasm32", unsafe(no_mangle))]
pub extern "C" fn go_to(scene: usize, x: f64, y: f64) -> i32 {
    with(scene, |scene| scene.go_to([x, y]))
}

/// [`Scene::follow`] with the input.
#[cfg_attr(target_arch = "wasm32", unsafe(no_mangle))]
pub extern "C" fn follow(scene: usize) -> i32 {
    with(scene, |scene| scene.follow(&text()))
}

/// [`Scene::set_params`] with the input.
#[cfg_attr(target_arch = "wasm32", unsafe(no_mangle))]
pub extern "C" fn set_params(scene: usize) -> i32 {
    with(scene, |scene| scene.set_params(&text()))
}

/// [`Scene::reset`].
#[cfg_attr(target_arch = "wasm32", unsafe(no_mangle))]
pub extern "C" fn reset(scene: usize) -> i32 {
    with(scene, |scene| {
        scene.reset();
        Ok(())
    })
}
