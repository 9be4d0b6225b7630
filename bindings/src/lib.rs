//! The Python module `trihedral._core`: arrays in, classes with named fields out, no policy.

mod convert;
mod e57;
mod formats;
mod image;
mod pair;
mod scan;
mod spatial;

use pyo3::prelude::*;

#[pymodule]
fn _core(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add("__version__", env!("CARGO_PKG_VERSION"))?;
    formats::register(module)?;
    e57::register(module)?;
    spatial::register(module)?;
    scan::register(module)?;
    image::register(module)?;
    pair::register(module)
}
