//! One scan prepared: elements, patches, what was seen.

use numpy::{PyArray1, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use trihedral_core::scan::range_image::{DepthEdges, IndexImage, depth_edges, median};
use trihedral_core::scan::surfels::{Samples, Surfel, sample};
use trihedral_core::scan::{free_space, patches};

use crate::convert::{array, rows};

fn narrow(v: nalgebra::Vector3<f64>) -> [f32; 3] {
    [v.x as f32, v.y as f32, v.z as f32]
}

/// Prepares scanner-centred points: see `trihedral.scan.preparation`.
#[pyfunction]
#[pyo3(signature = (xyz, row, column, intensity, color, colored, elements, least_area))]
#[allow(clippy::too_many_arguments)]
fn prepare<'py>(
    py: Python<'py>,
    xyz: PyReadonlyArray2<'py, f32>,
    row: Option<PyReadonlyArray1<'py, i32>>,
    column: Option<PyReadonlyArray1<'py, i32>>,
    intensity: Option<PyReadonlyArray1<'py, f32>>,
    color: Option<PyReadonlyArray2<'py, u8>>,
    colored: Option<PyReadonlyArray1<'py, bool>>,
    elements: usize,
    least_area: f64,
) -> PyResult<Bound<'py, PyDict>> {
    let points = rows::<f32, 3>(&xyz)?;
    let grid = match (&row, &column) {
        (Some(row), Some(column)) => Some((row.as_slice()?, column.as_slice()?)),
        _ => None,
    };
    let intensity = intensity
        .as_ref()
        .map(|values| values.as_slice())
        .transpose()?;
    let color = color.as_ref().map(rows::<u8, 3>).transpose()?;
    let colored = colored.as_ref().map(|known| known.as_slice()).transpose()?;

    let (edges, surfels, sparse, patches, seen) = py.detach(|| {
        let image = grid.and_then(|(row, column)| IndexImage::from_grid(row, column));
        let edges = match image {
            Some(image) => depth_edges(&image, points),
            None => DepthEdges {
                on_edge: vec![false; points.len()],
                range_noise: f64::NAN,
                step: f64::NAN,
            },
        };
        let (surfels, sparse) = sample(
            &Samples {
                xyz: points,
                skip: &edges.on_edge,
                intensity,
                color,
                colored,
            },
            elements,
        );
        let patches = patches::grow(&surfels, least_area);
        (
            edges,
            surfels,
            sparse,
            patches,
            free_space::extremes(points),
        )
    });

    let all: Vec<Surfel> = surfels.elements.iter().chain(&sparse).copied().collect();
    let column_of = |value: &dyn Fn(&Surfel) -> f64| -> Vec<f32> {
        all.iter().map(|element| value(element) as f32).collect()
    };
    let points: Vec<[f32; 3]> = all.iter().map(|e| narrow(e.point)).collect();
    let normals: Vec<[f32; 3]> = all.iter().map(|e| narrow(e.normal)).collect();
    let colors: Vec<[f32; 3]> = all.iter().map(|e| e.color).collect();
    let mut thickness: Vec<f64> = surfels
        .elements
        .iter()
        .filter(|e| e.is_planar())
        .map(|e| e.thickness)
        .collect();

    let out = PyDict::new(py);
    out.set_item("range_noise", edges.range_noise)?;
    out.set_item("angular_step", edges.step)?;
    out.set_item(
        "edge_points",
        edges.on_edge.iter().filter(|&&edge| edge).count(),
    )?;
    out.set_item("spacing", surfels.size)?;
    out.set_item("thickness_median", median(&mut thickness))?;
    out.set_item("points", array(py, &points))?;
    out.set_item("normals", array(py, &normals))?;
    out.set_item(
        "thickness",
        PyArray1::from_vec(py, column_of(&|e| e.thickness)),
    )?;
    out.set_item("support", PyArray1::from_vec(py, column_of(&|e| e.support)))?;
    out.set_item("count", PyArray1::from_vec(py, column_of(&|e| e.count)))?;
    out.set_item(
        "intensity",
        PyArray1::from_vec(py, column_of(&|e| f64::from(e.intensity))),
    )?;
    out.set_item("color", array(py, &colors))?;
    let of_base = patches
        .of_element
        .iter()
        .map(|&p| if p == patches::NO_PATCH { -1 } else { p as i32 });
    let of_element: Vec<i32> = of_base.chain(sparse.iter().map(|_| -1)).collect();
    out.set_item("patch", PyArray1::from_vec(py, of_element))?;

    let found = &patches.patches;
    let normals: Vec<[f64; 3]> = found.iter().map(|p| p.normal.into()).collect();
    let centroids: Vec<[f64; 3]> = found.iter().map(|p| p.centroid.into()).collect();
    let along: Vec<[f64; 6]> = found
        .iter()
        .map(|p| {
            [
                p.along[0].x,
                p.along[0].y,
                p.along[0].z,
                p.along[1].x,
                p.along[1].y,
                p.along[1].z,
            ]
        })
        .collect();
    let variances: Vec<[f64; 3]> = found
        .iter()
        .map(|p| {
            [
                p.covariance[(0, 0)],
                p.covariance[(1, 1)],
                p.covariance[(2, 2)],
            ]
        })
        .collect();
    let looks: Vec<[f32; 4]> = found
        .iter()
        .map(|p| [p.intensity, p.color[0], p.color[1], p.color[2]])
        .collect();
    let mut corners: Vec<[f32; 3]> = Vec::new();
    let mut corner_starts = vec![0_i64];
    for patch in found {
        corners.extend(patch.outline.iter().map(|&c| narrow(c)));
        corner_starts.push(corners.len() as i64);
    }
    out.set_item("patch_normals", array(py, &normals))?;
    out.set_item(
        "patch_distances",
        PyArray1::from_vec(py, found.iter().map(|p| p.distance).collect()),
    )?;
    out.set_item("patch_centroids", array(py, &centroids))?;
    out.set_item("patch_along", array(py, &along))?;
    out.set_item("patch_variances", array(py, &variances))?;
    out.set_item(
        "patch_areas",
        PyArray1::from_vec(py, found.iter().map(|p| p.area).collect()),
    )?;
    out.set_item(
        "patch_thickness",
        PyArray1::from_vec(py, found.iter().map(|p| p.thickness).collect()),
    )?;
    out.set_item("patch_looks", array(py, &looks))?;
    out.set_item("outline_corners", array(py, &corners))?;
    out.set_item("outline_starts", PyArray1::from_vec(py, corner_starts))?;
    out.set_item("seen_nearest", PyArray1::from_vec(py, seen.nearest))?;
    out.set_item("seen_farthest", PyArray1::from_vec(py, seen.farthest))?;
    Ok(out)
}

pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_function(wrap_pyfunction!(prepare, module)?)?;
    module.add("SIGHT_ROWS", free_space::ROWS)?;
    module.add("SIGHT_COLUMNS", free_space::COLUMNS)
}
