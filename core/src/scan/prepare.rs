//! One scan prepared: surfels, patches and free space from points.

use crate::scan::directions::mixed_by_direction;
use crate::scan::free_space::{Extremes, extremes};
use crate::scan::mixed_points::mixed_on_grid;
use crate::scan::patches::{Patch, Patches, grow, largest_first};
use crate::scan::range_image::{IndexImage, median};
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
    /// Whether voxels are widened until normals are made of surface.
    pub sound_normals: bool,
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
    /// Standard deviation of one range (m), and angle between neighbouring beams (rad): NaN where points are even in space.
    pub range_noise: f64,
    pub angular_step: f64,
    /// Whether it has a scanner's grid that its directions bear out.
    pub on_grid: bool,
    /// Median standard deviation of points across their local plane (m).
    pub surface_noise: f64,
}

/// Prepares a scan. Mixed points are left out of the surfels: they are found on the scanner's grid where its directions
/// bear it out, or else by the directions alone.
pub fn prepare(points: &Points, options: &Options) -> Prepared {
    let grid = points.grid;
    let image = grid.and_then(|(row, column)| IndexImage::from_grid(row, column, points.xyz));
    let found = match &image {
        Some(image) => mixed_on_grid(image, points.xyz),
        None => mixed_by_direction(points.xyz),
    };
    let samples = Samples {
        xyz: points.xyz,
        skip: &found.mixed,
        intensity: points.intensity,
        color: points.color,
        colored: points.colored,
    };
    let grids = sample(&samples, options.surfels, options.sound_normals);
    let finest = &grids[0];
    let planar = finest.surfels.iter().filter(|surfel| surfel.is_planar());
    let mut thickness: Vec<f64> = planar.map(|surfel| surfel.thickness).collect();
    let (mut surfels, mut of_surfel, mut patches) = (vec![], vec![], vec![]);
    for (wider, grid) in grids.iter().enumerate() {
        let grown = grow(grid, options.least_patch_area);
        let before = patches.len() as u32;
        for (surfel, patch) in grid.surfels.iter().zip(grown.of_surfel) {
            // What has no plane on wider voxels either is of the finest only.
            if wider == 0 || surfel.is_planar() {
                surfels.push(*surfel);
                of_surfel.push(patch.map(|patch| before + patch));
            }
        }
        patches.extend(grown.patches);
    }
    let Patches { patches, of_surfel } = largest_first(Patches { patches, of_surfel });
    Prepared {
        spacing: finest.size,
        patch_of: of_surfel,
        surfels,
        patches,
        seen: extremes(points.xyz),
        range_noise: found.range_noise,
        angular_step: found.step,
        on_grid: image.is_some(),
        surface_noise: median(&mut thickness),
    }
}
