//! The paper's final alignment: planes by RANSAC, point-to-point ICP, and the nearest neighbours of overlap.

use numpy::{PyArray1, PyReadonlyArray2};
use pyo3::prelude::*;
use rayon::prelude::*;
use trihedral_core::pair::point_to_point::{Limits, align};
use trihedral_core::pair::ransac_planes::{Search, planes};
use trihedral_core::spatial::kd_tree::Tree;

use crate::convert::{matrix, pose, rows};

type PyPlane<'py> = ([f64; 3], f64, f64, Bound<'py, PyArray1<u32>>);

/// Planes of points (N, 3), largest first: normal, distance, thickness, indices of the inliers.
#[pyfunction]
#[pyo3(signature = (points, *, tolerance, candidates, least, most, seed))]
fn segment_planes<'py>(
    py: Python<'py>,
    points: PyReadonlyArray2<'py, f32>,
    tolerance: f64,
    candidates: usize,
    least: usize,
    most: usize,
    seed: u64,
) -> PyResult<Vec<PyPlane<'py>>> {
    let points = rows::<f32, 3>(&points)?;
    let search = Search {
        tolerance,
        candidates,
        least,
        most,
        seed,
    };
    let found = py.detach(|| planes(points, &search));
    Ok(found
        .into_iter()
        .map(|plane| {
            (
                plane.normal,
                plane.distance,
                plane.thickness,
                PyArray1::from_vec(py, plane.inliers),
            )
        })
        .collect())
}

type Aligned = ([[f64; 4]; 4], f64, usize, usize, bool);

/// Points `a` onto points `b` from a start `b_from_a`: pose, rmse, matched, iterations, converged.
#[pyfunction]
#[pyo3(signature = (a, b, start, *, reach, iterations, translation, rotation))]
#[allow(clippy::too_many_arguments)]
fn align_points(
    py: Python<'_>,
    a: PyReadonlyArray2<f32>,
    b: PyReadonlyArray2<f32>,
    start: [[f64; 4]; 4],
    reach: f64,
    iterations: usize,
    translation: f64,
    rotation: f64,
) -> PyResult<Aligned> {
    let (a, b) = (rows::<f32, 3>(&a)?, rows::<f32, 3>(&b)?);
    let limits = Limits {
        reach,
        iterations,
        translation,
        rotation,
    };
    let found = py.detach(|| align(a, &Tree::new(b), &pose(&start), &limits));
    Ok((
        matrix(&found.pose),
        found.rmse,
        found.matched,
        found.iterations,
        found.converged,
    ))
}

/// Distance (m) from each of the queries (N, 3) to the nearest of the points; infinite where none is within reach.
#[pyfunction]
fn nearest_distances<'py>(
    py: Python<'py>,
    points: PyReadonlyArray2<'py, f32>,
    queries: PyReadonlyArray2<'py, f32>,
    reach: f32,
) -> PyResult<Bound<'py, PyArray1<f32>>> {
    let (points, queries) = (rows::<f32, 3>(&points)?, rows::<f32, 3>(&queries)?);
    let found = py.detach(|| {
        let tree = Tree::new(points);
        queries
            .par_iter()
            .map(|&query| {
                tree.nearest(query, reach)
                    .map_or(f32::INFINITY, |n| n.square.sqrt())
            })
            .collect()
    });
    Ok(PyArray1::from_vec(py, found))
}

pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_function(wrap_pyfunction!(segment_planes, module)?)?;
    module.add_function(wrap_pyfunction!(align_points, module)?)?;
    module.add_function(wrap_pyfunction!(nearest_distances, module)?)
}
