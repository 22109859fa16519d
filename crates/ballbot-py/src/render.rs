//! `Renderer`.

use crate::errors::{call, not_pickled, to_python};
use crate::robot::params::Robot;
use crate::robot::state::{PyContacts, PyState};
use crate::robot::terrain::terrain as ground;
use crate::signals::interruptible;
use crate::values::convert::{elements, vector};
use crate::values::keywords::no_others;
use crate::values::numbers::{count, optional_whole, real, whole};
use ballbot_core::render::{Arrow, Camera, Picture, Renderer, Scene, force_arrows, srgb};
use ballbot_core::{Params, State, try_zeros};
use numpy::{Element, PyArray1, PyArray3, PyArray4, PyArrayMethods};
use numpy::{PyArray2, ndarray};
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::path::PathBuf;

/// Maximum number of arrows of a picture, and of pictures of a batch.
const MOST_ARROWS: usize = 1 << 16;
const MOST_STATES: usize = 1 << 20;

/// A ray-casting renderer of a robot, without GPU or display.
///
/// ```python
/// renderer = bb.Renderer("kugle", width=320, height=240)
/// picture = renderer.render(bb.State.at_rest("kugle"))
/// print(picture.shape, renderer.depth(bb.State.at_rest("kugle")).min())
/// ```
///
/// Args:
///     robot: as in `Ballbot`.
///     urdf: paths (bot, ball) of two URDFs; their visual shapes replace the default shapes of `robot`.
///     width, height: size of the picture, pixels, at most 8192.
///     samples: color samples per pixel, 1, 2 or 4.
///     camera: dict of settings that replace the defaults: `target` (shape (3,), m), `distance` (m), `azimuth` (rad,
///         counter-clockwise from x), `elevation` (rad), `field_of_view` (vertical, rad), `follows` (bool: the camera
///         moves with the ball, and `target` is relative to its contact point with the floor).
///     num_threads: number of threads, at most 256; None is one per core. Pictures do not depend on it.
///     terrain: the ground, a `Terrain`, the name of a kind or a dict for `Terrain.generate`; None is level.
///
/// Raises:
///     ValueError: a number out of range. TypeError: an unknown camera setting.
///     UrdfError, OSError: a file that cannot be read.
#[pyclass(name = "Renderer", module = "ballbot_rs", frozen)]
pub(crate) struct PyRenderer {
    renderer: Renderer,
    params: Params,
}

fn camera_with(mut camera: Camera, changes: Option<&Bound<'_, PyDict>>) -> PyResult<Camera> {
    for (name, value) in changes.into_iter().flatten() {
        let name: String = name.extract()?;
        match name.as_str() {
            "target" => camera.target = vector("target", &value)?,
            "distance" => camera.distance = real(&value)?,
            "azimuth" => camera.azimuth = real(&value)?,
            "elevation" => camera.elevation = real(&value)?,
            "field_of_view" => camera.field_of_view = real(&value)?,
            "follows" => camera.follows = value.extract()?,
            _ => {
                return Err(PyTypeError::new_err(format!(
                    "unknown camera setting '{name}': expected one of target, distance, azimuth, elevation, \
                     field_of_view, follows"
                )));
            }
        }
    }
    Ok(camera)
}

/// A new flat array of the product of `sizes`, filled by `fill` without the GIL.
fn picture<'py, T: Element + Clone + Default + Send>(
    py: Python<'py>,
    sizes: &[usize],
    fill: impl FnOnce(&mut [T]) -> ballbot_core::Result<()> + Send,
) -> PyResult<Bound<'py, PyArray1<T>>> {
    let pixels = interruptible(py, || {
        let mut pixels = try_zeros(format_args!("a picture, or as many, of shape {sizes:?}"), sizes)?;
        fill(&mut pixels).map(|()| pixels)
    })?;
    Ok(PyArray1::from_vec(py, pixels))
}

#[pymethods]
impl PyRenderer {
    #[new]
    #[pyo3(
        signature = (robot=None, *, urdf=None, width=640, height=480, samples=1, camera=None, num_threads=None,
                     terrain=None, **others),
        text_signature = "(robot=None, *, urdf=None, width=640, height=480, samples=1, camera=None, num_threads=None, \
                          terrain=None)"
    )]
    #[allow(clippy::too_many_arguments, reason = "keywords of Python")]
    fn new(
        robot: Option<Robot>,
        urdf: Option<(PathBuf, PathBuf)>,
        #[pyo3(from_py_with = whole)] width: i64,
        #[pyo3(from_py_with = whole)] height: i64,
        #[pyo3(from_py_with = whole)] samples: i64,
        camera: Option<&Bound<'_, PyDict>>,
        #[pyo3(from_py_with = optional_whole)] num_threads: Option<i64>,
        terrain: Option<&Bound<'_, PyAny>>,
        others: Option<&Bound<'_, PyDict>>,
    ) -> PyResult<Self> {
        no_others("Renderer", others)?;
        let ground = terrain.map_or(Ok(None), ground)?;
        let (params, scene) = match urdf {
            None => {
                let params = Robot::or_paper(robot);
                let scene = Scene::of(&params);
                (params, scene)
            }
            Some(_) if robot.is_some() => {
                return Err(PyTypeError::new_err("a renderer takes robot or urdf, not both"));
            }
            Some((bot, ball)) => {
                let params = ballbot_core::urdf::params_from_urdf(&bot, &ball).map_err(to_python)?;
                (params, Scene::from_urdf(&bot, &ball).map_err(to_python)?)
            }
        };
        let (width, height) = (count("width", width, 1)?, count("height", height, 1)?);
        let samples = count("samples", samples, 1)?;
        let camera = camera_with(Camera::following(scene.height()), camera)?;
        let num_threads = num_threads.map(|n| count("num_threads", n, 1)).transpose()?;
        let renderer = call(|| {
            let renderer = Renderer::new(scene.on(ground), width, height, samples, camera)?;
            match num_threads {
                Some(n) => renderer.with_threads(n),
                None => Ok(renderer),
            }
        })?;
        Ok(Self { renderer, params })
    }

    /// Picture of the robot in a state, sRGB, shape (height, width, 3), uint8.
    ///
    /// `contacts` adds arrows of the contact forces: loads (blue) and tractions (green) of the wheels, force along the
    /// ground (red). `arrows` adds arrows from tails to tips in the inertial frame, m, shape (n, 2, 3).
    #[pyo3(signature = (state, contacts=None, arrows=None))]
    fn render<'py>(
        &self,
        py: Python<'py>,
        state: &PyState,
        contacts: Option<&PyContacts>,
        arrows: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyArray3<u8>>> {
        let ground = self.renderer.terrain();
        let mut shown = contacts.map_or_else(Vec::new, |c| force_arrows(&self.params, &state.0, &c.contacts, ground));
        if let Some(arrows) = arrows {
            let ends = elements::<f64>("arrows", arrows, &[None, Some(2), Some(3)], 6 * MOST_ARROWS)?;
            shown.extend(ends.chunks(6).map(|e| Arrow {
                from: [e[0], e[1], e[2]].into(),
                to: [e[3], e[4], e[5]].into(),
                color: srgb(0xe03131),
            }));
        }
        let (width, height) = self.renderer.size();
        let rgb = picture(py, &[height, width, 3], |rgb| {
            self.renderer.render(&state.0, &shown, Picture { rgb: Some(rgb), ..Picture::default() })
        })?;
        rgb.reshape([height, width, 3])
    }

    /// Depth along the camera axis, m, shape (height, width), float32; infinite in the sky.
    fn depth<'py>(&self, py: Python<'py>, state: &PyState) -> PyResult<Bound<'py, PyArray2<f32>>> {
        let (width, height) = self.renderer.size();
        let depth = picture(py, &[height, width], |depth| {
            self.renderer.render(&state.0, &[], Picture { depth: Some(depth), ..Picture::default() })
        })?;
        depth.reshape([height, width])
    }

    /// Label of each pixel, shape (height, width), uint8; `LABELS[value]` is its name.
    fn labels<'py>(&self, py: Python<'py>, state: &PyState) -> PyResult<Bound<'py, PyArray2<u8>>> {
        let (width, height) = self.renderer.size();
        let labels = picture(py, &[height, width], |labels| {
            self.renderer.render(&state.0, &[], Picture { labels: Some(labels), ..Picture::default() })
        })?;
        labels.reshape([height, width])
    }

    /// Pictures of the robot in n states (rows as `State.to_array`, shape (n, 32)), shape (n, height, width, 3), uint8.
    fn render_batch<'py>(&self, py: Python<'py>, states: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyArray4<u8>>> {
        let rows = elements::<f64>("states", states, &[None, Some(State::LEN)], State::LEN * MOST_STATES)?;
        let states = rows.as_chunks::<{ State::LEN }>().0;
        let (width, height) = self.renderer.size();
        let frame = 3 * width * height;
        let rgb = picture(py, &[states.len(), frame], |rgb| {
            for (row, rgb) in states.iter().zip(rgb.chunks_mut(frame)) {
                let picture = Picture { rgb: Some(rgb), ..Picture::default() };
                self.renderer.render(&State::from_array(row), &[], picture)?;
            }
            Ok(())
        })?;
        rgb.reshape(ndarray::Ix4(states.len(), height, width, 3))
    }

    /// Width of the picture, pixels.
    #[getter]
    fn width(&self) -> usize {
        self.renderer.size().0
    }

    /// Height of the picture, pixels.
    #[getter]
    fn height(&self) -> usize {
        self.renderer.size().1
    }

    fn __reduce__(&self) -> PyResult<()> {
        not_pickled("Renderer", "make another with the same arguments")
    }

    fn __repr__(&self) -> String {
        let (width, height) = self.renderer.size();
        format!("<Renderer: {width} x {height} pixels>")
    }
}
