//! Placements by the plans of two scans.

use nalgebra::Matrix3;
use numpy::{PyArray1, PyArray2, PyReadonlyArray1};
use pyo3::prelude::*;
use trihedral_core::pair::plan_correlation::{Plan, Upright, Wanted, placements};

use crate::convert::{array, vector};
use crate::scan::surfel_map::PySurfelMap;

/// Motions of one upright scan onto another.
#[pyclass(frozen, get_all)]
struct Placements {
    /// (N,) radians about the vertical.
    yaws: Py<PyArray1<f32>>,
    /// (N, 3) metres.
    shifts: Py<PyArray2<f32>>,
    /// (N,) correlation of the plans times the share of heights that meet.
    scores: Py<PyArray1<f32>>,
}

/// Placements of `a` on `b` after each is turned upright.
#[pyfunction]
#[pyo3(signature = (
    a, b, upright_from_a, upright_from_b, yaws, *, cell, side, farthest, samples, shifts, places, heights,
))]
#[allow(clippy::too_many_arguments)]
fn upright_placements(
    py: Python<'_>,
    a: &PySurfelMap,
    b: &PySurfelMap,
    upright_from_a: [[f64; 3]; 3],
    upright_from_b: [[f64; 3]; 3],
    yaws: PyReadonlyArray1<f32>,
    cell: f32,
    side: usize,
    farthest: f32,
    samples: usize,
    shifts: usize,
    places: usize,
    heights: usize,
) -> PyResult<Placements> {
    let yaws = yaws.as_slice()?;
    let found = py.detach(|| {
        let upright = |seen: &PySurfelMap, turn: &[[f64; 3]; 3]| {
            let turn = Matrix3::from_fn(|row, column| turn[row][column]);
            Upright::new(&seen.map, &turn, samples)
        };
        let plan = Plan {
            cell,
            side,
            farthest,
        };
        let wanted = Wanted {
            shifts,
            places,
            heights,
        };
        let (a, b) = (upright(a, &upright_from_a), upright(b, &upright_from_b));
        placements(&a, &b, yaws, plan, wanted)
    });
    let shifts: Vec<[f32; 3]> = found.iter().map(|placement| placement.shift).collect();
    Ok(Placements {
        yaws: vector(py, found.iter().map(|placement| placement.yaw).collect()),
        shifts: array(py, &shifts).unbind(),
        scores: vector(py, found.iter().map(|placement| placement.score).collect()),
    })
}

pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_class::<Placements>()?;
    module.add_function(wrap_pyfunction!(upright_placements, module)?)
}
