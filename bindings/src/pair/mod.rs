//! Two scans: where one may lie on the other, whether it does, and how well.

mod agreement;
mod plan_correlation;
mod point_to_plane;
mod point_to_point;
mod ransac_planes;

use pyo3::prelude::*;

pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    agreement::register(module)?;
    plan_correlation::register(module)?;
    point_to_plane::register(module)?;
    point_to_point::register(module)?;
    ransac_planes::register(module)
}
