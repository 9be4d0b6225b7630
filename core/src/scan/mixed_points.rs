//! Points that mix two surfaces, since the beam fell on both: found where ranges jump.
//!
//! A point at an edge of a surface is as true as any; one between a nearer and a farther edge, or alone at its range, is
//! of no surface.

use rayon::prelude::*;

use crate::scan::range_image::{DepthEdges, IndexImage, NO_POINT, depth_edges};

/// A point is apart from its neighbours by more than this many standard deviations of its range ...
pub const APART_SIGMAS: f64 = 8.0;
/// ... and by more than this many spacings between neighbouring points.
pub const APART_SPACINGS: f64 = 0.75;

/// What the range image of a scan tells of its points.
pub struct MixedPoints {
    /// Per point: it is of no surface.
    pub mixed: Vec<bool>,
    /// Standard deviation of one range (m).
    pub range_noise: f64,
    /// Angle between neighbouring beams (rad); NaN where points are even in space instead.
    pub step: f64,
}

/// Finds mixed points on the scanner's grid.
pub fn mixed_on_grid(image: &IndexImage, xyz: &[[f32; 3]]) -> MixedPoints {
    let edges = depth_edges(image, xyz);
    let cells: Vec<usize> = (0..image.cells.len())
        .into_par_iter()
        .filter(|&cell| image.cells[cell] != NO_POINT && is_mixed(image, &edges, cell))
        .collect();
    let mut mixed = vec![false; xyz.len()];
    for cell in cells {
        mixed[image.cells[cell] as usize] = true;
    }
    MixedPoints {
        mixed,
        range_noise: edges.range_noise,
        step: edges.step,
    }
}

fn is_mixed(image: &IndexImage, edges: &DepthEdges, cell: usize) -> bool {
    let (row, column) = (cell / image.columns, cell % image.columns);
    if row == 0 || column == 0 || row + 1 == image.rows || column + 1 == image.columns {
        return false;
    }
    let below = cell - image.columns;
    let above = cell + image.columns;
    let pairs = [
        [cell - 1, cell + 1],
        [below, above],
        [below - 1, above + 1],
        [below + 1, above - 1],
    ];
    if !edges.on_edge[cell]
        && !pairs
            .iter()
            .any(|pair| pair.iter().all(|&at| edges.on_edge[at]))
    {
        return false;
    }
    let here = f64::from(edges.ranges[cell]);
    let limit = (APART_SIGMAS * edges.range_noise).max(APART_SPACINGS * edges.step * here);
    // How far a neighbour lies behind; NaN where nothing was seen.
    let behind = |at: usize| here * (1.0 - here / f64::from(edges.ranges[at]));
    let is_near = |at: usize| behind(at).abs() <= limit;
    let between = |[one, other]: [usize; 2]| {
        let off = [behind(one), behind(other)];
        edges.on_edge[one]
            && edges.on_edge[other]
            && off[0].min(off[1]) < -limit
            && off[0].max(off[1]) > limit
    };
    let alone = edges.on_edge[cell] && !pairs.as_flattened().iter().any(|&at| is_near(at));
    alone || pairs.into_iter().any(between)
}
