//! Point-to-point ICP.

use numpy::{PyArray2, PyReadonlyArray2};
use pyo3::prelude::*;
use trihedral_core::pair::point_to_point::{Limits, align};
use trihedral_core::spatial::kd_tree::Tree;

use crate::convert::{matrix, pose, rows};

/// What an alignment ended with.
#[pyclass(frozen, get_all)]
struct Alignment {
    /// (4, 4) ``b_from_a``.
    pose: Py<PyArray2<f64>>,
    /// Root mean square distance (m) of matched points; NaN if there are none.
    rmse: f64,
    /// Points that have a neighbour within the maximum correspondence distance.
    matched: usize,
    iterations: usize,
    converged: bool,
}

/// Aligns points `a` with points `b` from a start ``b_from_a``.
#[pyfunction]
#[pyo3(signature = (a, b, start, *, max_distance, iterations, translation, rotation))]
#[allow(clippy::too_many_arguments)]
fn align_points(
    py: Python<'_>,
    a: PyReadonlyArray2<f32>,
    b: PyReadonlyArray2<f32>,
    start: [[f64; 4]; 4],
    max_distance: f64,
    iterations: usize,
    translation: f64,
    rotation: f64,
) -> PyResult<Alignment> {
    let (a, b) = (rows::<f32, 3>(&a)?, rows::<f32, 3>(&b)?);
    let limits = Limits {
        max_distance,
        iterations,
        translation,
        rotation,
    };
    let found = py.detach(|| align(a, &Tree::new(b), &pose(&start), &limits));
    Ok(Alignment {
        pose: matrix(py, &found.pose),
        rmse: found.rmse,
        matched: found.matched,
        iterations: found.iterations,
        converged: found.converged,
    })
}

pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_class::<Alignment>()?;
    module.add_function(wrap_pyfunction!(align_points, module)?)
}
