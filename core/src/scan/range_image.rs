//! The scan as an image: which point was seen in which direction, where ranges jump, how noisy they are.

use rayon::prelude::*;

/// The solid angle that a scan covers is measured on cells of this size (rad).
const COARSE: f64 = std::f64::consts::PI / 90.0;
/// A grid for points without one has cells that hold so many on average, so that few are empty.
const POINTS_A_CELL: f64 = 2.25;
/// Neighbours on a grid are at most this many times as far apart as points that fill the same view evenly.
const NEXT_TO_EACH_OTHER: f64 = 8.0;
/// A cell without a point.
pub const NO_POINT: u32 = u32::MAX;

/// Point indices on a grid of directions: the scanner's own grid, or one made by projection.
pub struct IndexImage {
    pub rows: usize,
    pub columns: usize,
    /// Row-major; `NO_POINT` where nothing was seen.
    pub cells: Vec<u32>,
}

impl IndexImage {
    /// The scanner's own grid. `None` if the indices cannot be one: negative, or far sparser than the points; and if the
    /// directions do not bear it out, since neighbours on it were seen far apart.
    ///
    /// Where two points claim a cell, the first one keeps it.
    pub fn from_grid(row: &[i32], column: &[i32], xyz: &[[f32; 3]]) -> Option<Self> {
        let lowest = |indices: &[i32]| indices.iter().copied().min();
        let highest = |indices: &[i32]| indices.iter().copied().max();
        let (row0, column0) = (lowest(row)?, lowest(column)?);
        if row0 < 0 || column0 < 0 {
            return None;
        }
        let rows = (highest(row)? - row0) as usize + 1;
        let columns = (highest(column)? - column0) as usize + 1;
        let size = rows.checked_mul(columns)?;
        if rows < 3 || columns < 3 || size > row.len().saturating_mul(20) + 1_000_000 {
            return None;
        }
        let mut cells = vec![NO_POINT; size];
        for (index, (&r, &c)) in row.iter().zip(column).enumerate() {
            let cell = &mut cells[(r - row0) as usize * columns + (c - column0) as usize];
            if *cell == NO_POINT {
                *cell = index as u32;
            }
        }
        let image = Self {
            rows,
            columns,
            cells,
        };
        image.is_borne_out(xyz).then_some(image)
    }

    /// Whether neighbours, along rows and along columns, were seen about as near to each other as points are.
    fn is_borne_out(&self, xyz: &[[f32; 3]]) -> bool {
        let most = NEXT_TO_EACH_OTHER * even_step(xyz) / POINTS_A_CELL.sqrt();
        let stride = (self.cells.len() / 20_000).max(1) | 1;
        [1, self.columns].into_iter().all(|apart| {
            let mut angles: Vec<f64> = (0..self.cells.len() - apart)
                .step_by(stride)
                .map(|cell| [self.cells[cell], self.cells[cell + apart]])
                .filter(|pair| !pair.contains(&NO_POINT))
                .map(|pair| angle_between(xyz[pair[0] as usize], xyz[pair[1] as usize]))
                .collect();
            median(&mut angles) <= most
        })
    }

    /// A spherical grid of square cells of about `step` radians at the equator; the nearest point keeps the cell.
    pub fn by_projection(xyz: &[[f32; 3]], step: f64) -> Self {
        let columns = ((std::f64::consts::TAU / step).round() as usize).clamp(8, 1 << 14);
        let rows = (columns / 2).max(4);
        let mut cells = vec![NO_POINT; rows * columns];
        for (index, &p) in xyz.iter().enumerate() {
            let Some((row, column)) = spherical_cell(p, rows, columns) else {
                continue;
            };
            let cell = &mut cells[row * columns + column];
            if *cell == NO_POINT || squared_range(p) < squared_range(xyz[*cell as usize]) {
                *cell = index as u32;
            }
        }
        Self {
            rows,
            columns,
            cells,
        }
    }
}

/// Angle of the cells (rad) on which points seen in all directions alike fill nearly every cell.
pub fn even_step(xyz: &[[f32; 3]]) -> f64 {
    let columns = (std::f64::consts::TAU / COARSE).round() as usize;
    let rows = columns / 2;
    let mut taken = vec![false; rows * columns];
    for (row, column) in xyz.iter().filter_map(|&p| spherical_cell(p, rows, columns)) {
        taken[row * columns + column] = true;
    }
    let area = |row: usize| ((row as f64 + 0.5) * COARSE - std::f64::consts::FRAC_PI_2).cos();
    let covered: f64 = (0..taken.len())
        .filter(|&cell| taken[cell])
        .map(|cell| area(cell / columns))
        .sum();
    if covered > 0.0 {
        COARSE * (POINTS_A_CELL * covered / xyz.len() as f64).sqrt()
    } else {
        COARSE
    }
}

/// Of the odd powers of a slope from 0 to 1, fitted for the least largest error of its arc tangent.
const ARC_TANGENT: [f32; 7] = [
    0.999_996_1,
    -0.333_173_7,
    0.198_078_15,
    -0.132_333_42,
    0.079_623_66,
    -0.033_604_213,
    0.006_811_790_6,
];

/// Elevation from the nadir as a share of half a turn, azimuth as one of a turn; `None` at the scanner itself.
pub fn elevation_and_turn(p: [f32; 3]) -> Option<(f32, f32)> {
    use std::f32::consts::{FRAC_PI_2, PI, TAU};
    let level = (p[0] * p[0] + p[1] * p[1]).sqrt();
    if level == 0.0 && p[2] == 0.0 {
        return None;
    }
    let azimuth = arc_tangent(p[1], p[0]) + PI;
    let elevation = arc_tangent(p[2], level) + FRAC_PI_2;
    Some((elevation / PI, azimuth / TAU))
}

/// Row (0 at the nadir) and column of a direction on a spherical grid; `None` at the scanner itself.
pub fn spherical_cell(p: [f32; 3], rows: usize, columns: usize) -> Option<(usize, usize)> {
    let (elevation, turn) = elevation_and_turn(p)?;
    let (row, column) = (
        (elevation * rows as f32) as usize,
        (turn * columns as f32) as usize,
    );
    Some((row.min(rows - 1), if column < columns { column } else { 0 }))
}

/// `atan2(y, x)` within 6e-7 rad: quicker than the C library's, and the same on every machine.
fn arc_tangent(y: f32, x: f32) -> f32 {
    use std::f32::consts::{FRAC_PI_2, PI};
    let (across, along) = (y.abs(), x.abs());
    let (less, more) = (across.min(along), across.max(along));
    let slope = if more > 0.0 { less / more } else { 0.0 };
    let square = slope * slope;
    let series = ARC_TANGENT
        .iter()
        .rev()
        .fold(0.0, |sum, factor| sum * square + factor);
    let below = slope * series;
    let quadrant = if across > along {
        FRAC_PI_2 - below
    } else {
        below
    };
    (if x < 0.0 { PI - quadrant } else { quadrant }).copysign(y)
}

fn squared_range(p: [f32; 3]) -> f32 {
    p[0] * p[0] + p[1] * p[1] + p[2] * p[2]
}

fn range(p: [f32; 3]) -> f32 {
    squared_range(p).sqrt()
}

/// An edge bends the range by more than this many standard deviations of its noise ...
const EDGE_SIGMAS: f64 = 8.0;
/// ... and by more than this many spacings between neighbouring points (a surface seen at 63 degrees or more).
const EDGE_SPACINGS: f64 = 2.0;

/// How ranges differ from those of a smooth surface.
pub struct DepthEdges {
    /// Range of each cell (m); NaN where nothing was seen.
    pub ranges: Vec<f32>,
    /// Per cell: the range jumps there.
    pub on_edge: Vec<bool>,
    /// Standard deviation of one range (m), from the second differences along the columns.
    pub range_noise: f64,
    /// Median angle between vertical neighbours (rad).
    pub step: f64,
}

/// Finds depth edges on a grid of directions.
///
/// Along a line of equal angles the inverse range of a plane changes linearly to first order, however oblique the
/// plane: its second difference, scaled back to a range, tells an edge from ground seen at a grazing angle.
pub fn depth_edges(image: &IndexImage, xyz: &[[f32; 3]]) -> DepthEdges {
    let columns = image.columns;
    let (range_noise, step) = noise_and_step(image, xyz);
    let ranges: Vec<f32> = image
        .cells
        .par_iter()
        .map(|&cell| match cell {
            NO_POINT => f32::NAN,
            point => range(xyz[point as usize]),
        })
        .collect();

    // Where a range is not there, nothing is beyond the limit.
    let is_edge = |cell: usize| {
        let (row, column, here) = (cell / columns, cell % columns, ranges[cell]);
        let limit = (EDGE_SIGMAS * 6.0_f64.sqrt() * range_noise)
            .max(EDGE_SPACINGS * step * f64::from(here));
        let bends =
            |apart: usize| bend([ranges[cell - apart], here, ranges[cell + apart]]).abs() > limit;
        (row > 0 && row + 1 < image.rows && bends(columns))
            || (column > 0 && column + 1 < columns && bends(1))
    };
    let on_edge = (0..ranges.len()).into_par_iter().map(is_edge).collect();
    DepthEdges {
        ranges,
        on_edge,
        range_noise,
        step,
    }
}

/// Standard deviation of one range (m), and the median angle between vertical neighbours (rad).
pub fn noise_and_step(image: &IndexImage, xyz: &[[f32; 3]]) -> (f64, f64) {
    let columns = image.columns;
    let stride = (image.cells.len() / 200_000).max(1) | 1;
    let mut bends = Vec::new();
    let mut steps = Vec::new();
    for flat in (columns..image.cells.len().saturating_sub(columns)).step_by(stride) {
        let line = [flat - columns, flat, flat + columns].map(|at| image.cells[at]);
        if !line.contains(&NO_POINT) {
            let points = line.map(|index| xyz[index as usize]);
            bends.push(bend(points.map(range)).abs());
            let [before, _, after] = points;
            steps.push(angle_between(before, after) / 2.0);
        }
    }
    // Second differences of independent ranges have a variance of 1 + 4 + 1.
    let range_noise = 1.4826 * median(&mut bends) / 6.0_f64.sqrt();
    (range_noise, median(&mut steps))
}

/// Second difference of the inverse ranges of three neighbours, scaled back to a range; NaN if one is not there.
fn bend(ranges: [f32; 3]) -> f64 {
    let [before, here, after] = ranges.map(f64::from);
    here * here * (1.0 / before + 1.0 / after - 2.0 / here)
}

fn angle_between(a: [f32; 3], b: [f32; 3]) -> f64 {
    let (a, b) = (a.map(f64::from), b.map(f64::from));
    let cross = [
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    ];
    let dot = a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
    (cross[0] * cross[0] + cross[1] * cross[1] + cross[2] * cross[2])
        .sqrt()
        .atan2(dot)
}

/// Median, 0 for no values; reorders them.
pub fn median(values: &mut [f64]) -> f64 {
    if values.is_empty() {
        return 0.0;
    }
    let middle = values.len() / 2;
    *values.select_nth_unstable_by(middle, f64::total_cmp).1
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_arc_tangent_is_that_of_the_library() {
        for step in -4000..=4000 {
            let angle = f64::from(step) / 4000.0 * std::f64::consts::PI;
            for size in [1e-6, 1.0, 3e5] {
                let (y, x) = ((size * angle.sin()) as f32, (size * angle.cos()) as f32);
                let truth = f64::from(y).atan2(f64::from(x));
                let off = f64::from(arc_tangent(y, x)) - truth;
                assert!(off.abs() < 6e-7, "{off} at {truth}");
            }
        }
        assert_eq!(arc_tangent(0.0, 0.0), 0.0);
    }

    /// A tilted floor 1.7 m below the scanner and a wall 5 m away, on a grid of 0.1 degrees.
    fn room() -> (Vec<[f32; 3]>, Vec<i32>, Vec<i32>) {
        let step = 0.1_f64.to_radians();
        let (mut xyz, mut rows, mut columns) = (vec![], vec![], vec![]);
        for row in 0..600 {
            for column in 0..200 {
                let (elevation, azimuth) = (-0.5 + step * f64::from(row), step * f64::from(column));
                let d = [
                    elevation.cos() * azimuth.cos(),
                    elevation.cos() * azimuth.sin(),
                    elevation.sin(),
                ];
                let floor = if d[2] < 0.0 {
                    -1.7 / d[2]
                } else {
                    f64::INFINITY
                };
                let wall = if column < 100 {
                    20.0 / d[0]
                } else {
                    5.0 / d[0]
                };
                let range = floor.min(wall);
                xyz.push(d.map(|v| (v * range) as f32));
                rows.push(row);
                columns.push(column);
            }
        }
        (xyz, rows, columns)
    }

    #[test]
    fn edges_lie_where_the_range_jumps_and_not_on_oblique_ground() {
        let (xyz, rows, columns) = room();
        let image = IndexImage::from_grid(&rows, &columns, &xyz).unwrap();
        let edges = depth_edges(&image, &xyz);
        assert!((edges.step.to_degrees() - 0.1).abs() < 1e-3);
        for (cell, &edge) in edges.on_edge.iter().enumerate() {
            let index = image.cells[cell] as usize;
            let on_jump = columns[index] == 99 || columns[index] == 100;
            // Where the floor meets a wall the range bends too: within a few rows an edge is right.
            let wall: f64 = if columns[index] < 100 { 20.0 } else { 5.0 };
            let elevation = -0.5 + 0.1_f64.to_radians() * f64::from(rows[index]);
            let crease = (elevation + (1.7 / wall).atan()).abs() < 0.025;
            assert!(
                !edge || on_jump || crease,
                "no edge away from the jump at row {} column {}",
                rows[index],
                columns[index]
            );
            if on_jump && !crease && rows[index] > 450 {
                assert!(edge);
            }
        }
    }

    #[test]
    fn an_implausible_grid_is_none() {
        let xyz = [[1.0, 0.0, 0.0]; 3];
        assert!(IndexImage::from_grid(&[], &[], &[]).is_none());
        assert!(IndexImage::from_grid(&[-1, 0, 1], &[0, 1, 2], &xyz).is_none());
        assert!(IndexImage::from_grid(&[0, 1, i32::MAX], &[0, 1, i32::MAX], &xyz).is_none());
    }

    #[test]
    fn a_grid_is_one_while_neighbours_on_it_were_seen_side_by_side() {
        let (xyz, rows, columns) = room();
        assert!(IndexImage::from_grid(&rows, &columns, &xyz).is_some());
        // Exchanged, they are still beside each other.
        assert!(IndexImage::from_grid(&columns, &rows, &xyz).is_some());
        // Points numbered by rows of a wrong length, and in any order.
        let of_length = |length: i32| -> (Vec<i32>, Vec<i32>) {
            (0..xyz.len() as i32)
                .map(|i| (i / length, i % length))
                .unzip()
        };
        let (wrong_rows, wrong_columns) = of_length(137);
        assert!(IndexImage::from_grid(&wrong_rows, &wrong_columns, &xyz).is_none());
        let shuffled: Vec<i32> = (0..xyz.len())
            .map(|i| columns[i * 7919 % xyz.len()])
            .collect();
        assert!(IndexImage::from_grid(&rows, &shuffled, &xyz).is_none());
    }

    #[test]
    fn projection_keeps_the_nearest_point() {
        let xyz = [[10.0, 0.1, 0.1], [5.0, 0.05, 0.05], [0.0, 0.0, 0.0]];
        let image = IndexImage::by_projection(&xyz, 0.01);
        let kept: Vec<u32> = image
            .cells
            .iter()
            .copied()
            .filter(|&c| c != NO_POINT)
            .collect();
        assert_eq!(kept, [1]);
    }
}
