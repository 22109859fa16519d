//! `Terrain`.

use crate::errors::{call, to_python};
use crate::values::convert::{ANY_COUNT, elements, numbers, read_elements, shaped};
use crate::values::numbers::{count, real, whole};
use ballbot_core::fields::OptionDescription;
use ballbot_core::terrain::{MOST_NODES, Obstacle, Terrain, TerrainKind};
use ballbot_core::{check_bounded, require_memory, try_reserve};
use numpy::{IntoPyArray, PyArray1, PyArray2, PyArrayMethods, PyUntypedArrayMethods};
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyMapping, PyString};
use std::path::PathBuf;
use std::sync::Arc;

/// Ground that is not level: a smooth surface (a bicubic spline with continuous curvature), shared by all robots on it.
///
/// ```python
/// ground = bb.Terrain.generate("bowl", size_x=3.0, size_y=3.0, cell=0.05)
/// print(ground.height(0.5, 0.0), ground.normal(0.5, 0.0))
/// ```
///
/// Made by `plane`, `from_heights`, `from_function` or `generate`; `with_obstacles` adds posts, boxes and walls. Its center is the origin. Beyond its edges it
/// continues straight, with the slope at the edge; an episode of an environment that leaves it is truncated.
///
/// Raises:
///     ValueError: a surface steeper than 1.05 rad, or numbers that do not define a surface.
#[pyclass(name = "Terrain", module = "ballbot_rs", frozen, eq)]
#[derive(PartialEq)]
pub(crate) struct PyTerrain(pub(crate) Arc<Terrain>);

/// A new terrain, made without the GIL.
fn made(py: Python<'_>, make: impl FnOnce() -> ballbot_core::Result<Terrain> + Send) -> PyResult<PyTerrain> {
    py.detach(|| call(make)).map(|terrain| PyTerrain(Arc::new(terrain)))
}

/// Numbers of a function of x and y, in their broadcast shape.
fn mapped<'py>(
    py: Python<'py>,
    x: &Bound<'py, PyAny>,
    y: &Bound<'py, PyAny>,
    mut value: impl FnMut(f64, f64, &mut Vec<f64>),
    width: usize,
) -> PyResult<Bound<'py, PyAny>> {
    let numpy = py.import("numpy")?;
    let pair = numpy.call_method1("broadcast_arrays", (x, y))?;
    let (x, y) = (pair.get_item(0)?, pair.get_item(1)?);
    let shape: Vec<usize> = x.getattr("shape")?.extract()?;
    // Both coordinates are copied twice: a view of a few bytes can have any shape.
    let count = shape.iter().fold(1_usize, |count, n| count.saturating_mul(*n));
    let needs = || format!("a result of shape {shape:?}");
    require_memory(needs(), count, size_of::<f64>() * (4 + width)).map_err(to_python)?;
    let flat = |name: &str, values: &Bound<'py, PyAny>| {
        let values = elements::<f64>(name, &values.call_method0("ravel")?, &[None], ANY_COUNT)?;
        check_bounded(name, &values).map_err(to_python)?;
        Ok::<_, PyErr>(values)
    };
    let (xs, ys) = (flat("x", &x)?, flat("y", &y)?);
    let mut out = Vec::new();
    try_reserve(needs(), &mut out, xs.len() * width).map_err(to_python)?;
    xs.iter().zip(&ys).for_each(|(x, y)| value(*x, *y, &mut out));
    let out = out.into_pyarray(py).into_any();
    let shape: Vec<usize> = if width == 1 { shape } else { shape.into_iter().chain([width]).collect() };
    let out = out.call_method1("reshape", (shape,))?;
    if out.getattr("ndim")?.extract::<usize>()? == 0 { out.call_method0("item") } else { Ok(out) }
}

#[pymethods]
impl PyTerrain {
    /// A plane through the origin with the angle `slope`, rad, that rises towards `direction`, an angle from the x
    /// axis, rad. It has no edges.
    #[staticmethod]
    #[pyo3(signature = (slope, direction=0.0))]
    fn plane(#[pyo3(from_py_with = real)] slope: f64, #[pyo3(from_py_with = real)] direction: f64) -> PyResult<Self> {
        call(|| Terrain::plane(slope, direction)).map(|terrain| Self(Arc::new(terrain)))
    }

    /// The surface through `heights`, m, shape (rows along y, columns along x), `cell` meters between neighbors.
    #[staticmethod]
    fn from_heights(heights: &Bound<'_, PyAny>, #[pyo3(from_py_with = real)] cell: f64) -> PyResult<Self> {
        let mut values = Vec::<f64>::new();
        let array = read_elements("heights", heights, &[None, None], MOST_NODES, &mut values)?;
        let nodes = [array.shape()[1], array.shape()[0]];
        made(heights.py(), || Terrain::from_heights(&values, nodes, cell))
    }

    /// The surface of a function over a rectangle of `size`, the lengths along x and y, m, from its values in steps of
    /// at most `cell`, m. `height(x, y)` gets two arrays of the same shape and returns an array.
    #[staticmethod]
    #[pyo3(signature = (height, size, cell=0.02))]
    fn from_function<'py>(
        py: Python<'py>,
        height: &Bound<'py, PyAny>,
        size: &Bound<'py, PyAny>,
        #[pyo3(from_py_with = real)] cell: f64,
    ) -> PyResult<Self> {
        let size = numbers("size", size)?;
        let (nodes, cell) = call(|| Terrain::grid(size, cell))?;
        let coordinates = |axis: usize| {
            let values: Vec<_> = (0..nodes[axis]).map(|i| Terrain::node(nodes, cell, i, axis)).collect();
            PyArray1::from_vec(py, values)
        };
        let mesh = py.import("numpy")?.call_method1("meshgrid", (coordinates(0), coordinates(1)))?;
        let heights = height.call1((mesh.get_item(0)?, mesh.get_item(1)?))?;
        let heights = shaped::<f64, 2>("heights of the function", &heights, [nodes[1], nodes[0]])?;
        made(py, || Terrain::from_heights(&heights, nodes, cell))
    }

    /// A terrain of a kind, the same for the same seed and parameters everywhere: "plane", "wave", "bowl", "noise", "bumps",
    /// "curb", "cobbles", "mix", "levels", "hills" or "posts". `terrain_kinds()` lists their parameters. `obstacles`
    /// are as for `with_obstacles`.
    #[staticmethod]
    #[pyo3(signature = (kind, seed=0, **parameters))]
    fn generate(
        py: Python<'_>,
        kind: &str,
        #[pyo3(from_py_with = whole)] seed: i64,
        parameters: Option<&Bound<'_, PyDict>>,
    ) -> PyResult<Self> {
        let seed = count("seed", seed, 0)? as u64;
        let (mut numbers, mut obstacles) = (Vec::new(), Vec::new());
        for (name, value) in parameters.into_iter().flatten() {
            let name: String = name.extract()?;
            if name == "obstacles" {
                obstacles = obstacles_of(&value)?;
                continue;
            }
            let value = real(&value).map_err(|_| PyTypeError::new_err(format!("{name} must be a number")))?;
            numbers.push((name, value));
        }
        let numbers: Vec<_> = numbers.iter().map(|(name, value)| (name.as_str(), *value)).collect();
        made(py, || Terrain::generate(kind, seed, &numbers)?.with_obstacles(&obstacles))
    }

    /// This terrain with more obstacles, each a dict of its `kind`, "post", "box" or "wall", and its parameters;
    /// `obstacle_kinds()` lists them. The models `contact` and `rigid` simulate them.
    ///
    /// Raises:
    ///     ValueError: a parameter outside its limit, or more than 4096 obstacles.
    fn with_obstacles(&self, py: Python<'_>, obstacles: &Bound<'_, PyAny>) -> PyResult<Self> {
        let more = obstacles_of(obstacles)?;
        made(py, || (*self.0).clone().with_obstacles(&more))
    }

    /// Its obstacles, each a dict as for `with_obstacles`.
    #[getter]
    fn obstacles<'py>(&self, py: Python<'py>) -> PyResult<Vec<Bound<'py, PyDict>>> {
        obstacle_dicts(py, self.0.obstacles().shapes())
    }

    /// Horizontal distance of `x` and `y` from the outline of the nearest obstacle, m, negative inside; infinite without
    /// obstacles.
    fn obstacle_distance<'py>(
        &self,
        py: Python<'py>,
        x: &Bound<'py, PyAny>,
        y: &Bound<'py, PyAny>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let obstacles = self.0.obstacles();
        mapped(py, x, y, |x, y, out| out.push(obstacles.aside([x, y])), 1)
    }

    /// Height at `x` and `y`, m: a number, or an array of their broadcast shape.
    fn height<'py>(
        &self,
        py: Python<'py>,
        x: &Bound<'py, PyAny>,
        y: &Bound<'py, PyAny>,
    ) -> PyResult<Bound<'py, PyAny>> {
        mapped(py, x, y, |x, y, out| out.push(self.0.height(x, y)), 1)
    }

    /// Upward unit normal of the ground at `x` and `y`, shape (..., 3).
    fn normal<'py>(
        &self,
        py: Python<'py>,
        x: &Bound<'py, PyAny>,
        y: &Bound<'py, PyAny>,
    ) -> PyResult<Bound<'py, PyAny>> {
        mapped(py, x, y, |x, y, out| out.extend(self.0.normal(x, y).iter()), 3)
    }

    /// Derivatives of the height by x and y at `x` and `y`, shape (..., 2).
    fn gradient<'py>(
        &self,
        py: Python<'py>,
        x: &Bound<'py, PyAny>,
        y: &Bound<'py, PyAny>,
    ) -> PyResult<Bound<'py, PyAny>> {
        mapped(py, x, y, |x, y, out| out.extend(self.0.gradient(x, y)), 2)
    }

    /// Angle between the ground at `x` and `y` and the horizontal plane, rad.
    fn slope_at<'py>(
        &self,
        py: Python<'py>,
        x: &Bound<'py, PyAny>,
        y: &Bound<'py, PyAny>,
    ) -> PyResult<Bound<'py, PyAny>> {
        mapped(py, x, y, |x, y, out| out.push(self.0.slope_at(x, y)), 1)
    }

    /// Principal curvatures at `x` and `y`, 1/m, shape (..., 2), the larger first: valleys are positive, crests negative.
    fn curvatures_at<'py>(
        &self,
        py: Python<'py>,
        x: &Bound<'py, PyAny>,
        y: &Bound<'py, PyAny>,
    ) -> PyResult<Bound<'py, PyAny>> {
        mapped(py, x, y, |x, y, out| out.extend(self.0.curvatures_at(x, y)), 2)
    }

    /// Whether `x` and `y` are on the terrain.
    fn contains(&self, #[pyo3(from_py_with = real)] x: f64, #[pyo3(from_py_with = real)] y: f64) -> bool {
        self.0.contains(x, y)
    }

    /// Steepest slope anywhere, rad.
    #[getter]
    fn slope(&self) -> f64 {
        self.0.slope()
    }

    /// Largest curvature of a valley and of a crest anywhere, 1/m. A ball can roll through valleys of at most half its
    /// own curvature.
    #[getter]
    fn curvature(&self) -> (f64, f64) {
        let [valley, crest] = self.0.curvature();
        (valley, crest)
    }

    /// Lengths along x and y, m; infinite for a plane.
    #[getter]
    fn size(&self) -> (f64, f64) {
        let [x, y] = self.0.half_size();
        (2.0 * x, 2.0 * y)
    }

    /// Heights at the nodes of a grid over the terrain, rows along y, and their distance, m; ValueError for a plane, which has
    /// no edges.
    #[pyo3(signature = (cell=None))]
    fn heights<'py>(&self, py: Python<'py>, cell: Option<f64>) -> PyResult<(Bound<'py, PyArray2<f64>>, f64)> {
        if self.0.as_plane().is_some() {
            return Err(PyValueError::new_err("a plane has no edges, and so no grid of heights"));
        }
        let [x, y] = self.0.half_size();
        let desired = cell.unwrap_or_else(|| self.0.surface().cell());
        let (nodes, cell) = call(|| Terrain::grid([2.0 * x, 2.0 * y], desired))?;
        let place = |i: usize, axis: usize| Terrain::node(nodes, cell, i, axis);
        let mut heights = Vec::new();
        try_reserve("the heights", &mut heights, nodes[0] * nodes[1]).map_err(to_python)?;
        for row in 0..nodes[1] {
            heights.extend((0..nodes[0]).map(|column| self.0.height(place(column, 0), place(row, 1))));
        }
        let heights = PyArray1::from_vec(py, heights).reshape([nodes[1], nodes[0]])?;
        Ok((heights, cell))
    }

    /// Arguments of `generate` for this terrain: a dict with `kind`, `seed` and all parameters, as the option `terrain`
    /// of environments takes it, with `obstacles` of `with_obstacles`; None for a terrain from heights or a function.
    #[getter]
    fn recipe<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyDict>>> {
        let Some(recipe) = self.0.recipe() else { return Ok(None) };
        let out = PyDict::new(py);
        out.set_item("kind", recipe.kind)?;
        out.set_item("seed", recipe.seed)?;
        for (name, value) in &recipe.parameters {
            out.set_item(name, value)?;
        }
        let added = self.0.added_obstacles();
        if !added.is_empty() {
            out.set_item("obstacles", obstacle_dicts(py, added)?)?;
        }
        Ok(Some(out))
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let restore = py.import("ballbot_rs._core")?.getattr("_terrain_of")?;
        if let Some(recipe) = self.recipe(py)? {
            return Ok((restore, (recipe,)).into_pyobject(py)?.into_any());
        }
        let surface = self.0.surface();
        let coefficients = PyArray1::from_slice(py, surface.coefficients());
        let [along, across] = surface.nodes();
        let obstacles = self.obstacles(py)?;
        Ok((restore, (coefficients, (along, across), surface.cell(), obstacles)).into_pyobject(py)?.into_any())
    }

    fn __repr__(&self) -> String {
        let name = self.0.recipe().map_or("heights", |recipe| recipe.kind);
        let ([x, y], [valley, crest]) = (self.0.half_size(), self.0.curvature());
        let obstacles = match self.0.obstacles().shapes().len() {
            0 => String::new(),
            1 => ", 1 obstacle".into(),
            count => format!(", {count} obstacles"),
        };
        format!(
            "Terrain({name}, {:.6} x {:.6} m, slope up to {:.3} rad, curvature from -{crest:.3} to {valley:.3} 1/m{obstacles})",
            2.0 * x,
            2.0 * y,
            self.0.slope()
        )
    }
}

/// Kinds of terrains by name, each a dict of the arguments of `Terrain.generate`.
///
/// ```python
/// print(sorted(bb.terrain_kinds()), bb.terrain_kinds()["bowl"])
/// ```
///
/// An argument has `default`, `unit`, `limit` and `doc`.
#[pyfunction]
pub(crate) fn terrain_kinds(py: Python<'_>) -> PyResult<Bound<'_, PyDict>> {
    let out = PyDict::new(py);
    for kind in TerrainKind::ALL {
        out.set_item(kind.name, parameters_of(py, (kind.parameters)())?)?;
    }
    Ok(out)
}

/// Kinds of obstacles by name, each a dict of the parameters that `Terrain.with_obstacles` takes.
///
/// ```python
/// print(bb.obstacle_kinds()["post"]["radius"])
/// ```
///
/// A parameter has `default`, `unit`, `limit` and `doc`.
#[pyfunction]
pub(crate) fn obstacle_kinds(py: Python<'_>) -> PyResult<Bound<'_, PyDict>> {
    let out = PyDict::new(py);
    for (name, parameters) in ballbot_core::terrain::obstacle_kinds() {
        out.set_item(name, parameters_of(py, parameters)?)?;
    }
    Ok(out)
}

fn parameters_of(py: Python<'_>, parameters: Vec<OptionDescription>) -> PyResult<Bound<'_, PyDict>> {
    let out = PyDict::new(py);
    for parameter in parameters {
        let one = PyDict::new(py);
        one.set_item("default", parameter.default[0])?;
        one.set_item("unit", parameter.unit)?;
        one.set_item("limit", parameter.limit)?;
        one.set_item("doc", parameter.doc)?;
        out.set_item(parameter.name, one)?;
    }
    Ok(out)
}

/// Obstacles from dicts.
fn obstacles_of(list: &Bound<'_, PyAny>) -> PyResult<Vec<Obstacle>> {
    let wrong = PyTypeError::new_err::<String>;
    let is_list = !list.is_instance_of::<PyDict>() && !list.is_instance_of::<PyString>();
    let items = list.try_iter().ok().filter(|_| is_list);
    let items = items.ok_or_else(|| wrong("obstacles must be a list of dicts".into()))?;
    let mut out = Vec::new();
    for (i, item) in items.enumerate() {
        let item = item?;
        let dict = item.cast::<PyMapping>().map_err(|_| wrong(format!("obstacles[{i}] must be a dict")))?;
        let (mut kind, mut numbers) = (None, Vec::new());
        for pair in dict.items()? {
            let (name, value): (Bound<'_, PyAny>, Bound<'_, PyAny>) = pair.extract()?;
            let name: String = name.extract().map_err(|_| wrong(format!("the keys of obstacles[{i}] are names")))?;
            if name == "kind" {
                let found = value.extract::<String>();
                kind = Some(found.map_err(|_| wrong(format!("'kind' of obstacles[{i}] must be a name")))?);
            } else {
                numbers.push((
                    real(&value).map_err(|_| wrong(format!("{name} of obstacles[{i}] must be a number")))?,
                    name,
                ));
            }
        }
        let kind = kind.ok_or_else(|| PyValueError::new_err(format!("obstacles[{i}] needs its 'kind'")))?;
        let numbers: Vec<_> = numbers.iter().map(|(value, name)| (name.as_str(), *value)).collect();
        out.push(Obstacle::named(&kind, &numbers).map_err(to_python)?);
    }
    Ok(out)
}

fn obstacle_dicts<'py>(py: Python<'py>, obstacles: &[Obstacle]) -> PyResult<Vec<Bound<'py, PyDict>>> {
    let dict = |obstacle: &Obstacle| {
        let out = PyDict::new(py);
        out.set_item("kind", obstacle.kind())?;
        for (name, value) in obstacle.parameters() {
            out.set_item(name, value)?;
        }
        Ok(out)
    };
    obstacles.iter().map(dict).collect()
}

/// The terrain of a recipe, or of the coefficients of its surface with the nodes along x and y, their distance, m, and its
/// obstacles.
#[pyfunction]
#[pyo3(signature = (source, nodes=(0, 0), cell=0.0, obstacles=None))]
pub(crate) fn _terrain_of(
    source: &Bound<'_, PyAny>,
    nodes: (usize, usize),
    cell: f64,
    obstacles: Option<&Bound<'_, PyAny>>,
) -> PyResult<PyTerrain> {
    if let Ok(recipe) = source.cast::<PyMapping>() {
        return of_recipe(recipe);
    }
    let coefficients = elements::<f64>("coefficients", source, &[None], 3 * MOST_NODES)?;
    let obstacles = obstacles.map(obstacles_of).transpose()?.unwrap_or_default();
    made(source.py(), || {
        Terrain::from_coefficients(&coefficients, [nodes.0, nodes.1], cell)?.with_obstacles(&obstacles)
    })
}

fn of_recipe(recipe: &Bound<'_, PyMapping>) -> PyResult<PyTerrain> {
    let parameters = PyDict::new(recipe.py());
    let (mut kind, mut seed) = (None, 0);
    for item in recipe.items()? {
        let wrong = |what: &str| PyTypeError::new_err(format!("terrain: {what}"));
        let (name, value): (Bound<'_, PyAny>, Bound<'_, PyAny>) = item.extract()?;
        let name: String = name.extract().map_err(|_| wrong("the keys of a dict are names"))?;
        match name.as_str() {
            "kind" => kind = Some(value.extract::<String>().map_err(|_| wrong("'kind' must be the name of a kind"))?),
            "seed" => seed = whole(&value).map_err(|_| wrong("'seed' must be a whole number"))?,
            "fingerprint" => {
                return Err(PyValueError::new_err(
                    "this terrain was made of heights or a function, which options do not keep: pass it as terrain=",
                ));
            }
            _ => parameters.set_item(name, value)?,
        }
    }
    let kind = kind.ok_or_else(|| PyValueError::new_err("terrain: a dict needs the name of a kind, 'kind'"))?;
    PyTerrain::generate(recipe.py(), &kind, seed, Some(&parameters))
}

/// A terrain from None (level ground), a `Terrain`, the name of a kind or a recipe.
pub(crate) fn terrain(value: &Bound<'_, PyAny>) -> PyResult<Option<Arc<Terrain>>> {
    if value.is_none() {
        return Ok(None);
    }
    if let Ok(terrain) = value.cast::<PyTerrain>() {
        return Ok(Some(Arc::clone(&terrain.get().0)));
    }
    if let Ok(recipe) = value.cast::<PyMapping>() {
        return of_recipe(recipe).map(|terrain| Some(terrain.0));
    }
    if value.extract::<PathBuf>().is_ok_and(|path| path.extension().is_some()) {
        let path = value.repr()?;
        return Err(PyValueError::new_err(format!(
            "terrain = {path} is a file: terrain=read_terrain({path}, cell=..., height=...) reads a picture of heights"
        )));
    }
    if let Ok(kind) = value.extract::<String>() {
        return PyTerrain::generate(value.py(), &kind, 0, None).map(|terrain| Some(terrain.0));
    }
    let kind = value.get_type().name()?;
    let expected = "a Terrain, the name of a kind, a dict of what generates one, or None";
    Err(PyTypeError::new_err(format!("terrain must be {expected}, not {kind}")))
}

/// A terrain in options: its recipe, or the fingerprint of its heights.
pub(crate) fn terrain_object<'py>(
    py: Python<'py>,
    terrain: Option<&Arc<Terrain>>,
) -> PyResult<Option<Bound<'py, PyDict>>> {
    let Some(terrain) = terrain else { return Ok(None) };
    let terrain = PyTerrain(Arc::clone(terrain));
    if let Some(recipe) = terrain.recipe(py)? {
        return Ok(Some(recipe));
    }
    let out = PyDict::new(py);
    out.set_item("fingerprint", format!("{:016x}", terrain.0.fingerprint()))?;
    Ok(Some(out))
}
