//! What a station saw in a direction: the nearest and the farthest range, at the resolution that the scan supports.

use std::sync::atomic::{AtomicU32, Ordering::Relaxed};

use nalgebra::{Matrix3, Vector3};
use rayon::prelude::*;

use crate::scan::range_image::spherical_cell;

/// Columns of the finest level (0.25 degrees).
pub const COLUMNS: usize = 1440;
pub const ROWS: usize = COLUMNS / 2;
const LEVELS: usize = 5;
/// Cells of a 3x3 neighbourhood that must be seen before it is believed.
const SEEN_CELLS: f32 = 6.0;

/// Nearest and farthest range per cell, row 0 at the nadir; 0 where nothing was seen.
#[derive(Clone)]
pub struct Extremes {
    pub nearest: Vec<f32>,
    pub farthest: Vec<f32>,
}

/// Collects the finest level from the points of a scan (scanner-centred).
pub fn extremes(xyz: &[[f32; 3]]) -> Extremes {
    // Positive floats order like their bits, so the extremes need no lock and no order.
    let nearest: Vec<AtomicU32> = (0..ROWS * COLUMNS)
        .map(|_| AtomicU32::new(u32::MAX))
        .collect();
    let farthest: Vec<AtomicU32> = (0..ROWS * COLUMNS).map(|_| AtomicU32::new(0)).collect();
    xyz.par_iter().for_each(|&p| {
        if let Some((row, column)) = spherical_cell(p, ROWS, COLUMNS) {
            let bits = (p[0] * p[0] + p[1] * p[1] + p[2] * p[2]).sqrt().to_bits();
            let cell = row * COLUMNS + column;
            // Most points lie between extremes that are known: reading is cheaper than writing.
            if bits < nearest[cell].load(Relaxed) {
                nearest[cell].fetch_min(bits, Relaxed);
            }
            if bits > farthest[cell].load(Relaxed) {
                farthest[cell].fetch_max(bits, Relaxed);
            }
        }
    });
    let unpack = |cells: Vec<AtomicU32>| {
        cells.into_iter().map(AtomicU32::into_inner).map(|bits| {
            if bits == u32::MAX {
                0.0
            } else {
                f32::from_bits(bits)
            }
        })
    };
    Extremes {
        nearest: unpack(nearest).collect(),
        farthest: unpack(farthest).collect(),
    }
}

/// What the station knows about a point of space.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Sight {
    /// No ray passed near enough to say.
    Unknown,
    /// Every ray nearby went on beyond the point: the place is empty.
    SeenThrough,
    /// Every ray nearby ended before the point.
    Hidden,
    /// Rays nearby ended about there.
    Near,
}

/// What a station saw through, looked up by direction and range.
pub struct FreeSpace {
    /// Of each cell of the finest level the nearest and the farthest range about it, 0 where too little was seen.
    about: Vec<[f32; 2]>,
    /// Nearest range of each cell of the second level.
    half: Vec<f32>,
}

impl FreeSpace {
    /// The finest of several levels, of halving resolution, with rays in at least six of the nine cells around a direction
    /// answers for it: their nearest and farthest ends bound the surface, however oblique.
    pub fn new(finest: Extremes) -> Self {
        let mut levels = vec![finest];
        for level in 1..LEVELS {
            levels.push(halved(&levels[level - 1], COLUMNS >> (level - 1)));
        }
        let mut about: Vec<[f32; 2]> = Vec::new();
        for (level, cells) in levels.iter().enumerate().rev() {
            about = around(cells, COLUMNS >> level, &about);
        }
        Self {
            about,
            half: levels.swap_remove(1).nearest,
        }
    }

    /// Distance (m) that is free along each of `headings` even steps from -180 degrees, about the level of the scanner,
    /// after a rotation that turns the scan upright; 0 where too little was seen.
    pub fn free_about_level(&self, upright_from_scan: &Matrix3<f64>, headings: usize) -> Vec<f32> {
        let scan_from_upright = upright_from_scan.transpose();
        let nearest = &self.half;
        let (rows, columns) = (ROWS >> 1, COLUMNS >> 1);
        (0..headings)
            .map(|index| {
                let heading = (index as f64 + 0.5) / headings as f64 * std::f64::consts::TAU
                    - std::f64::consts::PI;
                let mut seen = Vec::new();
                for elevation in -2..=8 {
                    let elevation = f64::from(elevation).to_radians();
                    let level = Vector3::new(heading.cos(), heading.sin(), elevation.tan());
                    let direction = scan_from_upright * level;
                    let direction = [direction.x as f32, direction.y as f32, direction.z as f32];
                    if let Some((row, column)) = spherical_cell(direction, rows, columns) {
                        let range = nearest[row * columns + column];
                        if range > 0.0 {
                            seen.push(range * elevation.cos() as f32);
                        }
                    }
                }
                if seen.len() < 6 {
                    0.0
                } else {
                    seen.into_iter().fold(f32::INFINITY, f32::min)
                }
            })
            .collect()
    }

    /// What the rays around a direction say of the point; `margin` (m) is how far beyond or before they must end.
    pub fn sight(&self, point: [f32; 3], margin: f32) -> Sight {
        let Some((row, column)) = spherical_cell(point, ROWS, COLUMNS) else {
            return Sight::Unknown;
        };
        let [nearest, farthest] = self.about[row * COLUMNS + column];
        let range = (point[0] * point[0] + point[1] * point[1] + point[2] * point[2]).sqrt();
        if nearest == 0.0 {
            Sight::Unknown
        } else if range < nearest - margin {
            Sight::SeenThrough
        } else if range > farthest + margin {
            Sight::Hidden
        } else {
            Sight::Near
        }
    }
}

/// The level of half the resolution.
fn halved(finer: &Extremes, columns: usize) -> Extremes {
    let pooled = |values: &[f32], pick: fn(f32, f32) -> f32| -> Vec<f32> {
        values
            .chunks_exact(2 * columns)
            .flat_map(|rows| {
                (0..columns / 2).map(move |column| {
                    [0, 1, columns, columns + 1]
                        .map(|offset| rows[2 * column + offset])
                        .into_iter()
                        .reduce(pick)
                        .expect("four cells")
                })
            })
            .collect()
    };
    Extremes {
        nearest: pooled(&finer.nearest, |a, b| {
            if a == 0.0 || b != 0.0 && b < a { b } else { a }
        }),
        farthest: pooled(&finer.farthest, f32::max),
    }
}

/// Nearest and farthest range in the nine cells around each; where too few of them were seen, what the coarser level has
/// there.
fn around(cells: &Extremes, columns: usize, coarser: &[[f32; 2]]) -> Vec<[f32; 2]> {
    let rows = cells.nearest.len() / columns;
    let mut about = vec![[0.0; 2]; cells.nearest.len()];
    let lines = about.par_chunks_mut(columns).enumerate();
    lines.for_each(|(row, line)| {
        // Over the three rows first, then over three columns of that; the first and the last are neighbours.
        let mut seen = vec![0.0_f32; columns + 2];
        let mut nearest = vec![f32::INFINITY; columns + 2];
        let mut farthest = vec![0.0_f32; columns + 2];
        for r in row.saturating_sub(1)..=(row + 1).min(rows - 1) {
            let of_row = r * columns..(r + 1) * columns;
            let sums = seen[1..]
                .iter_mut()
                .zip(&mut nearest[1..])
                .zip(&mut farthest[1..]);
            let ranges = cells.nearest[of_row.clone()]
                .iter()
                .zip(&cells.farthest[of_row]);
            for (((seen, nearest), farthest), (&near, &far)) in sums.zip(ranges) {
                let is_seen = near > 0.0;
                *seen += if is_seen { 1.0 } else { 0.0 };
                *nearest = lesser(*nearest, if is_seen { near } else { f32::INFINITY });
                *farthest = greater(*farthest, far);
            }
        }
        for values in [&mut seen, &mut nearest, &mut farthest] {
            values[0] = values[columns];
            values[columns + 1] = values[1];
        }
        let beside = seen
            .windows(3)
            .zip(nearest.windows(3))
            .zip(farthest.windows(3));
        for ((found, column), ((seen, nearest), farthest)) in line.iter_mut().zip(0..).zip(beside) {
            *found = if seen[0] + seen[1] + seen[2] >= SEEN_CELLS {
                [
                    lesser(lesser(nearest[0], nearest[1]), nearest[2]),
                    greater(greater(farthest[0], farthest[1]), farthest[2]),
                ]
            } else {
                let at = row / 2 * (columns / 2) + column / 2;
                coarser.get(at).copied().unwrap_or_default()
            };
        }
    });
    about
}

/// One instruction, unlike `f32::min`, which minds NaN.
fn lesser(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

fn greater(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A wall 10 m ahead, a metre-wide column 4 m ahead at its middle; nothing behind the scanner.
    fn wall_and_column(points_a_degree: i32) -> FreeSpace {
        let mut xyz = vec![];
        for i in -40 * points_a_degree..40 * points_a_degree {
            for j in -20 * points_a_degree..20 * points_a_degree {
                let azimuth = (f64::from(i) / f64::from(points_a_degree)).to_radians();
                let elevation = (f64::from(j) / f64::from(points_a_degree)).to_radians();
                let y = 4.0 * azimuth.tan();
                let x = if y.abs() < 0.5 { 4.0 } else { 10.0 };
                let level = x / azimuth.cos();
                xyz.push([x, level * azimuth.sin(), level * elevation.tan()].map(|v| v as f32));
            }
        }
        FreeSpace::new(extremes(&xyz))
    }

    #[test]
    fn space_before_a_surface_is_empty_behind_it_hidden_elsewhere_unknown() {
        for density in [1, 8] {
            let seen = wall_and_column(density);
            assert_eq!(seen.sight([5.0, 3.0, 0.2], 0.1), Sight::SeenThrough);
            assert_eq!(seen.sight([6.0, 0.0, 0.2], 0.1), Sight::Hidden);
            assert_eq!(seen.sight([2.0, 0.0, 0.2], 0.1), Sight::SeenThrough);
            assert_eq!(seen.sight([10.02, 5.0, 0.2], 0.1), Sight::Near);
            assert_eq!(seen.sight([-5.0, 0.0, 0.0], 0.1), Sight::Unknown);
            assert_eq!(seen.sight([0.0, 0.0, 0.0], 0.1), Sight::Unknown);
        }
    }

    #[test]
    fn beside_an_edge_nothing_is_called_empty() {
        let seen = wall_and_column(8);
        // The column's edge at 4 m: rays to either side of it end at 4 m and at 10 m.
        assert_eq!(seen.sight([4.1, 0.51, 0.2], 0.1), Sight::Near);
    }
}
