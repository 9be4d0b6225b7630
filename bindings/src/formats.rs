//! Point files: paths in, arrays out.

use std::fs::File;
use std::io::{Seek, SeekFrom};
use std::path::PathBuf;

use numpy::{PyArray1, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::create_exception;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict};
use trihedral_core::formats::cloud::Cloud;
use trihedral_core::formats::error::FormatError;
use trihedral_core::formats::rows::Rows;
use trihedral_core::formats::{pcd, ply, pts, ptx, xyz};

create_exception!(
    _core,
    FileFormatError,
    PyValueError,
    "A file that cannot be used: (place, reason)."
);

pub fn raise(error: FormatError) -> PyErr {
    FileFormatError::new_err((error.place.to_string(), error.reason))
}

fn open(path: &PathBuf) -> Result<(File, u64), FormatError> {
    let file = File::open(path)?;
    let size = file.metadata()?.len();
    Ok((file, size))
}

pub fn vectors<'py, T: numpy::Element>(
    py: Python<'py>,
    values: Vec<T>,
    width: usize,
) -> PyResult<Bound<'py, PyAny>> {
    let rows = values.len() / width;
    Ok(PyArray1::from_vec(py, values)
        .reshape([rows, width])?
        .into_any())
}

fn cloud_to_dict<'py>(py: Python<'py>, cloud: Cloud) -> PyResult<Bound<'py, PyDict>> {
    let out = PyDict::new(py);
    out.set_item("xyz", vectors(py, cloud.xyz, 3)?)?;
    out.set_item("local_origin", cloud.local_origin)?;
    out.set_item("not_finite", cloud.not_finite)?;
    out.set_item("no_return", cloud.no_return)?;
    if cloud.channels.intensity {
        out.set_item("intensity", PyArray1::from_vec(py, cloud.intensity))?;
    }
    if cloud.channels.color {
        out.set_item("color", vectors(py, cloud.color, 3)?)?;
    }
    if cloud.channels.grid {
        out.set_item("row", PyArray1::from_vec(py, cloud.row))?;
        out.set_item("column", PyArray1::from_vec(py, cloud.column))?;
    }
    Ok(out)
}

#[pyfunction]
fn pcd_header<'py>(py: Python<'py>, path: PathBuf) -> PyResult<Bound<'py, PyDict>> {
    let header = py
        .detach(|| {
            let (file, size) = open(&path)?;
            pcd::read_header(file, size).map(|(header, _)| header)
        })
        .map_err(raise)?;
    let names: Vec<String> = header
        .fields
        .iter()
        .map(|field| field.name.clone())
        .collect();
    let channels = header.layout().map_err(raise)?.channels(header.height > 1);
    let out = PyDict::new(py);
    out.set_item("points", header.points)?;
    out.set_item("width", header.width)?;
    out.set_item("height", header.height)?;
    out.set_item("fields", names)?;
    out.set_item("viewpoint", header.viewpoint)?;
    out.set_item("intensity", channels.intensity)?;
    out.set_item("color", channels.color)?;
    Ok(out)
}

#[pyfunction]
fn pcd_read<'py>(
    py: Python<'py>,
    path: PathBuf,
    metres_per_unit: f64,
) -> PyResult<Bound<'py, PyDict>> {
    let (_, cloud) = py
        .detach(|| {
            let (file, size) = open(&path)?;
            pcd::read(file, size, metres_per_unit)
        })
        .map_err(raise)?;
    cloud_to_dict(py, cloud)
}

#[pyfunction]
fn ply_header<'py>(py: Python<'py>, path: PathBuf) -> PyResult<Bound<'py, PyDict>> {
    let header = py
        .detach(|| {
            let (file, size) = open(&path)?;
            ply::read_header(file, size).map(|(header, _)| header)
        })
        .map_err(raise)?;
    let channels = header.layout().map_err(raise)?.channels(false);
    let vertex = header.vertex();
    let names: Vec<String> = vertex
        .properties
        .iter()
        .map(|property| property.name.clone())
        .collect();
    let out = PyDict::new(py);
    out.set_item("points", vertex.count)?;
    out.set_item("fields", names)?;
    out.set_item("intensity", channels.intensity)?;
    out.set_item("color", channels.color)?;
    Ok(out)
}

#[pyfunction]
fn ply_read<'py>(
    py: Python<'py>,
    path: PathBuf,
    metres_per_unit: f64,
) -> PyResult<Bound<'py, PyDict>> {
    let (_, cloud) = py
        .detach(|| {
            let (file, size) = open(&path)?;
            ply::read(file, size, metres_per_unit)
        })
        .map_err(raise)?;
    cloud_to_dict(py, cloud)
}

/// One scan of a PTX file.
#[pyclass(frozen)]
struct PtxScan(ptx::Header);

#[pymethods]
impl PtxScan {
    #[getter]
    fn columns(&self) -> u64 {
        self.0.columns
    }
    #[getter]
    fn rows(&self) -> u64 {
        self.0.rows
    }
    #[getter]
    fn structured(&self) -> bool {
        self.0.structured()
    }
    #[getter]
    fn position(&self) -> [f64; 3] {
        self.0.position
    }
    #[getter]
    fn matrix(&self) -> [[f64; 4]; 4] {
        self.0.matrix
    }
    #[getter]
    fn intensity(&self) -> bool {
        self.0.channels.intensity
    }
    #[getter]
    fn color(&self) -> bool {
        self.0.channels.color
    }
}

#[pyfunction]
fn ptx_index(py: Python<'_>, path: PathBuf) -> PyResult<Vec<PtxScan>> {
    let scans = py
        .detach(|| {
            let (file, size) = open(&path)?;
            ptx::index(file, size)
        })
        .map_err(raise)?;
    Ok(scans.into_iter().map(PtxScan).collect())
}

#[pyfunction]
fn ptx_read<'py>(
    py: Python<'py>,
    path: PathBuf,
    scan: &PtxScan,
    metres_per_unit: f64,
) -> PyResult<Bound<'py, PyDict>> {
    let cloud = py
        .detach(|| {
            let (mut file, _) = open(&path)?;
            file.seek(SeekFrom::Start(scan.0.offset))?;
            ptx::read(file, &scan.0, metres_per_unit)
        })
        .map_err(raise)?;
    cloud_to_dict(py, cloud)
}

/// One block of a PTS file.
#[pyclass(frozen)]
struct PtsBlock(pts::Header);

#[pymethods]
impl PtsBlock {
    #[getter]
    fn declared(&self) -> u64 {
        self.0.declared
    }
    #[getter]
    fn points(&self) -> u64 {
        self.0.points
    }
    #[getter]
    fn intensity(&self) -> bool {
        self.0.channels.intensity
    }
    #[getter]
    fn color(&self) -> bool {
        self.0.channels.color
    }
}

#[pyfunction]
fn pts_index(py: Python<'_>, path: PathBuf) -> PyResult<Vec<PtsBlock>> {
    let blocks = py
        .detach(|| {
            let (file, size) = open(&path)?;
            pts::index(file, size)
        })
        .map_err(raise)?;
    Ok(blocks.into_iter().map(PtsBlock).collect())
}

#[pyfunction]
fn pts_read<'py>(
    py: Python<'py>,
    path: PathBuf,
    block: &PtsBlock,
    metres_per_unit: f64,
) -> PyResult<Bound<'py, PyDict>> {
    let cloud = py
        .detach(|| {
            let (mut file, _) = open(&path)?;
            file.seek(SeekFrom::Start(block.0.offset))?;
            pts::read(file, &block.0, metres_per_unit)
        })
        .map_err(raise)?;
    cloud_to_dict(py, cloud)
}

/// What the columns of a text file are.
#[pyclass(frozen)]
struct XyzTable(xyz::Table);

#[pymethods]
impl XyzTable {
    #[getter]
    fn names(&self) -> Vec<String> {
        self.0.names.clone()
    }
    #[getter]
    fn columns(&self) -> usize {
        self.0.columns
    }
    #[getter]
    fn decimal_comma(&self) -> bool {
        self.0.decimal_comma
    }
    /// Which columns are read, from 0: those of x, y, z, then of intensity and of red, green, blue where there are.
    #[getter]
    fn used(&self) -> Vec<usize> {
        self.0.layout.offsets()
    }
    #[getter]
    fn intensity(&self) -> bool {
        self.0.channels.intensity
    }
    #[getter]
    fn color(&self) -> bool {
        self.0.channels.color
    }
}

#[pyfunction]
fn xyz_sniff(py: Python<'_>, path: PathBuf) -> PyResult<XyzTable> {
    py.detach(|| {
        let (file, _) = open(&path)?;
        xyz::sniff(file)
    })
    .map(XyzTable)
    .map_err(raise)
}

#[pyfunction]
fn xyz_read<'py>(
    py: Python<'py>,
    path: PathBuf,
    table: &XyzTable,
    metres_per_unit: f64,
) -> PyResult<Bound<'py, PyDict>> {
    let cloud = py
        .detach(|| {
            let (mut file, _) = open(&path)?;
            file.seek(SeekFrom::Start(table.0.offset))?;
            xyz::read(file, &table.0, metres_per_unit)
        })
        .map_err(raise)?;
    cloud_to_dict(py, cloud)
}

#[pyfunction]
fn ptx_rows<'py>(
    py: Python<'py>,
    xyz: PyReadonlyArray2<'py, f64>,
    intensity: Option<PyReadonlyArray1<'py, f32>>,
    color: Option<PyReadonlyArray2<'py, u8>>,
    order: PyReadonlyArray1<'py, i64>,
) -> PyResult<Bound<'py, PyBytes>> {
    let rows = Rows {
        xyz: xyz.as_slice()?,
        intensity: intensity
            .as_ref()
            .map(|values| values.as_slice())
            .transpose()?,
        color: color.as_ref().map(|values| values.as_slice()).transpose()?,
    };
    let order = order.as_slice()?;
    let text = py
        .detach(|| rows.ptx(order))
        .ok_or_else(|| PyValueError::new_err("the arrays do not fit each other"))?;
    Ok(PyBytes::new(py, &text))
}

pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add("FileFormatError", module.py().get_type::<FileFormatError>())?;
    module.add_class::<PtxScan>()?;
    module.add_class::<PtsBlock>()?;
    module.add_class::<XyzTable>()?;
    for function in [
        wrap_pyfunction!(pcd_header, module)?,
        wrap_pyfunction!(pcd_read, module)?,
        wrap_pyfunction!(ply_header, module)?,
        wrap_pyfunction!(ply_read, module)?,
        wrap_pyfunction!(ptx_index, module)?,
        wrap_pyfunction!(ptx_read, module)?,
        wrap_pyfunction!(pts_index, module)?,
        wrap_pyfunction!(pts_read, module)?,
        wrap_pyfunction!(xyz_sniff, module)?,
        wrap_pyfunction!(xyz_read, module)?,
        wrap_pyfunction!(ptx_rows, module)?,
    ] {
        module.add_function(function)?;
    }
    Ok(())
}
