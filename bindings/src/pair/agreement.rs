//! Whether poses are borne out by what both scanners saw.

use nalgebra::Isometry3;
use numpy::{PyArray2, PyArray3, PyArrayMethods};
use pyo3::prelude::*;
use trihedral_core::pair::agreement::{Shares, Tolerance, both_ways};
use trihedral_core::scan::surfel_map::KINDS;

use crate::convert::{array, pose};
use crate::scan::surfel_map::PySurfelMap;

/// Shares of the surface of `a`, as `b` sees it, then of `b`, as `a` sees it, under each pose.
#[pyclass(frozen, get_all)]
struct Agreements {
    /// (N, 2) on the other's surface, facing alike.
    agreeing: Py<PyArray2<f64>>,
    /// (N, 2) in space that the other saw through.
    conflicting: Py<PyArray2<f64>>,
    /// (N, 2) where the other saw a surface, but another one.
    near: Py<PyArray2<f64>>,
    /// (N, 2) agreeing, weighed so that surfaces of every facing count alike.
    holding: Py<PyArray2<f64>>,
    /// (N, 2, 3) agreeing and conflicting of each kind: loose, of a patch, static.
    agreeing_of: Py<PyArray3<f64>>,
    conflicting_of: Py<PyArray3<f64>>,
}

/// Compares `a` with `b` under poses ``b_from_a``.
#[pyfunction]
#[pyo3(signature = (a, b, poses, *, offset, margin, samples))]
fn agreement(
    py: Python<'_>,
    a: &PySurfelMap,
    b: &PySurfelMap,
    poses: Vec<[[f64; 4]; 4]>,
    offset: f64,
    margin: f64,
    samples: usize,
) -> PyResult<Agreements> {
    let tolerance = Tolerance {
        offset,
        margin,
        samples,
    };
    let found = py.detach(|| {
        let poses: Vec<Isometry3<f64>> = poses.iter().map(pose).collect();
        both_ways(&a.map, &b.map, &poses, &tolerance)
    });
    let shares = |value: fn(&Shares) -> f64| {
        let rows: Vec<[f64; 2]> = found
            .iter()
            .map(|both| [value(&both[0]), value(&both[1])])
            .collect();
        array(py, &rows).unbind()
    };
    let of_kinds = |value: fn(&Shares) -> [f64; KINDS]| {
        let rows: Vec<[f64; KINDS]> = found.iter().flatten().map(value).collect();
        let flat = array(py, &rows);
        flat.reshape([found.len(), 2, KINDS]).map(Bound::unbind)
    };
    Ok(Agreements {
        agreeing: shares(|s| s.agreeing),
        conflicting: shares(|s| s.conflicting),
        near: shares(|s| s.near),
        holding: shares(|s| s.holding),
        agreeing_of: of_kinds(|s| s.agreeing_of)?,
        conflicting_of: of_kinds(|s| s.conflicting_of)?,
    })
}

pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_class::<Agreements>()?;
    module.add_function(wrap_pyfunction!(agreement, module)?)
}
