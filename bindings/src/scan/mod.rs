//! One scan: its directions as a grid, its preparation, its surfels for comparison with others'.

mod prepare;
mod range_image;
pub mod surfel_map;

use pyo3::prelude::*;

pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    prepare::register(module)?;
    range_image::register(module)?;
    surfel_map::register(module)
}
