//! Point files: paths in, arrays out.

use std::fs::File;
use std::path::PathBuf;

use numpy::{PyArray1, PyArrayMethods};
use pyo3::create_exception;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use trihedral_core::formats::cloud::Cloud;
use trihedral_core::formats::error::FormatError;
use trihedral_core::formats::pcd;

create_exception!(
    _core,
    FileFormatError,
    PyValueError,
    "A file that cannot be used: (place, reason)."
);

pub fn raise(error: FormatError) -> PyErr {
    FileFormatError::new_err((error.place.to_string(), error.reason))
}

fn open(path: &PathBuf) -> Result<(File, u64), FormatError> {
    let file = File::open(path)?;
    let size = file.metadata()?.len();
    Ok((file, size))
}

pub fn vectors<'py, T: numpy::Element>(
    py: Python<'py>,
    values: Vec<T>,
    width: usize,
) -> PyResult<Bound<'py, PyAny>> {
    let rows = values.len() / width;
    Ok(PyArray1::from_vec(py, values)
        .reshape([rows, width])?
        .into_any())
}

fn cloud_to_dict<'py>(py: Python<'py>, cloud: Cloud) -> PyResult<Bound<'py, PyDict>> {
    let out = PyDict::new(py);
    out.set_item("xyz", vectors(py, cloud.xyz, 3)?)?;
    out.set_item("local_origin", cloud.local_origin)?;
    out.set_item("not_finite", cloud.not_finite)?;
    out.set_item("no_return", cloud.no_return)?;
    if cloud.channels.intensity {
        out.set_item("intensity", PyArray1::from_vec(py, cloud.intensity))?;
    }
    if cloud.channels.color {
        out.set_item("color", vectors(py, cloud.color, 3)?)?;
    }
    if cloud.channels.grid {
        out.set_item("row", PyArray1::from_vec(py, cloud.row))?;
        out.set_item("column", PyArray1::from_vec(py, cloud.column))?;
    }
    Ok(out)
}

#[pyfunction]
fn pcd_header<'py>(py: Python<'py>, path: PathBuf) -> PyResult<Bound<'py, PyDict>> {
    let header = py
        .detach(|| {
            let (file, size) = open(&path)?;
            pcd::read_header(file, size).map(|(header, _)| header)
        })
        .map_err(raise)?;
    let names: Vec<String> = header
        .fields
        .iter()
        .map(|field| field.name.clone())
        .collect();
    let channels = header.layout().map_err(raise)?.channels(header.height > 1);
    let out = PyDict::new(py);
    out.set_item("points", header.points)?;
    out.set_item("width", header.width)?;
    out.set_item("height", header.height)?;
    out.set_item("fields", names)?;
    out.set_item("viewpoint", header.viewpoint)?;
    out.set_item("intensity", channels.intensity)?;
    out.set_item("color", channels.color)?;
    Ok(out)
}

#[pyfunction]
fn pcd_read<'py>(
    py: Python<'py>,
    path: PathBuf,
    metres_per_unit: f64,
) -> PyResult<Bound<'py, PyDict>> {
    let (_, cloud) = py
        .detach(|| {
            let (file, size) = open(&path)?;
            pcd::read(file, size, metres_per_unit)
        })
        .map_err(raise)?;
    cloud_to_dict(py, cloud)
}

pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add("FileFormatError", module.py().get_type::<FileFormatError>())?;
    module.add_function(wrap_pyfunction!(pcd_header, module)?)?;
    module.add_function(wrap_pyfunction!(pcd_read, module)?)?;
    Ok(())
}
