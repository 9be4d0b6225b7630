//! Whether poses are borne out by what both scanners saw.

use nalgebra::Isometry3;
use numpy::{IntoPyArray, PyArray1, PyArray2, PyArray3, PyArrayMethods};
use pyo3::prelude::*;
use trihedral_core::pair::agreement::{Compared, Shares, Tolerance, both_ways, compared};
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

/// Surfels and thin points of one station under a pose.
#[pyclass(frozen, get_all)]
struct ComparedSurfels {
    /// (N, 3) in the frame of their own station.
    points: Py<PyArray2<f32>>,
    /// (N,) 0 loose, 1 of a patch, 2 static.
    kind: Py<PyArray1<u8>>,
    /// (N,) 0 unknown, 1 agreeing, 2 conflicting, 3 hidden, 4 near.
    outcome: Py<PyArray1<u8>>,
    /// (N,) distance from the plane at hand of the other station and its standard deviation (m); NaN where there is none.
    offset: Py<PyArray1<f32>>,
    sigma: Py<PyArray1<f32>>,
}

/// What becomes of each compared surfel of `a` under ``b_from_a``.
#[pyfunction]
#[pyo3(signature = (a, b, b_from_a, *, offset, margin, samples))]
fn compare_surfels(
    py: Python<'_>,
    a: &PySurfelMap,
    b: &PySurfelMap,
    b_from_a: [[f64; 4]; 4],
    offset: f64,
    margin: f64,
    samples: usize,
) -> ComparedSurfels {
    let tolerance = Tolerance {
        offset,
        margin,
        samples,
    };
    let found = py.detach(|| compared(&a.map, &b.map, &pose(&b_from_a), &tolerance));
    let of = |value: fn(&Compared) -> f32| {
        let values: Vec<f32> = found.iter().map(value).collect();
        values.into_pyarray(py).unbind()
    };
    let code = |value: fn(&Compared) -> u8| {
        let values: Vec<u8> = found.iter().map(value).collect();
        values.into_pyarray(py).unbind()
    };
    let points: Vec<[f32; 3]> = found.iter().map(|one| one.point).collect();
    ComparedSurfels {
        points: array(py, &points).unbind(),
        kind: code(|one| one.kind as u8),
        outcome: code(|one| one.outcome as u8),
        offset: of(|one| one.offset),
        sigma: of(|one| one.sigma),
    }
}

pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_class::<Agreements>()?;
    module.add_class::<ComparedSurfels>()?;
    module.add_function(wrap_pyfunction!(compare_surfels, module)?)?;
    module.add_function(wrap_pyfunction!(agreement, module)?)
}
