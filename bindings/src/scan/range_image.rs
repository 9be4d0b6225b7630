//! A scan as an image of point indices, for rendering.

use numpy::{PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use trihedral_core::scan::range_image::{IndexImage, NO_POINT, depth_edges};

use crate::convert::rows;

/// A scan's points on a grid of directions.
#[pyclass(frozen, get_all)]
struct DirectionGrid {
    /// (H, W) index of the point in each cell; -1 for none.
    points: Py<PyArray2<i64>>,
    /// (H, W) whether ranges jump there.
    edges: Py<PyArray2<bool>>,
}

/// The scanner's own grid; `None` where it is no grid.
#[pyfunction]
fn scanned_grid(
    py: Python<'_>,
    xyz: PyReadonlyArray2<f32>,
    row: PyReadonlyArray1<i32>,
    column: PyReadonlyArray1<i32>,
) -> PyResult<Option<DirectionGrid>> {
    let xyz = rows::<f32, 3>(&xyz)?;
    let (row, column) = (row.as_slice()?, column.as_slice()?);
    if row.len() != xyz.len() || column.len() != xyz.len() {
        return Err(PyValueError::new_err(
            "points, rows and columns differ in number",
        ));
    }
    let image = py.detach(|| IndexImage::from_grid(row, column, xyz));
    image.map(|image| grid(py, &image, xyz)).transpose()
}

/// A spherical grid with cells of `step` radians: row 0 at the nadir, column 0 at azimuth -180 degrees.
#[pyfunction]
fn projected_grid(
    py: Python<'_>,
    xyz: PyReadonlyArray2<f32>,
    step: f64,
) -> PyResult<DirectionGrid> {
    let xyz = rows::<f32, 3>(&xyz)?;
    if !(step > 0.0 && step.is_finite()) {
        return Err(PyValueError::new_err("the step must be positive"));
    }
    let image = py.detach(|| IndexImage::by_projection(xyz, step));
    grid(py, &image, xyz)
}

fn grid(py: Python<'_>, image: &IndexImage, xyz: &[[f32; 3]]) -> PyResult<DirectionGrid> {
    let edges = py.detach(|| depth_edges(image, xyz).on_edge);
    let point = |&cell: &u32| {
        if cell == NO_POINT {
            -1
        } else {
            i64::from(cell)
        }
    };
    let cells: Vec<i64> = image.cells.iter().map(point).collect();
    let shape = [image.rows, image.columns];
    Ok(DirectionGrid {
        points: PyArray1::from_vec(py, cells).reshape(shape)?.unbind(),
        edges: PyArray1::from_vec(py, edges).reshape(shape)?.unbind(),
    })
}

pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_class::<DirectionGrid>()?;
    module.add_function(wrap_pyfunction!(scanned_grid, module)?)?;
    module.add_function(wrap_pyfunction!(projected_grid, module)?)
}
