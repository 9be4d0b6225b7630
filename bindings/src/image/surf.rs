//! SURF features of a picture.

use numpy::{PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use trihedral_core::image::surf::{
    Integral, Keypoint, Options, describe, descriptor_size, detect, determinants,
};

use crate::convert::{array, vector};

fn integral_of(image: &PyReadonlyArray2<u8>) -> PyResult<Integral> {
    let (height, width) = (image.shape()[0], image.shape()[1]);
    Ok(Integral::new(image.as_slice()?, width, height))
}

/// SURF features of a picture, the strongest first.
#[pyclass(frozen, get_all)]
struct SurfFeatures {
    /// (N, 2) column and row.
    pixels: Py<PyArray2<f32>>,
    /// (N,) sigma in pixels.
    scale: Py<PyArray1<f32>>,
    /// (N,) radians.
    angle: Py<PyArray1<f32>>,
    /// (N,) 1 for dark blobs, -1 for bright ones.
    sign: Py<PyArray1<i8>>,
    /// (N, 64 or 128).
    descriptors: Py<PyArray2<f32>>,
}

/// Finds and describes SURF features.
#[pyfunction]
#[pyo3(signature = (image, mask, *, octaves, threshold, upright, extended, most))]
#[allow(clippy::too_many_arguments)]
fn surf(
    py: Python<'_>,
    image: PyReadonlyArray2<u8>,
    mask: Option<PyReadonlyArray2<bool>>,
    octaves: usize,
    threshold: f32,
    upright: bool,
    extended: bool,
    most: usize,
) -> PyResult<SurfFeatures> {
    let pixels = image.as_slice()?;
    let (height, width) = (image.shape()[0], image.shape()[1]);
    let mask = mask.as_ref().map(|mask| mask.as_slice()).transpose()?;
    if mask.is_some_and(|mask| mask.len() != pixels.len()) {
        return Err(PyValueError::new_err("image and mask differ in size"));
    }
    let options = Options {
        octaves,
        threshold,
        upright,
        extended,
        most,
    };
    let (keypoints, descriptors): (Vec<Keypoint>, Vec<f32>) = py.detach(|| {
        let integral = Integral::new(pixels, width, height);
        let mut keypoints = detect(&integral, mask, &options);
        let descriptors = describe(&integral, &mut keypoints, &options);
        (keypoints, descriptors)
    });
    let pixels: Vec<[f32; 2]> = keypoints.iter().map(|k| [k.x, k.y]).collect();
    let of_each = |value: fn(&Keypoint) -> f32| vector(py, keypoints.iter().map(value).collect());
    let descriptors = if extended {
        array(py, descriptors.as_chunks::<{ descriptor_size(true) }>().0)
    } else {
        array(py, descriptors.as_chunks::<{ descriptor_size(false) }>().0)
    };
    Ok(SurfFeatures {
        pixels: array(py, &pixels).unbind(),
        scale: of_each(|k| k.scale),
        angle: of_each(|k| k.angle),
        sign: vector(py, keypoints.iter().map(|k| k.sign as i8).collect()),
        descriptors: descriptors.unbind(),
    })
}

/// Determinant of the Hessian at every pixel for one filter side (9, 15, 21, ...); 0 where the filter leaves the picture.
#[pyfunction]
fn surf_determinants<'py>(
    py: Python<'py>,
    image: PyReadonlyArray2<'py, u8>,
    side: usize,
) -> PyResult<Bound<'py, PyArray2<f32>>> {
    if side < 9 || side % 6 != 3 {
        return Err(PyValueError::new_err(format!(
            "a filter has a side of 9, 15, 21, ..., not {side}"
        )));
    }
    let integral = integral_of(&image)?;
    let values = py.detach(|| determinants(&integral, side));
    PyArray1::from_vec(py, values).reshape([image.shape()[0], image.shape()[1]])
}

pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_class::<SurfFeatures>()?;
    module.add_function(wrap_pyfunction!(surf, module)?)?;
    module.add_function(wrap_pyfunction!(surf_determinants, module)?)
}
