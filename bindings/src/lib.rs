//! The Python module `trihedral._core`: arrays in, arrays out, nothing else.

mod e57;
mod formats;

use pyo3::prelude::*;

#[pymodule]
fn _core(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add("__version__", env!("CARGO_PKG_VERSION"))?;
    formats::register(module)?;
    e57::register(module)?;
    Ok(())
}
