//! The surface of a scan, what pictures see of it, and the colours that points take from them.

use numpy::{PyArray1, PyArray2, PyArray3, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use trihedral_core::image::rasterizer::{Picture, draw, points_at};
use trihedral_core::image::scan_mesh::Surface;
use trihedral_core::image::texture::{Taken, blend, sample};
use trihedral_core::scan::range_image::{IndexImage, even_step};

use crate::convert::{array, rows, vector};
use crate::image::camera::PyCamera;

/// A scan's points, connected where neighbouring beams met one surface.
#[pyclass(frozen, name = "Surface")]
struct PySurface {
    surface: Surface,
}

/// Colours that points would take from one picture.
#[pyclass(frozen, name = "Sample")]
struct PySample {
    taken: Vec<Taken>,
}

/// What a camera sees.
#[pyclass(frozen, get_all)]
struct Drawing {
    /// (H, W) metres; infinite where no surface is known.
    distances: Py<PyArray2<f32>>,
    /// (H, W, 3) centred on the scanner; NaN where no surface is known.
    points: Py<PyArray3<f32>>,
    /// Colours that points take.
    sample: Py<PySample>,
}

/// Colours mixed from several pictures.
#[pyclass(frozen, get_all)]
struct Blend {
    /// (N, 3) of the given points, black where they take none.
    colors: Py<PyArray2<u8>>,
    /// (N,) whether they take one.
    colored: Py<PyArray1<bool>>,
}

#[pymethods]
impl PySample {
    fn __len__(&self) -> usize {
        self.taken.len()
    }

    /// (M,) every `stride`-th of the scan's points, counted in strides, and (M, 3) colours, where it takes one.
    fn every<'py>(
        &self,
        py: Python<'py>,
        stride: u32,
    ) -> (Bound<'py, PyArray1<u32>>, Bound<'py, PyArray2<f32>>) {
        let kept = self.taken.iter().filter(|one| one.point % stride == 0);
        let (at, colors): (Vec<u32>, Vec<[f32; 3]>) =
            kept.map(|one| (one.point / stride, one.color)).unzip();
        (PyArray1::from_vec(py, at), array(py, &colors))
    }
}

#[pymethods]
impl PySurface {
    /// With a grid (`row`, `column`) or, without, over a spherical grid about the scanner at `centre`.
    #[new]
    #[pyo3(signature = (xyz, centre, row, column))]
    fn new(
        py: Python<'_>,
        xyz: PyReadonlyArray2<f32>,
        centre: [f32; 3],
        row: Option<PyReadonlyArray1<i32>>,
        column: Option<PyReadonlyArray1<i32>>,
    ) -> PyResult<Self> {
        let xyz = rows::<f32, 3>(&xyz)?;
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
            let centred = |p: &[f32; 3]| std::array::from_fn(|k| p[k] - centre[k]);
            let points: Vec<[f32; 3]> = xyz.iter().map(centred).collect();
            let image = grid
                .and_then(|(row, column)| IndexImage::from_grid(row, column, &points))
                .unwrap_or_else(|| IndexImage::by_projection(&points, even_step(&points)));
            Surface::new(image, points)
        });
        Ok(Self { surface })
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

    /// What a camera sees, whose pose is from its axes to those centred on the scanner.
    fn draw(
        &self,
        py: Python<'_>,
        camera: &PyCamera,
        pose: [[f64; 4]; 4],
        rays: PyReadonlyArray2<f64>,
        image: PyReadonlyArray2<u8>,
        border: f32,
    ) -> PyResult<Drawing> {
        let camera = camera.camera;
        let picture = Picture {
            camera,
            rotation: nalgebra::Matrix3::from_fn(|row, column| pose[row][column]),
            centre: nalgebra::Vector3::from_fn(|row, _| pose[row][3]),
            rays: rows::<f64, 3>(&rays)?,
        };
        let image = rows::<u8, 3>(&image)?;
        if [picture.rays.len(), image.len()] != [camera.width * camera.height; 2] {
            return Err(PyValueError::new_err("one ray and one colour a pixel"));
        }
        let (depths, points, taken) = py.detach(|| {
            let drawing = draw(&self.surface, &picture);
            let depths = drawing.unhidden(&self.surface);
            let points = points_at(&picture, &depths);
            let taken = sample(&self.surface, &picture, &drawing, image, border);
            (depths, points, taken)
        });
        let (height, width) = (camera.height, camera.width);
        let depths = PyArray1::from_vec(py, depths).reshape([height, width])?;
        Ok(Drawing {
            distances: depths.unbind(),
            points: array(py, &points).reshape([height, width, 3])?.unbind(),
            sample: Py::new(py, PySample { taken })?,
        })
    }

    /// Colours of the given points; factors (P, 3) bring the pictures to one exposure.
    fn blend(&self, py: Python<'_>, samples: Vec<PyRef<PySample>>, gains: Vec<[f32; 3]>) -> Blend {
        let samples = samples.iter().map(|sample| sample.taken.as_slice());
        let pictures: Vec<(&[Taken], [f32; 3])> = samples.zip(gains).collect();
        let colors = py.detach(|| blend(&self.surface, &pictures));
        let colored = colors.iter().map(Option::is_some).collect();
        let colors: Vec<[u8; 3]> = colors.into_iter().map(Option::unwrap_or_default).collect();
        Blend {
            colors: array(py, &colors).unbind(),
            colored: vector(py, colored),
        }
    }
}

pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_class::<PySurface>()?;
    module.add_class::<PySample>()?;
    module.add_class::<Drawing>()?;
    module.add_class::<Blend>()
}
