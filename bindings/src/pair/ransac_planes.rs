//! Planes by RANSAC.

use numpy::{PyArray1, PyReadonlyArray2};
use pyo3::prelude::*;
use trihedral_core::pair::ransac_planes::{Search, planes};

use crate::convert::{rows, vector};

/// A plane ``normal . x = distance`` and the points on it.
#[pyclass(frozen, get_all)]
struct PlaneSegment {
    /// (3,) unit vector.
    normal: Py<PyArray1<f64>>,
    /// Metres, not negative.
    distance: f64,
    /// Standard deviation of the points across the plane (m).
    thickness: f64,
    /// (N,) rising indices of its points.
    inliers: Py<PyArray1<u32>>,
}

/// Planes of points (N, 3), largest first.
#[pyfunction]
#[pyo3(signature = (points, *, tolerance, candidates, least, most, seed))]
fn segment_planes(
    py: Python<'_>,
    points: PyReadonlyArray2<f32>,
    tolerance: f64,
    candidates: usize,
    least: usize,
    most: usize,
    seed: u64,
) -> PyResult<Vec<PlaneSegment>> {
    let points = rows::<f32, 3>(&points)?;
    let search = Search {
        tolerance,
        candidates,
        least,
        most,
        seed,
    };
    let found = py.detach(|| planes(points, &search));
    let segments = found.into_iter().map(|plane| PlaneSegment {
        normal: vector(py, plane.normal.to_vec()),
        distance: plane.distance,
        thickness: plane.thickness,
        inliers: vector(py, plane.inliers),
    });
    Ok(segments.collect())
}

pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_class::<PlaneSegment>()?;
    module.add_function(wrap_pyfunction!(segment_planes, module)?)
}
