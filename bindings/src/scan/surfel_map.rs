//! The surfels of a prepared scan in the form that pairs are compared in.

use numpy::{PyReadonlyArray1, PyReadonlyArray2};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use trihedral_core::scan::free_space::{COLUMNS, Extremes, FreeSpace, ROWS};
use trihedral_core::scan::surfel_map::{Kind, SurfelMap};

use crate::convert::rows;

/// The surfels of one prepared scan with their search grids, held for many comparisons.
#[pyclass(frozen, name = "SurfelMap")]
pub struct PySurfelMap {
    pub map: SurfelMap,
}

fn kind(number: u8) -> PyResult<Kind> {
    match number {
        0 => Ok(Kind::Loose),
        1 => Ok(Kind::Patch),
        2 => Ok(Kind::Static),
        _ => Err(PyValueError::new_err(format!(
            "{number} is no kind of surfel"
        ))),
    }
}

#[pymethods]
impl PySurfelMap {
    #[new]
    #[pyo3(signature = (
        *, points, normals, variances, kinds, spacing, thin_points, thin_variances, areas, sparse_points, sparse_normals,
        seen_nearest, seen_farthest,
    ))]
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
        sparse_points: PyReadonlyArray2<f32>,
        sparse_normals: PyReadonlyArray2<f32>,
        seen_nearest: PyReadonlyArray1<f32>,
        seen_farthest: PyReadonlyArray1<f32>,
    ) -> PyResult<Self> {
        let points = rows::<f32, 3>(&points)?.to_vec();
        let normals = rows::<f32, 3>(&normals)?.to_vec();
        let variances = variances.as_slice()?.to_vec();
        let kinds = kinds.as_slice()?.iter().map(|&number| kind(number));
        let kinds = kinds.collect::<PyResult<Vec<Kind>>>()?;
        let thin_points = rows::<f32, 3>(&thin_points)?.to_vec();
        let thin_variances = thin_variances.as_slice()?.to_vec();
        let areas = areas.as_slice()?.to_vec();
        let sparse_points = rows::<f32, 3>(&sparse_points)?;
        let sparse_normals = rows::<f32, 3>(&sparse_normals)?;
        let seen = Extremes {
            nearest: seen_nearest.as_slice()?.to_vec(),
            farthest: seen_farthest.as_slice()?.to_vec(),
        };
        if normals.len() != points.len()
            || variances.len() != points.len()
            || kinds.len() != points.len()
            || thin_variances.len() != thin_points.len()
            || areas.len() != points.len() + thin_points.len()
            || sparse_normals.len() != sparse_points.len()
        {
            return Err(PyValueError::new_err(
                "points, normals, variances, kinds and areas differ in number",
            ));
        }
        let cells = ROWS * COLUMNS;
        if seen.nearest.len() != cells || seen.farthest.len() != cells {
            return Err(PyValueError::new_err(format!(
                "what was seen must have {cells} cells"
            )));
        }
        let map = py.detach(|| {
            let free_space = FreeSpace::new(seen);
            let mut map = SurfelMap::new(points, normals, variances, kinds, spacing, free_space)
                .with_thin(thin_points, thin_variances)
                .with_areas(areas);
            let sparse = sparse_points
                .iter()
                .copied()
                .zip(sparse_normals.iter().copied());
            map.sparse_planes = sparse.collect();
            map
        });
        Ok(Self { map })
    }

    /// Surface of the surfels (m^2).
    #[getter]
    fn area(&self) -> f64 {
        self.map.area()
    }

    fn __len__(&self) -> usize {
        self.map.finest().points.len()
    }
}

pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_class::<PySurfelMap>()
}
