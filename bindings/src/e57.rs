//! E57 files: arrays and descriptions in and out.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, BufWriter};
use std::path::PathBuf;

use numpy::{PyReadonlyArray1, PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::exceptions::{PyIndexError, PyOSError, PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::PyBytes;
use trihedral_core::formats::e57;
use trihedral_core::formats::error::FormatError;

use crate::formats::{PointBlock, open_input, raise};

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

/// A rigid motion as stored: nothing is checked.
#[pyclass(frozen, get_all, skip_from_py_object)]
#[derive(Clone)]
struct E57Pose {
    /// w, x, y, z.
    quaternion: [f64; 4],
    /// x, y, z in the file's unit.
    translation: [f64; 3],
}

impl From<e57::Pose> for E57Pose {
    fn from(pose: e57::Pose) -> Self {
        Self {
            quaternion: pose.quaternion,
            translation: pose.translation,
        }
    }
}

/// What a file says of one of its scans.
#[pyclass(frozen, get_all)]
struct E57ScanInfo {
    guid: String,
    name: String,
    points: u64,
    /// Names of all values stored with a point; those of extensions with their prefix.
    fields: Vec<String>,
    pose: Option<E57Pose>,
    /// Least and largest row, least and largest column; None where the file does not say.
    index_bounds: Option<[i64; 4]>,
    /// Elements of extensions, with their prefix.
    extras: Vec<String>,
}

impl From<&e57::ScanInfo> for E57ScanInfo {
    fn from(scan: &e57::ScanInfo) -> Self {
        let names = scan.fields.iter().map(|field| &field.name);
        Self {
            guid: scan.guid.clone(),
            name: scan.name.clone(),
            points: scan.records,
            fields: names.cloned().collect(),
            pose: scan.pose.map(E57Pose::from),
            index_bounds: scan.index_bounds,
            extras: scan.extras.clone(),
        }
    }
}

/// What a file says of one of its pictures.
#[pyclass(frozen, get_all)]
struct E57ImageInfo {
    name: String,
    /// The scan that it belongs to; empty where the file does not say.
    scan_guid: String,
    pose: Option<E57Pose>,
    /// `pinhole`, `spherical`, `cylindrical` or `visual-reference`.
    kind: &'static str,
    /// PNG, not JPEG.
    png: bool,
    width: u32,
    height: u32,
    /// Numbers of the camera model by their names in the standard.
    model: BTreeMap<String, f64>,
}

impl From<&e57::ImageInfo> for E57ImageInfo {
    fn from(image: &e57::ImageInfo) -> Self {
        Self {
            name: image.name.clone(),
            scan_guid: image.scan_guid.clone(),
            pose: image.pose.map(E57Pose::from),
            kind: image.kind,
            png: image.png,
            width: image.width,
            height: image.height,
            model: image.model.iter().cloned().collect(),
        }
    }
}

/// Something described in a file, or what is wrong with its description.
#[derive(IntoPyObject)]
enum Described<T> {
    Info(T),
    Damage(String),
}

fn described<'a, S, T: From<&'a S>>(entries: &'a [e57::Entry<S>]) -> Vec<Described<T>> {
    let each = entries.iter().map(|entry| match entry {
        Ok(found) => Described::Info(T::from(found)),
        Err(reason) => Described::Damage(reason.clone()),
    });
    each.collect()
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
            .detach(|| e57::describe(open_input(&path)?))
            .map_err(raise)?;
        Ok(Self { path, found })
    }

    /// The scans in the file's order, each as described, or what is wrong with its description.
    fn scans(&self) -> Vec<Described<E57ScanInfo>> {
        described(&self.found.scans)
    }

    /// The pictures in the file's order, each as described, or what is wrong with its description.
    fn images(&self) -> Vec<Described<E57ImageInfo>> {
        described(&self.found.images)
    }

    /// The valid points of one scan.
    fn read_points(
        &self,
        py: Python<'_>,
        scan_index: usize,
        metres_per_unit: f64,
    ) -> PyResult<PointBlock> {
        let scan = entry(&self.found.scans, scan_index)?;
        let points = py
            .detach(|| e57::read_points(open_input(&self.path)?, scan, metres_per_unit))
            .map_err(raise)?;
        PointBlock::from_e57(py, points)
    }

    /// The encoded bytes of one picture.
    fn read_image<'py>(
        &self,
        py: Python<'py>,
        image_index: usize,
    ) -> PyResult<Bound<'py, PyBytes>> {
        let image = entry(&self.found.images, image_index)?;
        let data = py
            .detach(|| e57::read_image(open_input(&self.path)?, image))
            .map_err(raise)?;
        Ok(PyBytes::new(py, &data))
    }
}

fn matrix(array: PyReadonlyArray2<f64>) -> PyResult<e57::Matrix> {
    if array.shape() != [4, 4] {
        return Err(PyValueError::new_err("a pose is a 4x4 matrix"));
    }
    let view = array.as_array();
    Ok(std::array::from_fn(|row| {
        std::array::from_fn(|column| view[[row, column]])
    }))
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

/// How a picture to be written was projected, in E57's own terms.
#[pyclass(frozen)]
struct E57Projection(e57::PhotoModel);

#[pymethods]
impl E57Projection {
    /// For show only.
    #[staticmethod]
    fn visual_reference() -> Self {
        Self(e57::PhotoModel::VisualReference)
    }

    /// Focal length and pixel size in metres, principal point in pixels.
    #[staticmethod]
    fn pinhole(focal: f64, pixel: [f64; 2], principal: [f64; 2]) -> Self {
        Self(e57::PhotoModel::Pinhole {
            focal,
            pixel,
            principal,
        })
    }

    /// Pixel size in radians.
    #[staticmethod]
    fn spherical(pixel: [f64; 2]) -> Self {
        Self(e57::PhotoModel::Spherical { pixel })
    }

    /// Radius in metres, pixel width in radians, pixel height in metres, principal row in pixels.
    #[staticmethod]
    fn cylindrical(radius: f64, pixel: [f64; 2], principal_y: f64) -> Self {
        Self(e57::PhotoModel::Cylindrical {
            radius,
            pixel,
            principal_y,
        })
    }
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
    #[pyo3(signature = (name, guid, pose, xyz, step, intensity, color, colorless, row, column, invalid))]
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
        colorless: Option<PyReadonlyArray1<bool>>,
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
            pose: pose.map(matrix).transpose()?,
            intensity: slice(&intensity, count)?,
            color: slice(&color, 3 * count)?,
            colorless: slice(&colorless, count)?,
            grid: slice(&row, count)?.zip(slice(&column, count)?),
            invalid: slice(&invalid, count)?,
            xyz,
        };
        let writer = self.open()?;
        py.detach(|| writer.add_scan(&scan)).map_err(os_error)
    }

    /// Appends a picture of the scan that `scan_guid` names.
    #[pyo3(signature = (name, guid, scan_guid, pose, png, data, size, projection))]
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
        projection: &E57Projection,
    ) -> PyResult<()> {
        let photo = e57::Photo {
            name,
            guid,
            scan_guid,
            pose: pose.map(matrix).transpose()?,
            png,
            data,
            width: size.0,
            height: size.1,
            model: projection.0,
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

/// Copies a file with other poses (4x4 by place in the file) and the name of their reference system.
#[pyfunction]
#[pyo3(signature = (source, target, scans, images, coordinates))]
fn e57_copy_with_poses(
    py: Python<'_>,
    source: PathBuf,
    target: PathBuf,
    scans: BTreeMap<usize, PyReadonlyArray2<f64>>,
    images: BTreeMap<usize, PyReadonlyArray2<f64>>,
    coordinates: Option<String>,
) -> PyResult<()> {
    let poses = |given: BTreeMap<usize, PyReadonlyArray2<f64>>| -> PyResult<e57::Poses> {
        given
            .into_iter()
            .map(|(index, pose)| Ok((index, matrix(pose)?)))
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
    module.add_class::<E57Pose>()?;
    module.add_class::<E57ScanInfo>()?;
    module.add_class::<E57ImageInfo>()?;
    module.add_class::<E57File>()?;
    module.add_class::<E57Projection>()?;
    module.add_class::<E57Writer>()
}
