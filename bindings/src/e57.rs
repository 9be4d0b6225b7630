//! E57 files: arrays and descriptions in and out.

use std::fs::File;
use std::io::{self, BufWriter};
use std::path::PathBuf;

use numpy::{PyArray1, PyReadonlyArray1, PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::exceptions::{PyIndexError, PyOSError, PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict};
use trihedral_core::formats::e57;
use trihedral_core::formats::error::FormatError;

use crate::formats::{raise, vectors};

/// An OSError of the right kind, with its number where there is one.
fn os_error(error: io::Error) -> PyErr {
    match error.raw_os_error() {
        Some(code) => PyOSError::new_err((code, io::Error::from_raw_os_error(code).to_string())),
        None => PyOSError::new_err(error.to_string()),
    }
}

fn entry<T>(entries: &[e57::Entry<T>], index: usize) -> PyResult<&T> {
    let entry = entries
        .get(index)
        .ok_or_else(|| PyIndexError::new_err(index))?;
    entry
        .as_ref()
        .map_err(|reason| raise(FormatError::whole(reason.clone())))
}

fn pose<'py>(py: Python<'py>, pose: Option<e57::Pose>) -> PyResult<Option<Bound<'py, PyDict>>> {
    pose.map(|pose| {
        let out = PyDict::new(py);
        out.set_item("quaternion", pose.quaternion)?;
        out.set_item("translation", pose.translation)?;
        Ok(out)
    })
    .transpose()
}

fn scan_dict<'py>(py: Python<'py>, scan: &e57::ScanInfo) -> PyResult<Bound<'py, PyDict>> {
    let fields: Vec<&str> = scan
        .fields
        .iter()
        .map(|field| field.name.as_str())
        .collect();
    let out = PyDict::new(py);
    out.set_item("guid", &scan.guid)?;
    out.set_item("name", &scan.name)?;
    out.set_item("points", scan.records)?;
    out.set_item("fields", fields)?;
    out.set_item("pose", pose(py, scan.pose)?)?;
    out.set_item("index_bounds", scan.index_bounds)?;
    out.set_item("extras", &scan.extras)?;
    Ok(out)
}

fn image_dict<'py>(py: Python<'py>, image: &e57::ImageInfo) -> PyResult<Bound<'py, PyDict>> {
    let out = PyDict::new(py);
    out.set_item("guid", &image.guid)?;
    out.set_item("name", &image.name)?;
    out.set_item("scan_guid", &image.scan_guid)?;
    out.set_item("pose", pose(py, image.pose)?)?;
    out.set_item("kind", image.kind)?;
    out.set_item("png", image.png)?;
    out.set_item("width", image.width)?;
    out.set_item("height", image.height)?;
    let model = PyDict::new(py);
    for (name, value) in &image.model {
        model.set_item(name, value)?;
    }
    out.set_item("model", model)?;
    Ok(out)
}

/// What a file says of itself, kept for reading parts of it.
#[pyclass(frozen)]
struct E57File {
    path: PathBuf,
    found: e57::Description,
}

#[pymethods]
impl E57File {
    #[new]
    fn new(py: Python<'_>, path: PathBuf) -> PyResult<Self> {
        let found = py
            .detach(|| e57::describe(File::open(&path)?))
            .map_err(raise)?;
        Ok(Self { path, found })
    }

    /// Scans and pictures (each a dict, or a str that says what is wrong with it), extensions (prefix, address).
    fn describe<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let mut scans: Vec<Bound<PyAny>> = Vec::new();
        for scan in &self.found.scans {
            scans.push(match scan {
                Ok(scan) => scan_dict(py, scan)?.into_any(),
                Err(reason) => reason.into_pyobject(py)?.into_any(),
            });
        }
        let mut images: Vec<Bound<PyAny>> = Vec::new();
        for image in &self.found.images {
            images.push(match image {
                Ok(image) => image_dict(py, image)?.into_any(),
                Err(reason) => reason.into_pyobject(py)?.into_any(),
            });
        }
        let out = PyDict::new(py);
        out.set_item("scans", scans)?;
        out.set_item("images", images)?;
        out.set_item("extensions", &self.found.extensions)?;
        Ok(out)
    }

    /// The valid points of one scan.
    fn read_points<'py>(
        &self,
        py: Python<'py>,
        scan_index: usize,
        metres_per_unit: f64,
    ) -> PyResult<Bound<'py, PyDict>> {
        let scan = entry(&self.found.scans, scan_index)?;
        let points = py
            .detach(|| e57::read_points(File::open(&self.path)?, scan, metres_per_unit))
            .map_err(raise)?;
        let out = PyDict::new(py);
        out.set_item("xyz", vectors(py, points.xyz, 3)?)?;
        out.set_item("local_origin", points.local_origin)?;
        if let Some(values) = points.intensity {
            out.set_item("intensity", PyArray1::from_vec(py, values))?;
        }
        if let Some(values) = points.color {
            out.set_item("color", vectors(py, values, 3)?)?;
        }
        if let (Some(rows), Some(columns)) = (points.row, points.column) {
            out.set_item("row", PyArray1::from_vec(py, rows))?;
            out.set_item("column", PyArray1::from_vec(py, columns))?;
        }
        out.set_item("invalid", points.invalid)?;
        out.set_item("not_finite", points.not_finite)?;
        out.set_item("no_return", points.no_return)?;
        out.set_item("intensity_by_extremes", points.intensity_by_extremes)?;
        out.set_item("color_by_extremes", points.color_by_extremes)?;
        Ok(out)
    }

    /// The encoded bytes of one picture.
    fn read_image<'py>(
        &self,
        py: Python<'py>,
        image_index: usize,
    ) -> PyResult<Bound<'py, PyBytes>> {
        let image = entry(&self.found.images, image_index)?;
        let data = py
            .detach(|| e57::read_image(File::open(&self.path)?, image))
            .map_err(raise)?;
        Ok(PyBytes::new(py, &data))
    }
}

fn matrix(array: Option<PyReadonlyArray2<f64>>) -> PyResult<Option<e57::Matrix>> {
    array
        .map(|array| {
            if array.shape() != [4, 4] {
                return Err(PyValueError::new_err("a pose is a 4x4 matrix"));
            }
            let view = array.as_array();
            Ok(std::array::from_fn(|row| {
                std::array::from_fn(|column| view[[row, column]])
            }))
        })
        .transpose()
}

fn slice<'a, T: numpy::Element>(
    array: &'a Option<PyReadonlyArray1<T>>,
    length: usize,
) -> PyResult<Option<&'a [T]>> {
    array
        .as_ref()
        .map(|array| {
            let values = array.as_slice()?;
            if values.len() != length {
                return Err(PyValueError::new_err("arrays of different lengths"));
            }
            Ok(values)
        })
        .transpose()
}

#[derive(FromPyObject)]
enum Flat<'py> {
    Single(PyReadonlyArray1<'py, f32>),
    Double(PyReadonlyArray1<'py, f64>),
}

/// Writes one E57 file, scan after scan; arrays are flat and contiguous.
#[pyclass]
struct E57Writer(Option<e57::Writer>);

impl E57Writer {
    fn open(&mut self) -> PyResult<&mut e57::Writer> {
        self.0
            .as_mut()
            .ok_or_else(|| PyValueError::new_err("the file is finished"))
    }
}

#[pymethods]
impl E57Writer {
    #[new]
    fn new(path: PathBuf) -> PyResult<Self> {
        let writer = e57::Writer::create(&path).map_err(os_error)?;
        Ok(Self(Some(writer)))
    }

    /// Names the coordinate reference system.
    fn set_coordinates(&mut self, text: &str) -> PyResult<()> {
        self.open()?.set_coordinates(text);
        Ok(())
    }

    /// `step` (metres) asks for scaled integers; it needs float64 coordinates.
    #[pyo3(signature = (name, guid, pose, xyz, step, intensity, color, row, column, invalid))]
    #[allow(clippy::too_many_arguments)]
    fn add_scan(
        &mut self,
        py: Python<'_>,
        name: &str,
        guid: &str,
        pose: Option<PyReadonlyArray2<f64>>,
        xyz: Flat,
        step: Option<f64>,
        intensity: Option<PyReadonlyArray1<f32>>,
        color: Option<PyReadonlyArray1<u8>>,
        row: Option<PyReadonlyArray1<i32>>,
        column: Option<PyReadonlyArray1<i32>>,
        invalid: Option<PyReadonlyArray1<bool>>,
    ) -> PyResult<()> {
        let xyz = match (&xyz, step) {
            (Flat::Single(array), None) => e57::Coordinates::Single(array.as_slice()?),
            (Flat::Double(array), None) => e57::Coordinates::Double(array.as_slice()?),
            (Flat::Double(array), Some(step)) => e57::Coordinates::Scaled(array.as_slice()?, step),
            (Flat::Single(_), Some(_)) => {
                return Err(PyTypeError::new_err(
                    "scaled coordinates are made of float64",
                ));
            }
        };
        let count = xyz.len();
        let scan = e57::ScanData {
            name,
            guid,
            pose: matrix(pose)?,
            intensity: slice(&intensity, count)?,
            color: slice(&color, 3 * count)?,
            grid: slice(&row, count)?.zip(slice(&column, count)?),
            invalid: slice(&invalid, count)?,
            xyz,
        };
        let writer = self.open()?;
        py.detach(|| writer.add_scan(&scan)).map_err(os_error)
    }

    /// `model` holds the numbers of `kind` in E57's own terms, in the order of `PhotoModel`.
    #[pyo3(signature = (name, guid, scan_guid, pose, png, data, size, kind, model))]
    #[allow(clippy::too_many_arguments)]
    fn add_photo(
        &mut self,
        py: Python<'_>,
        name: &str,
        guid: &str,
        scan_guid: &str,
        pose: Option<PyReadonlyArray2<f64>>,
        png: bool,
        data: &[u8],
        size: (u32, u32),
        kind: &str,
        model: Vec<f64>,
    ) -> PyResult<()> {
        let model = match (kind, model.as_slice()) {
            ("visual-reference", []) => e57::PhotoModel::VisualReference,
            ("pinhole", &[focal, width, height, x, y]) => e57::PhotoModel::Pinhole {
                focal,
                pixel: [width, height],
                principal: [x, y],
            },
            ("spherical", &[width, height]) => e57::PhotoModel::Spherical {
                pixel: [width, height],
            },
            ("cylindrical", &[radius, width, height, principal_y]) => {
                e57::PhotoModel::Cylindrical {
                    radius,
                    pixel: [width, height],
                    principal_y,
                }
            }
            _ => {
                return Err(PyValueError::new_err(format!(
                    "no such camera model: {kind}"
                )));
            }
        };
        let photo = e57::Photo {
            name,
            guid,
            scan_guid,
            pose: matrix(pose)?,
            png,
            data,
            width: size.0,
            height: size.1,
            model,
        };
        let writer = self.open()?;
        py.detach(|| writer.add_photo(&photo)).map_err(os_error)
    }

    /// Completes the file.
    fn finish(&mut self, py: Python<'_>, guid: &str) -> PyResult<()> {
        self.open()?;
        let writer = self.0.take();
        py.detach(|| writer.map_or(Ok(()), |writer| writer.finish(guid)))
            .map_err(os_error)
    }
}

/// Copies a file with other poses (place in the file, 4x4) and the name of their reference system.
#[pyfunction]
#[pyo3(signature = (source, target, scans, images, coordinates))]
fn e57_copy_with_poses(
    py: Python<'_>,
    source: PathBuf,
    target: PathBuf,
    scans: Vec<(usize, PyReadonlyArray2<f64>)>,
    images: Vec<(usize, PyReadonlyArray2<f64>)>,
    coordinates: Option<String>,
) -> PyResult<()> {
    let poses = |given: Vec<(usize, PyReadonlyArray2<f64>)>| -> PyResult<e57::Poses> {
        given
            .into_iter()
            .filter_map(|(index, pose)| {
                let pose = matrix(Some(pose)).transpose()?;
                Some(pose.map(|pose| (index, pose)))
            })
            .collect()
    };
    let (scans, images) = (poses(scans)?, poses(images)?);
    py.detach(|| {
        let input = File::open(&source).map_err(|error| e57::CopyError::Source(error.into()))?;
        let output = File::create(&target).map_err(e57::CopyError::Target)?;
        e57::copy_with_poses(
            input,
            &mut BufWriter::with_capacity(1 << 20, output),
            &scans,
            &images,
            coordinates.as_deref(),
        )
    })
    .map_err(|error| match error {
        e57::CopyError::Source(error) => raise(error),
        e57::CopyError::Target(error) => os_error(error),
    })
}

pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_function(wrap_pyfunction!(e57_copy_with_poses, module)?)?;
    module.add_class::<E57File>()?;
    module.add_class::<E57Writer>()
}
