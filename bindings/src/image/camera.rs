//! Lens models.

use numpy::{PyArray2, PyReadonlyArray2};
use pyo3::prelude::*;
use rayon::prelude::*;
use trihedral_core::image::camera::{Camera, Distortion, Lens};

use crate::convert::{array, rows};

/// How directions become pixels: see `trihedral.scan.CameraModel`.
#[pyclass(frozen, name = "Camera")]
pub struct PyCamera {
    pub camera: Camera,
}

#[pymethods]
impl PyCamera {
    #[staticmethod]
    fn pinhole(
        size: (usize, usize),
        focal: [f64; 2],
        centre: [f64; 2],
        coefficients: [f64; 5],
        fold: f64,
    ) -> Self {
        let distortion = Distortion { coefficients, fold };
        Self::new(
            Lens::Pinhole {
                focal,
                centre,
                distortion,
            },
            size,
        )
    }

    #[staticmethod]
    fn spherical(size: (usize, usize), pixel_angle: [f64; 2]) -> Self {
        Self::new(Lens::Spherical { pixel_angle }, size)
    }

    #[staticmethod]
    fn cylindrical(size: (usize, usize), pixel_angle: f64, focal: f64, centre: f64) -> Self {
        Self::new(
            Lens::Cylindrical {
                pixel_angle,
                focal,
                centre,
            },
            size,
        )
    }

    /// Pixels that an angle of one radian covers in the middle of the picture.
    #[getter]
    fn pixels_per_radian(&self) -> f64 {
        self.camera.pixels_per_radian()
    }

    /// (N, 2) column and row of points (N, 3) in camera coordinates; NaN for what the camera cannot see.
    fn project<'py>(
        &self,
        py: Python<'py>,
        xyz: PyReadonlyArray2<'py, f64>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let points = rows::<f64, 3>(&xyz)?;
        let pixel = |&point: &[f64; 3]| self.camera.project(point).unwrap_or([f64::NAN; 2]);
        let pixels: Vec<[f64; 2]> = py.detach(|| points.par_iter().map(pixel).collect());
        Ok(array(py, &pixels))
    }

    /// (N, 3) unit directions that pixels (N, 2) look along; NaN where no direction falls.
    fn rays<'py>(
        &self,
        py: Python<'py>,
        pixels: PyReadonlyArray2<'py, f64>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let pixels = rows::<f64, 2>(&pixels)?;
        let ray = |&pixel: &[f64; 2]| self.camera.ray(pixel).unwrap_or([f64::NAN; 3]);
        let rays: Vec<[f64; 3]> = py.detach(|| pixels.par_iter().map(ray).collect());
        Ok(array(py, &rays))
    }
}

impl PyCamera {
    fn new(lens: Lens, (width, height): (usize, usize)) -> Self {
        Self {
            camera: Camera::new(lens, width, height),
        }
    }
}

pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_class::<PyCamera>()
}
