//! Two prepared scans: placements, agreement, refinement.

use nalgebra::{Isometry3, Matrix3, Matrix6, Vector3};
use numpy::{PyArray1, PyArray2, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use rayon::prelude::*;
use trihedral_core::pair::agreement::{Tolerance, both_ways, outcomes};
use trihedral_core::pair::plan_correlation::{Plan, Upright, Wanted, placements};
use trihedral_core::pair::point_to_plane::{Fit, Stage, refine};
use trihedral_core::scan::free_space::{COLUMNS, Extremes, ROWS, Visibility};
use trihedral_core::scan::surfel_map::{COMPARED_SPACING, KINDS, Kind, Station};

use crate::convert::{array, matrix, pose, rows};

/// The elements of one prepared scan with their search tree, held for many comparisons.
#[pyclass(frozen, name = "Station")]
struct PyStation {
    station: Station,
    /// Points and normals that plans show beside the elements.
    wide: Vec<([f32; 3], [f32; 3])>,
}

#[pymethods]
impl PyStation {
    #[new]
    #[allow(clippy::too_many_arguments)]
    fn new(
        py: Python<'_>,
        points: PyReadonlyArray2<f32>,
        normals: PyReadonlyArray2<f32>,
        variances: PyReadonlyArray1<f32>,
        kinds: PyReadonlyArray1<u8>,
        spacing: f64,
        thin_points: PyReadonlyArray2<f32>,
        thin_variances: PyReadonlyArray1<f32>,
        areas: PyReadonlyArray1<f32>,
        wide_points: PyReadonlyArray2<f32>,
        wide_normals: PyReadonlyArray2<f32>,
        seen_nearest: PyReadonlyArray1<f32>,
        seen_farthest: PyReadonlyArray1<f32>,
    ) -> PyResult<Self> {
        let points = rows::<f32, 3>(&points)?.to_vec();
        let normals = rows::<f32, 3>(&normals)?.to_vec();
        let variances = variances.as_slice()?.to_vec();
        let kinds = kinds.as_slice()?.iter().map(|&kind| match kind {
            0 => Ok(Kind::Loose),
            1 => Ok(Kind::Patch),
            2 => Ok(Kind::Solid),
            _ => Err(PyValueError::new_err(format!(
                "{kind} is no kind of element"
            ))),
        });
        let kinds = kinds.collect::<PyResult<Vec<Kind>>>()?;
        let thin_points = rows::<f32, 3>(&thin_points)?.to_vec();
        let thin_variances = thin_variances.as_slice()?.to_vec();
        let areas = areas.as_slice()?.to_vec();
        let (wide_points, wide_normals) = (
            rows::<f32, 3>(&wide_points)?,
            rows::<f32, 3>(&wide_normals)?,
        );
        let seen = Extremes {
            nearest: seen_nearest.as_slice()?.to_vec(),
            farthest: seen_farthest.as_slice()?.to_vec(),
        };
        let cells = ROWS * COLUMNS;
        if normals.len() != points.len()
            || variances.len() != points.len()
            || kinds.len() != points.len()
            || thin_variances.len() != thin_points.len()
            || areas.len() != points.len() + thin_points.len()
            || wide_normals.len() != wide_points.len()
        {
            return Err(PyValueError::new_err(
                "points, normals, variances, kinds and areas differ in number",
            ));
        }
        if seen.nearest.len() != cells || seen.farthest.len() != cells {
            return Err(PyValueError::new_err(format!(
                "what was seen must have {cells} cells"
            )));
        }
        let wide = wide_points
            .iter()
            .zip(wide_normals)
            .map(|(&point, &normal)| (point, normal))
            .collect();
        let station = py.detach(|| {
            Station::new(
                points,
                normals,
                variances,
                kinds,
                spacing,
                Visibility::new(seen),
            )
            .with_thin(thin_points, thin_variances)
            .with_areas(areas)
        });
        Ok(Self { station, wide })
    }

    /// Surface of the elements (m^2).
    #[getter]
    fn area(&self) -> f64 {
        self.station.area()
    }

    fn __len__(&self) -> usize {
        self.station.finest().points.len()
    }
}

/// Steps of heading at which free space is looked up.
const HEADINGS: usize = 720;

/// About `samples` elements, and points on wide planes in the same proportion, turned upright.
fn upright(seen: &PyStation, turn: &[[f64; 3]; 3], samples: usize) -> Upright {
    let turn = Matrix3::from_fn(|row, column| turn[row][column]);
    let elements = seen.station.elements(COMPARED_SPACING);
    let step = (elements.points.len() / samples.max(1)).max(1);
    let turned = |v: &[f32; 3]| {
        let t = turn * Vector3::from(v.map(f64::from));
        [t.x as f32, t.y as f32, t.z as f32]
    };
    let near = elements.points.iter().zip(&elements.normals).step_by(step);
    let wide = seen.wide.iter().step_by(step).map(|(p, n)| (p, n));
    let (points, normals) = near
        .chain(wide)
        .map(|(p, n)| (turned(p), turned(n)))
        .unzip();
    Upright {
        free: seen.station.visibility.free_about_level(&turn, HEADINGS),
        points,
        normals,
    }
}

/// Placements of `a` on `b` after each is turned upright: (N, 5) of yaw, shift x, y, z and score.
#[pyfunction]
#[pyo3(signature = (a, b, upright_from_a, upright_from_b, yaws, *, cell, side, reach, samples, shifts, places, heights))]
#[allow(clippy::too_many_arguments)]
fn upright_placements<'py>(
    py: Python<'py>,
    a: &PyStation,
    b: &PyStation,
    upright_from_a: [[f64; 3]; 3],
    upright_from_b: [[f64; 3]; 3],
    yaws: PyReadonlyArray1<'py, f32>,
    cell: f32,
    side: usize,
    reach: f32,
    samples: usize,
    shifts: usize,
    places: usize,
    heights: usize,
) -> PyResult<Bound<'py, PyArray2<f32>>> {
    let yaws = yaws.as_slice()?;
    let found = py.detach(|| {
        let (a, b) = (
            upright(a, &upright_from_a, samples),
            upright(b, &upright_from_b, samples),
        );
        let wanted = Wanted {
            shifts,
            places,
            heights,
        };
        placements(&a, &b, yaws, Plan { cell, side, reach }, wanted)
    });
    let found: Vec<[f32; 5]> = found
        .iter()
        .map(|p| [p.yaw, p.shift[0], p.shift[1], p.shift[2], p.score])
        .collect();
    Ok(array(py, &found))
}

/// Columns of `agreement` for one station.
const SHARES: usize = 5 + 2 * KINDS;

/// Shares (agreeing, conflicting, hidden, near, holding, agreeing of each kind, conflicting of each kind) of `a` then of
/// `b` under each pose: (N, 22).
#[pyfunction]
#[pyo3(signature = (a, b, poses, *, offset, margin, samples))]
fn agreement<'py>(
    py: Python<'py>,
    a: &PyStation,
    b: &PyStation,
    poses: Vec<[[f64; 4]; 4]>,
    offset: f64,
    margin: f64,
    samples: usize,
) -> Bound<'py, PyArray2<f64>> {
    let found: Vec<[f64; 2 * SHARES]> = py.detach(|| {
        let poses: Vec<Isometry3<f64>> = poses.iter().map(pose).collect();
        both_ways(
            &a.station,
            &b.station,
            &poses,
            &Tolerance {
                offset,
                margin,
                samples,
            },
        )
        .iter()
        .map(|both| {
            let mut row = [0.0; 2 * SHARES];
            for (way, shares) in both.iter().enumerate() {
                let values = [
                    shares.agreeing,
                    shares.conflicting,
                    shares.hidden,
                    shares.near,
                    shares.holding,
                ];
                let values = values
                    .iter()
                    .chain(&shares.agreeing_of)
                    .chain(&shares.conflicting_of);
                for (place, value) in row[SHARES * way..].iter_mut().zip(values) {
                    *place = *value;
                }
            }
            row
        })
        .collect()
    });
    array(py, &found)
}

/// What becomes of each element of `a` under a pose: 0 unknown, 1 agreeing, 2 conflicting, 3 hidden, 4 near.
#[pyfunction]
#[pyo3(signature = (a, b, b_from_a, *, offset, margin))]
fn element_outcomes<'py>(
    py: Python<'py>,
    a: &PyStation,
    b: &PyStation,
    b_from_a: [[f64; 4]; 4],
    offset: f64,
    margin: f64,
) -> Bound<'py, PyArray1<u8>> {
    let found = py.detach(|| {
        let tolerance = Tolerance {
            offset,
            margin,
            samples: usize::MAX,
        };
        outcomes(&a.station, &b.station, &pose(&b_from_a), &tolerance)
            .map(|outcome| outcome as u8)
            .collect()
    });
    PyArray1::from_vec(py, found)
}

type Stages = Vec<(f64, usize, usize, bool)>;

fn stages(stages: &Stages) -> Vec<Stage> {
    stages
        .iter()
        .map(|&(reach, samples, iterations, by_variance)| Stage {
            reach,
            samples,
            iterations,
            by_variance,
        })
        .collect()
}

/// Poses refined from many starts, stages as (reach, samples, iterations, by_variance).
#[pyfunction]
fn refine_many(
    py: Python<'_>,
    a: &PyStation,
    b: &PyStation,
    starts: Vec<[[f64; 4]; 4]>,
    stages_: Stages,
) -> Vec<[[f64; 4]; 4]> {
    py.detach(|| {
        let stages = stages(&stages_);
        starts
            .par_iter()
            .map(|start| matrix(&refine(&a.station, &b.station, &pose(start), &stages).pose))
            .collect()
    })
}

type Refined<'py> = (
    [[f64; 4]; 4],
    Bound<'py, PyArray2<f64>>,
    Bound<'py, PyArray2<f64>>,
    usize,
    f64,
    Bound<'py, PyArray1<f32>>,
    bool,
);

/// One pose refined: pose, information and scatter (6, 6), places, chi-square, offsets, converged.
#[pyfunction]
fn refine_one<'py>(
    py: Python<'py>,
    a: &PyStation,
    b: &PyStation,
    start: [[f64; 4]; 4],
    stages_: Stages,
) -> Refined<'py> {
    let fit: Fit = py.detach(|| refine(&a.station, &b.station, &pose(&start), &stages(&stages_)));
    let nested = |m: &Matrix6<f64>| -> [[f64; 6]; 6] {
        std::array::from_fn(|row| std::array::from_fn(|column| m[(row, column)]))
    };
    (
        matrix(&fit.pose),
        array(py, &nested(&fit.information)),
        array(py, &nested(&fit.scatter)),
        fit.places,
        fit.chi_square,
        PyArray1::from_vec(py, fit.offsets),
        fit.converged,
    )
}

pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_class::<PyStation>()?;
    module.add_function(wrap_pyfunction!(upright_placements, module)?)?;
    module.add_function(wrap_pyfunction!(agreement, module)?)?;
    module.add_function(wrap_pyfunction!(element_outcomes, module)?)?;
    module.add_function(wrap_pyfunction!(refine_many, module)?)?;
    module.add_function(wrap_pyfunction!(refine_one, module)?)
}
