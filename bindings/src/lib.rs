//! The Python module `trihedral._core`: arrays in, arrays out, nothing else.

mod alignment;
mod camera;
mod convert;
mod e57;
mod formats;
mod pairs;
mod preparation;
mod rendering;
mod surf;
mod texture;

use pyo3::prelude::*;

#[pymodule]
fn _core(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add("__version__", env!("CARGO_PKG_VERSION"))?;
    formats::register(module)?;
    e57::register(module)?;
    pairs::register(module)?;
    camera::register(module)?;
    preparation::register(module)?;
    rendering::register(module)?;
    surf::register(module)?;
    alignment::register(module)?;
    texture::register(module)?;
    Ok(())
}
