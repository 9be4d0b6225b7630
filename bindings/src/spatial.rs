//! Points in space: nearest neighbours, and even samplings.

use numpy::{PyArray1, PyReadonlyArray2};
use pyo3::prelude::*;
use rayon::prelude::*;
use trihedral_core::spatial::hash_grid::thinned;
use trihedral_core::spatial::kd_tree::Tree;

use crate::convert::{rows, vector};

/// Distance (m) from each of the queries (N, 3) to the nearest of the points; infinite where none is nearer than
/// `max_distance`.
#[pyfunction]
fn nearest_distances(
    py: Python<'_>,
    points: PyReadonlyArray2<f32>,
    queries: PyReadonlyArray2<f32>,
    max_distance: f32,
) -> PyResult<Py<PyArray1<f32>>> {
    let (points, queries) = (rows::<f32, 3>(&points)?, rows::<f32, 3>(&queries)?);
    let found = py.detach(|| {
        let tree = Tree::new(points);
        queries
            .par_iter()
            .map(|&query| {
                tree.nearest(query, max_distance)
                    .map_or(f32::INFINITY, |n| n.square.sqrt())
            })
            .collect()
    });
    Ok(vector(py, found))
}

/// Rising indices of points (N, 3), one for each voxel of that edge (m) that has any: the one nearest to their mean.
#[pyfunction]
fn thin(
    py: Python<'_>,
    points: PyReadonlyArray2<f64>,
    spacing: f64,
) -> PyResult<Py<PyArray1<u32>>> {
    let points = rows::<f64, 3>(&points)?;
    Ok(vector(py, py.detach(|| thinned(points, spacing))))
}

pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_function(wrap_pyfunction!(nearest_distances, module)?)?;
    module.add_function(wrap_pyfunction!(thin, module)?)
}
