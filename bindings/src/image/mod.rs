//! Pictures: cameras, what they see of a scan, features.

mod camera;
mod scan_mesh;
mod surf;

use pyo3::prelude::*;

pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    camera::register(module)?;
    scan_mesh::register(module)?;
    surf::register(module)
}
