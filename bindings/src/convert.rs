//! NumPy arrays to and from the shapes that the kernels use.

use nalgebra::{Isometry3, Matrix3, Matrix4, Rotation3, Translation3, UnitQuaternion, Vector3};
use numpy::{PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

/// Rows of a C-contiguous (N, K) array.
pub fn rows<'a, T: numpy::Element + Copy, const K: usize>(
    array: &'a PyReadonlyArray2<T>,
) -> PyResult<&'a [[T; K]]> {
    if array.shape()[1] != K {
        return Err(PyValueError::new_err(format!(
            "expected {K} columns, got {}",
            array.shape()[1]
        )));
    }
    let flat = array
        .as_slice()
        .map_err(|_| PyValueError::new_err("the array must be C-contiguous"))?;
    Ok(flat.as_chunks::<K>().0)
}

/// An (N, K) array from rows.
pub fn array<'py, T: numpy::Element + Copy, const K: usize>(
    py: Python<'py>,
    rows: &[[T; K]],
) -> Bound<'py, PyArray2<T>> {
    PyArray1::from_slice(py, rows.as_flattened())
        .reshape([rows.len(), K])
        .expect("rows times columns elements")
}

/// A rigid motion from a 4x4 array.
pub fn pose(matrix: &[[f64; 4]; 4]) -> Isometry3<f64> {
    let m = matrix;
    let rotation = Matrix3::new(
        m[0][0], m[0][1], m[0][2], m[1][0], m[1][1], m[1][2], m[2][0], m[2][1], m[2][2],
    );
    let rotation =
        UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(rotation));
    Isometry3::from_parts(
        Translation3::from(Vector3::new(m[0][3], m[1][3], m[2][3])),
        rotation,
    )
}

/// A 4x4 array from a rigid motion.
pub fn matrix(py: Python<'_>, pose: &Isometry3<f64>) -> Py<PyArray2<f64>> {
    let m: Matrix4<f64> = pose.to_homogeneous();
    let rows: [[f64; 4]; 4] =
        std::array::from_fn(|row| std::array::from_fn(|column| m[(row, column)]));
    array(py, &rows).unbind()
}

/// An (N,) array.
pub fn vector<T: numpy::Element>(py: Python<'_>, values: Vec<T>) -> Py<PyArray1<T>> {
    PyArray1::from_vec(py, values).unbind()
}
