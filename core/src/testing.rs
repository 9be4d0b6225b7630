//! What tests of several rooms share.

use crate::scan::free_space::{FreeSpace, extremes};
use crate::scan::surfel_map::{Kind, SurfelMap};

/// Points within 5 m of the origin along each axis, by a 64-bit linear congruential generator; `steps` coordinates a
/// side, so that few make many equal ones.
pub fn scattered(count: usize, mut seed: u64, steps: f32) -> Vec<[f32; 3]> {
    let mut next = || {
        seed = seed
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        ((seed >> 33) as f32 / (1_u64 << 31) as f32 * steps).floor() / steps * 10.0 - 5.0
    };
    (0..count).map(|_| [next(), next(), next()]).collect()
}

/// Static surfels of one variance, seen by a station whose rays ended at `rays`.
pub fn static_map(
    points: Vec<[f32; 3]>,
    normals: Vec<[f32; 3]>,
    variance: f32,
    spacing: f64,
    rays: &[[f32; 3]],
) -> SurfelMap {
    let count = points.len();
    let (variances, kinds) = (vec![variance; count], vec![Kind::Static; count]);
    let seen = FreeSpace::new(extremes(rays));
    SurfelMap::new(points, normals, variances, kinds, spacing, seen)
}
