//! The surface of a scan, and what pictures see of it.

use numpy::{PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use trihedral_core::range_image::{IndexImage, even_step};
use trihedral_core::texture::{Picture, Surface, draw};

use crate::convert::{array, rows};

/// A scan's points, connected where neighbouring beams met one surface; coordinates are centred on the scanner.
#[pyclass(frozen, name = "Surface")]
struct PySurface {
    surface: Surface,
}

#[pymethods]
impl PySurface {
    /// With a grid (`row`, `column`) or, without, over a spherical grid.
    #[new]
    #[pyo3(signature = (xyz, row, column))]
    fn new(
        py: Python<'_>,
        xyz: PyReadonlyArray2<f32>,
        row: Option<PyReadonlyArray1<i32>>,
        column: Option<PyReadonlyArray1<i32>>,
    ) -> PyResult<Self> {
        let xyz = rows::<f32, 3>(&xyz)?.to_vec();
        let grid = match (&row, &column) {
            (Some(row), Some(column)) => Some((row.as_slice()?, column.as_slice()?)),
            _ => None,
        };
        if grid.is_some_and(|(row, column)| row.len() != xyz.len() || column.len() != xyz.len()) {
            return Err(PyValueError::new_err(
                "points, rows and columns differ in number",
            ));
        }
        let surface = py.detach(|| {
            let image = grid
                .and_then(|(row, column)| IndexImage::from_grid(row, column))
                .unwrap_or_else(|| IndexImage::by_projection(&xyz, even_step(&xyz)));
            Surface::new(image, xyz)
        });
        Ok(Self { surface })
    }

    /// (N + V, 3) the scan's points in the order of the grid and, behind them, those put where a single beam was lost.
    #[getter]
    fn points<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<f32>> {
        array(py, &self.surface.points)
    }

    /// (N,) which of the given points each of the scan's is.
    #[getter]
    fn source<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<u32>> {
        PyArray1::from_slice(py, &self.surface.source)
    }

    /// Angle between neighbouring beams (rad).
    #[getter]
    fn step(&self) -> f64 {
        self.surface.step
    }

    /// Standard deviation of a range (m).
    #[getter]
    fn range_noise(&self) -> f64 {
        self.surface.range_noise
    }

    /// Indices of the points before a camera, and no farther from its axis than an angle of cosine `least` and `steps`
    /// steps between beams as they are seen from there.
    fn in_cone<'py>(
        &self,
        py: Python<'py>,
        centre: [f32; 3],
        axis: [f32; 3],
        least: f32,
        steps: f32,
    ) -> Bound<'py, PyArray1<u32>> {
        PyArray1::from_vec(
            py,
            py.detach(|| self.surface.in_cone(centre, axis, least, steps)),
        )
    }

    /// Distances (m) per pixel: of the surface that shows there, and of the nearest thing that may hide others.
    #[pyo3(signature = (centre, rays, pixels, distances, size, pixels_per_radian, period))]
    #[allow(clippy::too_many_arguments, clippy::type_complexity)]
    fn draw<'py>(
        &self,
        py: Python<'py>,
        centre: [f32; 3],
        rays: PyReadonlyArray2<f32>,
        pixels: PyReadonlyArray2<f32>,
        distances: PyReadonlyArray1<f32>,
        size: (usize, usize),
        pixels_per_radian: f32,
        period: Option<f32>,
    ) -> PyResult<(Bound<'py, PyArray2<f32>>, Bound<'py, PyArray2<f32>>)> {
        let (width, height) = size;
        let picture = Picture {
            width,
            height,
            centre,
            rays: rows::<f32, 3>(&rays)?,
            pixels: rows::<f32, 2>(&pixels)?,
            distances: distances.as_slice()?,
            pixels_per_radian,
            period,
        };
        if picture.rays.len() != width * height
            || picture.pixels.len() != self.surface.points.len()
            || picture.distances.len() != self.surface.points.len()
        {
            return Err(PyValueError::new_err(
                "one ray a pixel, one pixel and distance a point",
            ));
        }
        let depths = py.detach(|| draw(&self.surface, &picture));
        let shaped = |values: Vec<f32>| PyArray1::from_vec(py, values).reshape([height, width]);
        Ok((shaped(depths.surface)?, shaped(depths.nearest)?))
    }
}

pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_class::<PySurface>()
}
