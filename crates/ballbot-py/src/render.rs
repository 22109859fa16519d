//! `Renderer`.

use crate::convert::{elements, read_elements, vector};
use crate::errors::{call, to_python};
use crate::params::or_paper;
use crate::state::{PyContacts, PyState};
use ballbot_core::render::{Arrow, Camera, Picture, Renderer, Scene, force_arrows, srgb};
use ballbot_core::{Params, State};
use numpy::{Element, PyArray1, PyArray3, PyArray4, PyArrayMethods};
use numpy::{PyArray2, ndarray};
use pyo3::exceptions::{PyMemoryError, PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::path::PathBuf;

/// Takes pictures of a robot without GPU or display, by rays.
///
/// Args:
///     params: the robot, the name of a preset, or the path of a TOML file; None is `Params.paper()`.
///     urdf: (bot, ball), two files whose visual shapes are shown in place of shapes made from `params`.
///     width, height: of the picture, pixels.
///     samples: color samples a pixel, 1, 2 or 4.
///     camera: `target` (three, m), `distance` (m), `azimuth` (rad, counter-clockwise from x), `elevation` (rad),
///         `field_of_view` (vertical, rad) and `follows` (the ball; then `target` is relative to its point of
///         contact) change the default, which follows the robot.
///     num_threads: threads that cast rays; None takes all cores. Pictures do not depend on it.
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
            "distance" => camera.distance = value.extract()?,
            "azimuth" => camera.azimuth = value.extract()?,
            "elevation" => camera.elevation = value.extract()?,
            "field_of_view" => camera.field_of_view = value.extract()?,
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

/// A fresh array of a picture's rows and columns, filled by `fill` without the GIL.
fn picture<'py, T: Element + Clone + Default + Send>(
    py: Python<'py>,
    sizes: &[usize],
    fill: impl FnOnce(&mut [T]) -> ballbot_core::Result<()> + Send,
) -> PyResult<Bound<'py, PyArray1<T>>> {
    let too_large = || PyMemoryError::new_err("no memory for a picture, or as many, of this size");
    let length = sizes.iter().try_fold(1_usize, |product, &n| product.checked_mul(n)).ok_or_else(too_large)?;
    let pixels = py.detach(|| {
        let mut pixels = Vec::new();
        pixels.try_reserve_exact(length).map_err(|_| too_large())?;
        pixels.resize(length, T::default());
        call(|| fill(&mut pixels)).map(|()| pixels)
    })?;
    Ok(PyArray1::from_vec(py, pixels))
}

#[pymethods]
impl PyRenderer {
    #[new]
    #[pyo3(signature = (params=None, *, urdf=None, width=640, height=480, samples=1, camera=None, num_threads=None))]
    fn new(
        params: Option<&Bound<'_, PyAny>>,
        urdf: Option<(PathBuf, PathBuf)>,
        width: i64,
        height: i64,
        samples: i64,
        camera: Option<&Bound<'_, PyDict>>,
        num_threads: Option<i64>,
    ) -> PyResult<Self> {
        let (params, scene) = match urdf {
            None => {
                let params = or_paper(params)?;
                let scene = Scene::of(&params);
                (params, scene)
            }
            Some(_) if params.is_some() => {
                return Err(PyTypeError::new_err("a renderer takes params or urdf, not both"));
            }
            Some((bot, ball)) => {
                let params = ballbot_core::urdf::params_from_urdf(&bot, &ball).map_err(to_python)?;
                (params, Scene::from_urdf(&bot, &ball).map_err(to_python)?)
            }
        };
        let [width, height, samples] = [("width", width), ("height", height), ("samples", samples)].map(|(name, n)| {
            usize::try_from(n).map_err(|_| PyValueError::new_err(format!("{name} = {n}, it must be > 0")))
        });
        let (width, height, samples) = (width?, height?, samples?);
        let camera = camera_with(Camera::following(scene.height()), camera)?;
        let num_threads = num_threads.map(|n| usize::try_from(n).unwrap_or(0));
        let renderer = call(|| {
            let renderer = Renderer::new(scene, width, height, samples, camera)?;
            match num_threads {
                Some(n) => renderer.with_threads(n),
                None => Ok(renderer),
            }
        })?;
        Ok(Self { renderer, params })
    }

    /// The robot in a state, shape (height, width, 3), uint8.
    ///
    /// `contacts` adds arrows: loads (blue) and tractions (green) of the wheels, the floor's horizontal force (red).
    /// `arrows` adds others, (from, to) in m, inertial frame: shape (n, 2, 3).
    #[pyo3(signature = (state, contacts=None, arrows=None))]
    fn render<'py>(
        &self,
        py: Python<'py>,
        state: &PyState,
        contacts: Option<&PyContacts>,
        arrows: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyArray3<u8>>> {
        let mut shown = contacts.map_or_else(Vec::new, |c| force_arrows(&self.params, &state.0, &c.contacts));
        if let Some(arrows) = arrows {
            let ends = elements::<f64>("arrows", arrows, &[None, Some(2), Some(3)])?;
            shown.extend(ends.chunks(6).map(|e| Arrow {
                from: [e[0], e[1], e[2]].into(),
                to: [e[3], e[4], e[5]].into(),
                colour: srgb(0xe03131),
            }));
        }
        let (width, height) = self.renderer.size();
        let rgb = picture(py, &[height, width, 3], |rgb| {
            self.renderer.render(&state.0, &shown, Picture { rgb: Some(rgb), ..Picture::default() })
        })?;
        rgb.reshape([height, width, 3])
    }

    /// Distances along the camera's axis, shape (height, width), float32, m; infinite in the sky.
    fn depth<'py>(&self, py: Python<'py>, state: &PyState) -> PyResult<Bound<'py, PyArray2<f32>>> {
        let (width, height) = self.renderer.size();
        let depth = picture(py, &[height, width], |depth| {
            self.renderer.render(&state.0, &[], Picture { depth: Some(depth), ..Picture::default() })
        })?;
        depth.reshape([height, width])
    }

    /// What each pixel shows, shape (height, width), uint8: `LABELS[value]` names it.
    fn labels<'py>(&self, py: Python<'py>, state: &PyState) -> PyResult<Bound<'py, PyArray2<u8>>> {
        let (width, height) = self.renderer.size();
        let labels = picture(py, &[height, width], |labels| {
            self.renderer.render(&state.0, &[], Picture { labels: Some(labels), ..Picture::default() })
        })?;
        labels.reshape([height, width])
    }

    /// Robots in states (rows as `State.to_array`, shape (n, 32)): shape (n, height, width, 3), uint8.
    fn render_batch<'py>(&self, py: Python<'py>, states: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyArray4<u8>>> {
        let mut rows = Vec::new();
        read_elements::<f64>("states", states, &[None, Some(State::LEN)], &mut rows)?;
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

    /// Of the picture, pixels.
    #[getter]
    fn width(&self) -> usize {
        self.renderer.size().0
    }

    /// Of the picture, pixels.
    #[getter]
    fn height(&self) -> usize {
        self.renderer.size().1
    }
}
