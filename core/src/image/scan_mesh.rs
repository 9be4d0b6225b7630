//! A scan's surface as a mesh over its range image.

use rayon::prelude::*;

use crate::scan::range_image::{IndexImage, NO_POINT, median, noise_and_step};

/// Neighbours nearer to each other than so many spacings lie on one surface (seen at up to 48 degrees) ...
const NEAR_SPACINGS: f64 = 1.5;
/// ... and farther ones if the lines through the next beam on either side meet the neighbour within so many spacings ...
const BEND_SPACINGS: f64 = 2.0;
/// ... or one of them within so many: where two surfaces meet in a corner, the other one does not.
const CREASE_SPACINGS: f64 = 1.2;
/// Second differences within so many standard deviations are noise.
const BEND_SIGMAS: f64 = 8.0;
/// Beams farther apart than so many steps are no neighbours: a seam or a gap lies between them.
const GAP_STEPS: f64 = 3.0;

/// A beam and the one in the next column, or the next row, met one surface.
const ACROSS: u8 = 1;
const DOWN: u8 = 2;

/// Corners of a cell of the mesh: a beam, the next one across, the one below that, the one below.
pub type Triangle = [usize; 3];

/// A scan's points, joined where neighbouring beams met one surface.
pub struct Surface {
    pub rows: usize,
    pub columns: usize,
    /// Point of each beam, row by row; `NO_POINT` where nothing was seen.
    cells: Vec<u32>,
    /// How each beam is joined to the next ones.
    joints: Vec<u8>,
    /// The scan's points row by row, so that neighbours lie near each other in memory too; then those that have no cell;
    /// then those put where a single beam among others on a surface was lost.
    pub points: Vec<[f32; 3]>,
    /// How many of the points lie in cells of their own.
    pub in_cells: usize,
    /// Which of the given points each of the scan's is.
    pub source: Vec<u32>,
    /// Larger one of the angles between neighbouring beams across and along the rows (rad).
    pub step: f64,
    /// Standard deviation of a range (m).
    pub range_noise: f64,
}

struct Limits {
    step: f64,
    noise: f64,
}

impl Limits {
    /// Whether neighbours at ranges `a` and `b`, an angle of square `angle2` apart, are of one surface; `beyond` gives the
    /// ranges of the beams before and after them.
    fn linked(&self, a: f64, b: f64, angle2: f64, beyond: impl Fn() -> [Option<f64>; 2]) -> bool {
        if angle2 > (GAP_STEPS * self.step).powi(2) {
            return false;
        }
        let apart2 = (a - b).powi(2) + a * b * angle2;
        let near = (NEAR_SPACINGS * self.step * a.min(b)).max(BEND_SIGMAS * self.noise);
        if apart2 <= near * near {
            return true;
        }
        // Along equal angles the inverse range of a plane changes linearly.
        let bend = |far: f64, near: f64, other: f64| {
            if other > 2.0 * near || near > 2.0 * other {
                return f64::INFINITY;
            }
            let bend = near * near * (1.0 / far + 1.0 / other - 2.0 / near);
            let noise = BEND_SIGMAS * 6.0_f64.sqrt() * self.noise;
            (bend.abs() - noise).max(0.0) / (self.step * near)
        };
        let [before, after] = beyond();
        let bends = [
            before.map(|far| bend(far, a, b)),
            after.map(|far| bend(far, b, a)),
        ];
        let least = bends
            .iter()
            .flatten()
            .copied()
            .fold(f64::INFINITY, f64::min);
        let most = bends.iter().flatten().copied().fold(0.0, f64::max);
        least <= CREASE_SPACINGS || (least.is_finite() && most <= BEND_SPACINGS)
    }
}

impl Surface {
    /// Connects scanner-centred points over their grid of directions.
    pub fn new(mut image: IndexImage, points: Vec<[f32; 3]>) -> Self {
        let (source, in_cells) = in_grid_order(&mut image, points.len());
        let points: Vec<[f32; 3]> = source.par_iter().map(|&p| points[p as usize]).collect();
        let (noise, _) = noise_and_step(&image, &points);
        let points = bridged(&mut image, points, noise);
        let (rows, columns) = (image.rows, image.columns);
        let cells = &image.cells;
        let range = |index: u32| f64::from(range_of(&points[index as usize]));
        let angle2 = |a: u32, b: u32| {
            let (p, q) = (points[a as usize], points[b as usize]);
            let apart2: f64 = (0..3).map(|k| f64::from(p[k] - q[k]).powi(2)).sum();
            let (ra, rb) = (range(a), range(b));
            (apart2 - (ra - rb).powi(2)).max(0.0) / (ra * rb).max(1e-12)
        };
        let next = |column: usize| if column + 1 < columns { column + 1 } else { 0 };
        let previous = |column: usize| if column > 0 { column } else { columns } - 1;
        let stride = (rows * columns / 100_000).max(1) | 1;
        let typical = |down: bool| {
            let mut found: Vec<f64> = (0..(rows - 1) * columns)
                .step_by(stride)
                .filter_map(|flat| {
                    let (row, column) = (flat / columns, flat % columns);
                    let other = if down {
                        flat + columns
                    } else {
                        row * columns + next(column)
                    };
                    let (a, b) = (cells[flat], cells[other]);
                    (a != NO_POINT && b != NO_POINT).then(|| angle2(a, b).sqrt())
                })
                .collect();
            median(&mut found)
        };
        let [across, down] = [false, true].map(|down| Limits {
            step: typical(down),
            noise,
        });
        let seen = |index: u32| (index != NO_POINT).then(|| range(index));
        let linked = |limits: &Limits, before: u32, a: u32, b: u32, after: u32| {
            b != NO_POINT
                && limits.linked(range(a), range(b), angle2(a, b), || {
                    [seen(before), seen(after)]
                })
        };
        let mut joints = vec![0_u8; rows * columns];
        joints
            .par_chunks_mut(columns)
            .enumerate()
            .for_each(|(row, joints)| {
                let line = |row: usize| &cells[row * columns..][..columns];
                let here = line(row);
                for (column, joint) in joints.iter_mut().enumerate() {
                    let a = here[column];
                    if a == NO_POINT {
                        continue;
                    }
                    let beside = next(column);
                    let (before, after) = (here[previous(column)], here[next(beside)]);
                    if linked(&across, before, a, here[beside], after) {
                        *joint |= ACROSS;
                    }
                    if row + 1 == rows {
                        continue;
                    }
                    let above = if row > 0 {
                        line(row - 1)[column]
                    } else {
                        NO_POINT
                    };
                    let beyond = if row + 2 < rows {
                        line(row + 2)[column]
                    } else {
                        NO_POINT
                    };
                    if linked(&down, above, a, line(row + 1)[column], beyond) {
                        *joint |= DOWN;
                    }
                }
            });
        Self {
            rows,
            columns,
            joints,
            step: down.step.max(across.step),
            range_noise: noise,
            points,
            in_cells,
            source,
            cells: image.cells,
        }
    }

    /// The points of a row.
    pub fn row(&self, row: usize) -> &[u32] {
        &self.cells[row * self.columns..][..self.columns]
    }

    /// The column behind another one: the grid goes all the way round.
    pub fn next(&self, column: usize) -> usize {
        if column + 1 < self.columns {
            column + 1
        } else {
            0
        }
    }

    /// Triangles of the mesh between a beam and those beside it, not for the last row.
    pub fn triangles(&self, row: usize, column: usize) -> &'static [Triangle] {
        let joined = |row: usize, column: usize, how: u8| {
            self.joints[row * self.columns + column] & how != 0
        };
        let next = self.next(column);
        let ab = joined(row, column, ACROSS);
        let dc = joined(row + 1, column, ACROSS);
        let ad = joined(row, column, DOWN);
        let bc = joined(row, next, DOWN);
        // A triangle needs the two sides that meet in its middle corner.
        match (ab, bc, dc, ad) {
            (true, true, true, true) => &[[0, 1, 2], [0, 2, 3]],
            (true, true, ..) => &[[0, 1, 2]],
            (_, true, true, _) => &[[1, 2, 3]],
            (_, _, true, true) => &[[2, 3, 0]],
            (true, _, _, true) => &[[3, 0, 1]],
            _ => &[],
        }
    }

    /// Whether the surface ends beside a beam that met something: what lies behind may be hidden up to half a spacing
    /// further.
    pub fn ends_at(&self, row: usize, column: usize) -> bool {
        let here = row * self.columns + column;
        let left = if column > 0 {
            here - 1
        } else {
            here + self.columns - 1
        };
        let range = |cell: usize| range_of(&self.points[self.cells[cell] as usize]);
        // The joint of one of two beams, and the other one.
        let ends = |joint: usize, how: u8, other: usize| {
            self.joints[joint] & how == 0
                && (self.cells[other] == NO_POINT || range(other) > range(here))
        };
        ends(here, ACROSS, row * self.columns + self.next(column))
            || ends(left, ACROSS, left)
            || (row + 1 < self.rows && ends(here, DOWN, here + self.columns))
            || (row > 0 && ends(here - self.columns, DOWN, here - self.columns))
    }
}

/// Renumbers the points of an image in the order of its cells, those in none behind them; which was which, and how many
/// are in cells.
fn in_grid_order(image: &mut IndexImage, count: usize) -> (Vec<u32>, usize) {
    let mut source = Vec::with_capacity(count);
    for cell in &mut image.cells {
        if *cell != NO_POINT {
            source.push(*cell);
            *cell = source.len() as u32 - 1;
        }
    }
    let in_cells = source.len();
    if in_cells < count {
        let mut placed = vec![false; count];
        for &index in &source {
            placed[index as usize] = true;
        }
        source.extend((0..count as u32).filter(|&index| !placed[index as usize]));
    }
    (source, in_cells)
}

pub fn range_of(p: &[f32; 3]) -> f32 {
    (p[0] * p[0] + p[1] * p[1] + p[2] * p[2]).sqrt()
}

/// Puts a point into each empty cell between two beams that met one surface, so that one lost beam makes no hole.
fn bridged(image: &mut IndexImage, mut points: Vec<[f32; 3]>, noise: f64) -> Vec<[f32; 3]> {
    let (rows, columns) = (image.rows, image.columns);
    let limit = BEND_SIGMAS * 6.0_f64.sqrt() * noise;
    let added: Vec<(usize, [f32; 3])> = (0..rows * columns)
        .into_par_iter()
        .filter_map(|flat| {
            if image.cells[flat] != NO_POINT {
                return None;
            }
            let (row, column) = (flat / columns, flat % columns);
            let along_row = |by: isize| {
                let at = (column + columns).wrapping_add_signed(by) % columns;
                image.cells[row * columns + at]
            };
            let along_column = |by: isize| match row.checked_add_signed(by) {
                Some(at) if at < rows => image.cells[at * columns + column],
                _ => NO_POINT,
            };
            let middle = |line: &dyn Fn(isize) -> u32| -> Option<[f32; 3]> {
                let around = [line(-2), line(-1), line(1), line(2)];
                if around.contains(&NO_POINT) {
                    return None;
                }
                let [far, before, after, beyond] =
                    around.map(|index| f64::from(range_of(&points[index as usize])));
                // The inverse ranges of a plane are linear along equal angles.
                let guess = |outer: f64, inner: f64| {
                    1.0 / (1.0 / inner + 2.0 * (1.0 / inner - 1.0 / outer))
                };
                let close = |expected: f64, found: f64| {
                    (expected - found).abs() <= limit.max(0.02 * found) && expected > 0.0
                };
                let good = close(guess(far, before), after) && close(guess(beyond, after), before);
                let (p, q) = (points[around[1] as usize], points[around[2] as usize]);
                good.then(|| std::array::from_fn(|k| 0.5 * (p[k] + q[k])))
            };
            middle(&along_row)
                .or_else(|| middle(&along_column))
                .map(|point| (flat, point))
        })
        .collect();
    for (flat, point) in added {
        image.cells[flat] = points.len() as u32;
        points.push(point);
    }
    points
}

#[cfg(test)]
pub mod tests {
    use super::*;

    pub const STEP: f64 = 0.01;
    pub const ROWS: usize = 60;
    pub const COLUMNS: usize = 80;

    /// A wall 5 m ahead, and before its middle columns a board 3 m ahead; the beam of `lost` had no return.
    pub fn wall_and_board(lost: Option<(usize, usize)>) -> (IndexImage, Vec<[f32; 3]>) {
        let (mut xyz, mut rows, mut columns) = (vec![], vec![], vec![]);
        for row in 0..ROWS {
            for column in 0..COLUMNS {
                if lost == Some((row, column)) {
                    continue;
                }
                let depth = if (30..50).contains(&column) { 3.0 } else { 5.0 };
                let across = (column as f64 - 39.5) * STEP;
                let down = (row as f64 - 29.5) * STEP;
                xyz.push([across.tan() * depth, down.tan() * depth, depth].map(|v| v as f32));
                rows.push(row as i32);
                columns.push(column as i32);
            }
        }
        (IndexImage::from_grid(&rows, &columns, &xyz).unwrap(), xyz)
    }

    fn triangles(surface: &Surface) -> Vec<[[f32; 3]; 3]> {
        let mut out = Vec::new();
        for (row, column) in
            (0..surface.rows - 1).flat_map(|r| (0..surface.columns).map(move |c| (r, c)))
        {
            let next = surface.next(column);
            let (here, below) = (surface.row(row), surface.row(row + 1));
            let around = [here[column], here[next], below[next], below[column]];
            for triangle in surface.triangles(row, column) {
                out.push(triangle.map(|k| surface.points[around[k] as usize]));
            }
        }
        out
    }

    #[test]
    fn no_triangle_spans_the_jump() {
        let (image, xyz) = wall_and_board(None);
        let surface = Surface::new(image, xyz);
        let triangles = triangles(&surface);
        assert!(triangles.len() > 2 * (ROWS - 1) * (COLUMNS - 5));
        for triangle in triangles {
            let depths = triangle.map(|p| p[2]);
            assert!(depths.iter().all(|&d| (d - depths[0]).abs() < 0.1));
        }
    }

    #[test]
    fn one_lost_beam_makes_no_hole() {
        let (image, xyz) = wall_and_board(Some((30, 15)));
        let count = xyz.len();
        let surface = Surface::new(image, xyz);
        assert_eq!(surface.points.len(), count + 1);
        let put = surface.points[count];
        assert!((put[2] - 5.0).abs() < 1e-3, "{put:?}");
        let (image, xyz) = wall_and_board(Some((30, 30)));
        let surface = Surface::new(image, xyz);
        // Beside the jump the rows tell nothing, the column does.
        assert!((surface.points.last().unwrap()[2] - 3.0).abs() < 1e-3);
    }
}
