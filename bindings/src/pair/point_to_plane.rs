//! Refinement, point to plane.

use nalgebra::Matrix6;
use numpy::{PyArray1, PyArray2};
use pyo3::prelude::*;
use rayon::prelude::*;
use trihedral_core::pair::point_to_plane::{self as kernel, refine};

use crate::convert::{array, matrix, pose, vector};
use crate::scan::surfel_map::PySurfelMap;

/// One stage of a refinement.
#[pyclass(frozen, get_all, skip_from_py_object)]
#[derive(Clone, Copy)]
struct Stage {
    /// Maximum correspondence distance (m).
    max_distance: f64,
    /// Surfels of each station that take part, evenly drawn.
    samples: usize,
    iterations: usize,
    /// Weigh by the surfels' variances instead of alike.
    by_variance: bool,
}

#[pymethods]
impl Stage {
    #[new]
    fn new(max_distance: f64, samples: usize, iterations: usize, by_variance: bool) -> Self {
        Self {
            max_distance,
            samples,
            iterations,
            by_variance,
        }
    }
}

/// What a refinement ended with.
#[pyclass(frozen, get_all)]
struct Fit {
    /// (4, 4) ``b_from_a``.
    pose: Py<PyArray2<f64>>,
    /// (6, 6) normal matrix of (rotation, translation) on the left of the pose, the two ways counted once.
    information: Py<PyArray2<f64>>,
    /// (6, 6) sum over places of the outer product of their gradients, both ways.
    scatter: Py<PyArray2<f64>>,
    /// How many places were compared.
    places: usize,
    /// (6, 6) sum over planes of the outer product of the gradients (per m) of a plane that is off as a whole, both ways.
    planes: Py<PyArray2<f64>>,
    /// Weighted mean square of the offsets over their variances.
    chi_square: f64,
    /// (N,) signed offsets along the normal (m).
    offsets: Py<PyArray1<f32>>,
}

fn stages_of(stages: &[PyRef<Stage>]) -> Vec<kernel::Stage> {
    let stage = |stage: &PyRef<Stage>| kernel::Stage {
        max_distance: stage.max_distance,
        samples: stage.samples,
        iterations: stage.iterations,
        by_variance: stage.by_variance,
    };
    stages.iter().map(stage).collect()
}

/// Poses ``b_from_a`` refined from many starts.
#[pyfunction]
fn refine_many(
    py: Python<'_>,
    a: &PySurfelMap,
    b: &PySurfelMap,
    starts: Vec<[[f64; 4]; 4]>,
    stages: Vec<PyRef<Stage>>,
) -> Vec<Py<PyArray2<f64>>> {
    let stages = stages_of(&stages);
    let refined: Vec<_> = py.detach(|| {
        let refined = |start| refine(&a.map, &b.map, &pose(start), &stages).pose;
        starts.par_iter().map(refined).collect()
    });
    refined.iter().map(|pose| matrix(py, pose)).collect()
}

/// One pose ``b_from_a`` refined.
#[pyfunction]
fn refine_one(
    py: Python<'_>,
    a: &PySurfelMap,
    b: &PySurfelMap,
    start: [[f64; 4]; 4],
    stages: Vec<PyRef<Stage>>,
) -> Fit {
    let stages = stages_of(&stages);
    let fit = py.detach(|| refine(&a.map, &b.map, &pose(&start), &stages));
    let square = |m: &Matrix6<f64>| {
        let rows: [[f64; 6]; 6] =
            std::array::from_fn(|row| std::array::from_fn(|column| m[(row, column)]));
        array(py, &rows).unbind()
    };
    Fit {
        pose: matrix(py, &fit.pose),
        information: square(&fit.information),
        scatter: square(&fit.scatter),
        places: fit.places,
        planes: square(&fit.planes),
        chi_square: fit.chi_square,
        offsets: vector(py, fit.offsets),
    }
}

pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_class::<Stage>()?;
    module.add_class::<Fit>()?;
    module.add_function(wrap_pyfunction!(refine_many, module)?)?;
    module.add_function(wrap_pyfunction!(refine_one, module)?)
}
