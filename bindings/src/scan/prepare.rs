//! One scan prepared: surfels, patches, what was seen.

use numpy::{PyArray1, PyArray2, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::prelude::*;
use trihedral_core::scan::patches::Patch;
use trihedral_core::scan::prepare::{self as kernel, Options, Points, Prepared};
use trihedral_core::scan::surfels::Surfel;

use crate::convert::{array, rows, vector};

/// An even sampling of a scan's surface.
#[pyclass(frozen, get_all)]
struct PreparedSurfels {
    /// (N, 3) metres, centred on the scanner.
    points: Py<PyArray2<f32>>,
    /// (N, 3) towards the scanner; 0 where there is no plane.
    normals: Py<PyArray2<f32>>,
    /// (N,) standard deviation of the points across the local plane (m).
    thickness: Py<PyArray1<f32>>,
    /// (N,) points that the local plane rests on.
    support: Py<PyArray1<f32>>,
    /// (N,) points in the surfel's own voxel.
    count: Py<PyArray1<f32>>,
    /// (N,) mean in 0..1; NaN where unknown.
    intensity: Py<PyArray1<f32>>,
    /// (N, 3) means in 0..1; NaN where unknown.
    color: Py<PyArray2<f32>>,
    /// (N,) index of the planar patch; -1 for none.
    patch: Py<PyArray1<i32>>,
}

/// Planar patches, largest first.
#[pyclass(frozen, get_all)]
struct PreparedPatches {
    /// (P, 3) towards the scanner.
    normals: Py<PyArray2<f64>>,
    /// (P,) square metres.
    areas: Py<PyArray1<f64>>,
}

/// What a scan is reduced to.
#[pyclass(frozen, get_all)]
struct PreparedScan {
    surfels: Py<PreparedSurfels>,
    patches: Py<PreparedPatches>,
    /// Edge of the voxels that surfels are drawn from (m).
    spacing: f64,
    /// Nearest and farthest range (m) per cell of a spherical grid, rows from the nadir; 0 where nothing was seen.
    nearest: Py<PyArray1<f32>>,
    farthest: Py<PyArray1<f32>>,
    /// Whether the scan has a scanner's grid that its directions bear out.
    on_grid: bool,
    /// Standard deviation of a range (m).
    range_noise: f64,
    /// Angle between neighbouring beams (rad); NaN where points are even in space instead.
    angular_step: f64,
    /// Median standard deviation of points across their local plane (m).
    surface_noise: f64,
}

fn narrow(v: nalgebra::Vector3<f64>) -> [f32; 3] {
    [v.x as f32, v.y as f32, v.z as f32]
}

fn surfels(py: Python<'_>, surfels: &[Surfel], patch_of: &[Option<u32>]) -> PreparedSurfels {
    let of_each = |value: fn(&Surfel) -> [f32; 3]| {
        let values: Vec<[f32; 3]> = surfels.iter().map(value).collect();
        array(py, &values).unbind()
    };
    let of_one = |value: fn(&Surfel) -> f32| vector(py, surfels.iter().map(value).collect());
    let patch = |index: &Option<u32>| index.map_or(-1, |index| index as i32);
    PreparedSurfels {
        points: of_each(|s| narrow(s.point)),
        normals: of_each(|s| narrow(s.normal)),
        thickness: of_one(|s| s.thickness as f32),
        support: of_one(|s| s.support as f32),
        count: of_one(|s| s.count as f32),
        intensity: of_one(|s| s.intensity),
        color: of_each(|s| s.color),
        patch: vector(py, patch_of.iter().map(patch).collect()),
    }
}

fn patches(py: Python<'_>, patches: &[Patch]) -> PreparedPatches {
    let normals: Vec<[f64; 3]> = patches.iter().map(|patch| patch.normal.into()).collect();
    PreparedPatches {
        normals: array(py, &normals).unbind(),
        areas: vector(py, patches.iter().map(|patch| patch.area).collect()),
    }
}

/// Prepares scanner-centred points: see `trihedral.scan.preparation`.
#[pyfunction]
#[pyo3(signature = (xyz, *, row, column, intensity, color, colored, surfels, sound_normals, least_patch_area))]
#[allow(clippy::too_many_arguments)]
fn prepare(
    py: Python<'_>,
    xyz: PyReadonlyArray2<f32>,
    row: Option<PyReadonlyArray1<i32>>,
    column: Option<PyReadonlyArray1<i32>>,
    intensity: Option<PyReadonlyArray1<f32>>,
    color: Option<PyReadonlyArray2<u8>>,
    colored: Option<PyReadonlyArray1<bool>>,
    surfels: usize,
    sound_normals: bool,
    least_patch_area: f64,
) -> PyResult<PreparedScan> {
    let points = Points {
        xyz: rows::<f32, 3>(&xyz)?,
        grid: match (&row, &column) {
            (Some(row), Some(column)) => Some((row.as_slice()?, column.as_slice()?)),
            _ => None,
        },
        intensity: intensity.as_ref().map(|v| v.as_slice()).transpose()?,
        color: color.as_ref().map(rows::<u8, 3>).transpose()?,
        colored: colored.as_ref().map(|v| v.as_slice()).transpose()?,
    };
    let options = Options {
        surfels,
        sound_normals,
        least_patch_area,
    };
    let found: Prepared = py.detach(|| kernel::prepare(&points, &options));
    Ok(PreparedScan {
        surfels: Py::new(py, self::surfels(py, &found.surfels, &found.patch_of))?,
        patches: Py::new(py, patches(py, &found.patches))?,
        spacing: found.spacing,
        nearest: vector(py, found.seen.nearest),
        farthest: vector(py, found.seen.farthest),
        on_grid: found.on_grid,
        range_noise: found.range_noise,
        angular_step: found.angular_step,
        surface_noise: found.surface_noise,
    })
}

pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_class::<PreparedScan>()?;
    module.add_class::<PreparedSurfels>()?;
    module.add_class::<PreparedPatches>()?;
    module.add_function(wrap_pyfunction!(prepare, module)?)
}
