//! One scan prepared: surfels, patches and free space from points.

use crate::scan::free_space::{Extremes, extremes};
use crate::scan::patches::{Patch, Patches, grow};
use crate::scan::range_image::{DepthEdges, IndexImage, depth_edges, median};
use crate::scan::surfels::{Samples, Surfel, sample};

/// A scan's points, centred on the scanner, and what it knows of each.
pub struct Points<'a> {
    pub xyz: &'a [[f32; 3]],
    /// Row and column of each on the scanner's grid.
    pub grid: Option<(&'a [i32], &'a [i32])>,
    pub intensity: Option<&'a [f32]>,
    pub color: Option<&'a [[u8; 3]]>,
    /// Points whose colour is known; all of them where this is absent.
    pub colored: Option<&'a [bool]>,
}

/// How a scan is prepared.
pub struct Options {
    /// Surfels at the most, of the finest voxels.
    pub surfels: usize,
    /// Smaller planar patches (m^2) are dropped.
    pub least_patch_area: f64,
}

/// What a scan is reduced to.
pub struct Prepared {
    /// Edge of the finest voxels (m).
    pub spacing: f64,
    pub surfels: Vec<Surfel>,
    /// Index of each surfel's patch.
    pub patch_of: Vec<Option<u32>>,
    /// Largest first.
    pub patches: Vec<Patch>,
    pub seen: Extremes,
    /// Standard deviation of one range (m) and angle between neighbouring beams (rad); NaN without a grid.
    pub range_noise: f64,
    pub angular_step: f64,
    /// Median standard deviation of points across their local plane (m).
    pub surface_noise: f64,
}

/// Prepares a scan. Depth edges, which only a grid tells, are left out of the surfels.
pub fn prepare(points: &Points, options: &Options) -> Prepared {
    let grid = points.grid;
    let image = grid.and_then(|(row, column)| IndexImage::from_grid(row, column));
    let edges = match image {
        Some(image) => depth_edges(&image, points.xyz),
        None => DepthEdges {
            on_edge: vec![false; points.xyz.len()],
            range_noise: f64::NAN,
            step: f64::NAN,
        },
    };
    let samples = Samples {
        xyz: points.xyz,
        skip: &edges.on_edge,
        intensity: points.intensity,
        color: points.color,
        colored: points.colored,
    };
    let (finest, sparse) = sample(&samples, options.surfels);
    let Patches {
        patches,
        mut of_surfel,
    } = grow(&finest, options.least_patch_area);
    let planar = finest.surfels.iter().filter(|surfel| surfel.is_planar());
    let mut thickness: Vec<f64> = planar.map(|surfel| surfel.thickness).collect();
    of_surfel.resize(finest.surfels.len() + sparse.len(), None);
    Prepared {
        spacing: finest.size,
        patch_of: of_surfel,
        surfels: finest.surfels.iter().chain(&sparse).copied().collect(),
        patches,
        seen: extremes(points.xyz),
        range_noise: edges.range_noise,
        angular_step: edges.step,
        surface_noise: median(&mut thickness),
    }
}
