//! Point files: paths in, points and what headers say out.

use std::fs::File;
use std::io::{Seek, SeekFrom};
use std::path::{Path, PathBuf};

use numpy::{PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::create_exception;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyBytes;
use trihedral_core::formats::cloud::Cloud;
use trihedral_core::formats::error::{FormatError, Result};
use trihedral_core::formats::rows::Rows;
use trihedral_core::formats::{e57, first_lines, pcd, ply, pts, ptx, xyz};

create_exception!(
    _core,
    FileFormatError,
    PyValueError,
    "A file that cannot be used: (place, reason)."
);

pub fn raise(error: FormatError) -> PyErr {
    FileFormatError::new_err((error.place.to_string(), error.reason))
}

/// The points of one scan as a reader hands them on, and what it left out.
#[pyclass(frozen, get_all)]
pub struct PointBlock {
    /// (N, 3) metres, station coordinates less `local_origin`.
    xyz: Py<PyArray2<f32>>,
    /// Three numbers, metres; zero unless coordinates are too large for 32-bit floats.
    local_origin: [f64; 3],
    /// (N,) as stored, of E57 scaled to 0..1; None where the file has none.
    intensity: Option<Py<PyArray1<f32>>>,
    /// (N, 3) red, green, blue of 8 or 16 bits; None where the file has none.
    color: Option<Py<PyAny>>,
    /// (N,) grid row as stored; None for points without a grid.
    row: Option<Py<PyArray1<i32>>>,
    /// (N,) grid column as stored; None for points without a grid.
    column: Option<Py<PyArray1<i32>>>,
    /// Records left out because a coordinate is no finite number or beyond any place on Earth.
    not_finite: u64,
    /// Records left out because they lie at (0, 0, 0).
    no_return: u64,
    /// Points left out because the file marks them as withheld.
    withheld: u64,
    /// Points left out because the file marks them as invalid.
    invalid: u64,
    /// Points behind the last one that the header promises, which are not read.
    surplus: u64,
    /// The last line has no end.
    open_end: bool,
    /// Intensities were scaled by their own extremes: the file states no limits that hold.
    intensity_by_extremes: bool,
    /// The depth of colours was taken from the largest value: the file does not state it.
    color_by_extremes: bool,
}

#[pymethods]
impl PointBlock {
    /// Points that were read by another library.
    #[new]
    fn new(
        xyz: Py<PyArray2<f32>>,
        local_origin: [f64; 3],
        intensity: Option<Py<PyArray1<f32>>>,
        color: Option<Py<PyAny>>,
        no_return: u64,
        withheld: u64,
    ) -> Self {
        Self {
            intensity,
            color,
            no_return,
            withheld,
            ..Self::bare(xyz, local_origin)
        }
    }
}

fn vectors<T: numpy::Element>(py: Python<'_>, values: Vec<T>) -> PyResult<Py<PyArray2<T>>> {
    let rows = values.len() / 3;
    Ok(PyArray1::from_vec(py, values).reshape([rows, 3])?.unbind())
}

fn numbers<T: numpy::Element>(py: Python<'_>, values: Vec<T>) -> Py<PyArray1<T>> {
    PyArray1::from_vec(py, values).unbind()
}

impl PointBlock {
    fn bare(xyz: Py<PyArray2<f32>>, local_origin: [f64; 3]) -> Self {
        Self {
            xyz,
            local_origin,
            intensity: None,
            color: None,
            row: None,
            column: None,
            not_finite: 0,
            no_return: 0,
            withheld: 0,
            invalid: 0,
            surplus: 0,
            open_end: false,
            intensity_by_extremes: false,
            color_by_extremes: false,
        }
    }

    fn from_cloud(py: Python<'_>, cloud: Cloud) -> PyResult<Self> {
        let stored = cloud.channels;
        let color = stored.color.then(|| vectors(py, cloud.color)).transpose()?;
        Ok(Self {
            intensity: stored.intensity.then(|| numbers(py, cloud.intensity)),
            color: color.map(Py::into_any),
            row: stored.grid.then(|| numbers(py, cloud.row)),
            column: stored.grid.then(|| numbers(py, cloud.column)),
            not_finite: cloud.not_finite,
            no_return: cloud.no_return,
            surplus: cloud.surplus,
            open_end: cloud.open_end,
            ..Self::bare(vectors(py, cloud.xyz)?, cloud.local_origin)
        })
    }

    pub fn from_e57(py: Python<'_>, points: e57::Points) -> PyResult<Self> {
        let color = points.color.map(|values| vectors(py, values)).transpose()?;
        Ok(Self {
            intensity: points.intensity.map(|values| numbers(py, values)),
            color: color.map(Py::into_any),
            row: points.row.map(|values| numbers(py, values)),
            column: points.column.map(|values| numbers(py, values)),
            not_finite: points.not_finite,
            no_return: points.no_return,
            invalid: points.invalid,
            surplus: points.surplus,
            intensity_by_extremes: points.intensity_by_extremes,
            color_by_extremes: points.color_by_extremes,
            ..Self::bare(vectors(py, points.xyz)?, points.local_origin)
        })
    }
}

/// Opens a regular file; anything else might make reading wait, or never end.
pub fn open_input(path: &Path) -> Result<File> {
    if !std::fs::metadata(path)?.is_file() {
        return Err(FormatError::whole("it is not a regular file"));
    }
    Ok(File::open(path)?)
}

/// What a parser finds in a file of so many bytes; Python goes on meanwhile.
fn parse<T: Send>(
    py: Python<'_>,
    path: &Path,
    parser: impl FnOnce(File, u64) -> Result<T> + Send,
) -> PyResult<T> {
    py.detach(|| {
        let file = open_input(path)?;
        let size = file.metadata()?.len();
        parser(file, size)
    })
    .map_err(raise)
}

/// The points that a parser finds from a byte of a file on.
fn points_from(
    py: Python<'_>,
    path: &Path,
    offset: u64,
    parser: impl FnOnce(File) -> Result<Cloud> + Send,
) -> PyResult<PointBlock> {
    let cloud = parse(py, path, |mut file, _| {
        file.seek(SeekFrom::Start(offset))?;
        parser(file)
    })?;
    PointBlock::from_cloud(py, cloud)
}

/// What a PCD or PLY file says of its points.
#[pyclass(frozen, get_all)]
struct RecordHeader {
    points: u64,
    /// Rows and columns of an organised cloud; None for a list of points.
    grid: Option<(u64, u64)>,
    /// Names of all values stored with a point.
    fields: Vec<String>,
    /// Translation x y z, then the quaternion w x y z; None where the file has none.
    viewpoint: Option<[f64; 7]>,
    intensity: bool,
    color: bool,
}

#[pyfunction]
fn pcd_header(py: Python<'_>, path: PathBuf) -> PyResult<RecordHeader> {
    parse(py, &path, |file, size| {
        let (header, _) = pcd::read_header(file, size)?;
        let channels = header.layout()?.channels(false);
        Ok(RecordHeader {
            points: header.points,
            grid: (header.height > 1).then_some((header.height, header.width)),
            fields: header.fields.into_iter().map(|field| field.name).collect(),
            viewpoint: header.viewpoint,
            intensity: channels.intensity,
            color: channels.color,
        })
    })
}

#[pyfunction]
fn pcd_read(py: Python<'_>, path: PathBuf, metres_per_unit: f64) -> PyResult<PointBlock> {
    let (_, cloud) = parse(py, &path, |file, size| {
        pcd::read(file, size, metres_per_unit)
    })?;
    PointBlock::from_cloud(py, cloud)
}

#[pyfunction]
fn ply_header(py: Python<'_>, path: PathBuf) -> PyResult<RecordHeader> {
    parse(py, &path, |file, size| {
        let (header, _) = ply::read_header(file, size)?;
        let channels = header.layout()?.channels(false);
        let vertex = header.vertex();
        let names = vertex.properties.iter().map(|property| &property.name);
        Ok(RecordHeader {
            points: vertex.count,
            grid: None,
            fields: names.cloned().collect(),
            viewpoint: None,
            intensity: channels.intensity,
            color: channels.color,
        })
    })
}

#[pyfunction]
fn ply_read(py: Python<'_>, path: PathBuf, metres_per_unit: f64) -> PyResult<PointBlock> {
    let (_, cloud) = parse(py, &path, |file, size| {
        ply::read(file, size, metres_per_unit)
    })?;
    PointBlock::from_cloud(py, cloud)
}

/// One scan of a PTX file.
#[pyclass(frozen)]
struct PtxScan {
    header: ptx::Header,
    #[pyo3(get)]
    columns: u64,
    #[pyo3(get)]
    rows: u64,
    /// Whether the points lie on a grid.
    #[pyo3(get)]
    structured: bool,
    /// 4x4 as stored, for row vectors.
    #[pyo3(get)]
    matrix: [[f64; 4]; 4],
    /// Commas are decimal signs.
    #[pyo3(get)]
    decimal_comma: bool,
    #[pyo3(get)]
    intensity: bool,
    #[pyo3(get)]
    color: bool,
}

#[pymethods]
impl PtxScan {
    /// Reads the points of the scan from its file.
    fn read(&self, py: Python<'_>, path: PathBuf, metres_per_unit: f64) -> PyResult<PointBlock> {
        points_from(py, &path, self.header.offset, |file| {
            ptx::read(file, &self.header, metres_per_unit)
        })
    }
}

#[pyfunction]
fn ptx_index(py: Python<'_>, path: PathBuf) -> PyResult<Vec<PtxScan>> {
    let scan = |header: ptx::Header| PtxScan {
        columns: header.columns,
        rows: header.rows,
        structured: header.structured(),
        matrix: header.matrix,
        decimal_comma: header.decimal_comma,
        intensity: header.channels.intensity,
        color: header.channels.color,
        header,
    };
    let headers = parse(py, &path, ptx::index)?;
    Ok(headers.into_iter().map(scan).collect())
}

/// One block of a PTS file.
#[pyclass(frozen)]
struct PtsBlock {
    header: pts::Header,
    /// Points by the count line.
    #[pyo3(get)]
    declared: u64,
    /// Points there are.
    #[pyo3(get)]
    points: u64,
    /// Numbers in a row.
    #[pyo3(get)]
    columns: usize,
    /// Commas are decimal signs.
    #[pyo3(get)]
    decimal_comma: bool,
    /// The first row is left out, as it is of another width than the rest.
    #[pyo3(get)]
    stray: bool,
    /// Columns that are read, as of `XyzTable`.
    #[pyo3(get)]
    used: Vec<usize>,
    #[pyo3(get)]
    intensity: bool,
    #[pyo3(get)]
    color: bool,
}

#[pymethods]
impl PtsBlock {
    /// Reads the points of the block from its file.
    fn read(&self, py: Python<'_>, path: PathBuf, metres_per_unit: f64) -> PyResult<PointBlock> {
        points_from(py, &path, self.header.offset, |file| {
            pts::read(file, &self.header, metres_per_unit)
        })
    }
}

#[pyfunction]
fn pts_index(py: Python<'_>, path: PathBuf) -> PyResult<Vec<PtsBlock>> {
    let block = |header: pts::Header| PtsBlock {
        declared: header.declared,
        points: header.points,
        columns: header.values,
        decimal_comma: header.decimal_comma,
        stray: header.stray,
        used: header.layout.offsets(),
        intensity: header.channels.intensity,
        color: header.channels.color,
        header,
    };
    let headers = parse(py, &path, pts::index)?;
    Ok(headers.into_iter().map(block).collect())
}

/// What the columns of a text file are.
#[pyclass(frozen)]
struct XyzTable {
    table: xyz::Table,
    /// Names of the columns; empty where nothing names them.
    #[pyo3(get)]
    names: Vec<String>,
    #[pyo3(get)]
    columns: usize,
    /// Commas are decimal signs, not separators.
    #[pyo3(get)]
    decimal_comma: bool,
    /// Points by a line that holds their number; None without one.
    #[pyo3(get)]
    declared: Option<u64>,
    /// Line of a first row that is left out, of another width than the rest.
    #[pyo3(get)]
    stray: Option<u64>,
    /// Columns that are read, from 0: of x, y, z, then of intensity and of red, green, blue where there are.
    #[pyo3(get)]
    used: Vec<usize>,
    #[pyo3(get)]
    intensity: bool,
    #[pyo3(get)]
    color: bool,
}

#[pymethods]
impl XyzTable {
    /// Reads the points of the file that the table is of.
    fn read(&self, py: Python<'_>, path: PathBuf, metres_per_unit: f64) -> PyResult<PointBlock> {
        let cloud = parse(py, &path, |file, _| {
            xyz::read(file, &self.table, metres_per_unit)
        })?;
        PointBlock::from_cloud(py, cloud)
    }
}

#[pyfunction]
fn xyz_sniff(py: Python<'_>, path: PathBuf) -> PyResult<XyzTable> {
    let table = parse(py, &path, xyz::sniff)?;
    Ok(XyzTable {
        names: table.names.clone(),
        columns: table.columns,
        decimal_comma: table.decimal_comma,
        declared: table.declared,
        stray: table.stray,
        used: table.layout.offsets(),
        intensity: table.channels.intensity,
        color: table.channels.color,
        table,
    })
}

/// `ptx`, `pts` or `xyz` by the first lines of a text file; None where they are no rows of numbers.
#[pyfunction]
fn text_kind(head: &[u8]) -> Option<&'static str> {
    Some(match first_lines::text_kind(head)? {
        first_lines::TextKind::Ptx => "ptx",
        first_lines::TextKind::Pts => "pts",
        first_lines::TextKind::Xyz => "xyz",
    })
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
    module.add_class::<PointBlock>()?;
    module.add_class::<RecordHeader>()?;
    module.add_class::<PtxScan>()?;
    module.add_class::<PtsBlock>()?;
    module.add_class::<XyzTable>()?;
    for function in [
        wrap_pyfunction!(pcd_header, module)?,
        wrap_pyfunction!(pcd_read, module)?,
        wrap_pyfunction!(ply_header, module)?,
        wrap_pyfunction!(ply_read, module)?,
        wrap_pyfunction!(ptx_index, module)?,
        wrap_pyfunction!(pts_index, module)?,
        wrap_pyfunction!(xyz_sniff, module)?,
        wrap_pyfunction!(text_kind, module)?,
        wrap_pyfunction!(ptx_rows, module)?,
    ] {
        module.add_function(function)?;
    }
    Ok(())
}
