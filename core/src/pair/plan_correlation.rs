//! Where one station's upright surfaces fall onto the other's, for every shift at once.
//!
//! Upright surfels are drawn on a plan as complex numbers, the direction of their normal; the cross-correlation of two
//! plans, by FFT, sums the cosines between facing normals at every shift. Surfaces that look away from each other count
//! against a shift, and so do walls of one station in floor space that the other saw to be free. Heights are found after
//! that, from surfaces that look up or down and from where walls end.

use std::collections::BTreeMap;
use std::sync::Arc;

use nalgebra::{Matrix3, Vector3};
use rayon::prelude::*;
use rustc_hash::FxHashMap;
use rustfft::num_complex::Complex32;
use rustfft::{Fft, FftPlanner};

use crate::scan::surfel_map::{COMPARED_SPACING, SurfelMap};

/// Steps of heading at which free space is looked up.
const HEADINGS: usize = 720;

/// A station turned upright.
pub struct Upright {
    pub points: Vec<[f32; 3]>,
    pub normals: Vec<[f32; 3]>,
    /// Distance (m) that is free about the level of the scanner, at even steps of heading from -180 degrees.
    pub free: Vec<f32>,
}

impl Upright {
    /// About `samples` surfels, and points on sparse planes in the same proportion, turned upright.
    pub fn new(map: &SurfelMap, upright_from_scan: &Matrix3<f64>, samples: usize) -> Self {
        let level = map.level(COMPARED_SPACING);
        let step = (level.points.len() / samples.max(1)).max(1);
        let turned = |v: &[f32; 3]| {
            let t = upright_from_scan * Vector3::from(v.map(f64::from));
            [t.x as f32, t.y as f32, t.z as f32]
        };
        let near = level.points.iter().zip(&level.normals).step_by(step);
        let sparse = map.sparse_planes.iter().step_by(step).map(|(p, n)| (p, n));
        let (points, normals) = near
            .chain(sparse)
            .map(|(p, n)| (turned(p), turned(n)))
            .unzip();
        Self {
            points,
            normals,
            free: map.free_space.free_about_level(upright_from_scan, HEADINGS),
        }
    }
}

/// What a wall in free space costs, against what a wall on a wall gains.
const CONFLICT: f32 = 0.3;

/// Extent and resolution of a plan.
#[derive(Clone, Copy, Debug)]
pub struct Plan {
    /// Edge of a cell (m).
    pub cell: f32,
    /// Cells a side; shifts up to half of it are told apart.
    pub side: usize,
    /// Surfels beyond this distance from the scanner are left out (m): at most a third of the side, so that shifts up
    /// to it are not mistaken for others.
    pub farthest: f32,
}

/// A shift and turn of `a` onto `b`, both upright.
#[derive(Clone, Copy, Debug)]
pub struct Placement {
    pub yaw: f32,
    pub shift: [f32; 3],
    /// Normalised correlation of the upright surfaces less conflicts, 1 for plans that are the same, times the share of
    /// the heights where floors, ceilings and wall tops meet that this height has.
    pub score: f32,
}

/// A normal with less than this along the vertical is of an upright surface, with more than `LEVEL` of a level one.
const UPRIGHT: f32 = 0.5;
const LEVEL: f32 = 0.8;
/// Cells around a peak that belong to it.
const PEAK_RADIUS: usize = 2;
/// Cell of the height histograms (m).
const HEIGHT_CELL: f32 = 0.1;

struct Planner {
    plan: Plan,
    forward: Arc<dyn Fft<f32>>,
    inverse: Arc<dyn Fft<f32>>,
}

impl Planner {
    fn new(plan: Plan) -> Self {
        let mut planner = FftPlanner::new();
        Self {
            plan,
            forward: planner.plan_fft_forward(plan.side),
            inverse: planner.plan_fft_inverse(plan.side),
        }
    }

    /// The plan of the walls (direction of the normal, a full wall about 1 long) and that of the free space.
    fn draw(&self, station: &Upright, yaw: f32) -> (Vec<Complex32>, Vec<f32>) {
        let side = self.plan.side;
        let (sin, cos) = yaw.sin_cos();
        // Nothing is drawn beyond a third of the side from the middle: once round at the most.
        let wrapped = |cell: i32| (if cell < 0 { cell + side as i32 } else { cell }) as usize;
        let mut walls = vec![Complex32::default(); side * side];
        for (p, n) in station.points.iter().zip(&station.normals) {
            if n[2].abs() > UPRIGHT || p[0].hypot(p[1]) > self.plan.farthest {
                continue;
            }
            let (x, y) = (cos * p[0] - sin * p[1], sin * p[0] + cos * p[1]);
            let value = Complex32::new(cos * n[0] - sin * n[1], sin * n[0] + cos * n[1]);
            // Spread over the four cells around, so that a surface on a border of cells is not torn.
            let (u, v) = (x / self.plan.cell, y / self.plan.cell);
            let (u0, v0) = (u.floor(), v.floor());
            let (fu, fv) = (u - u0, v - v0);
            for (du, dv, weight) in [
                (0, 0, (1.0 - fu) * (1.0 - fv)),
                (1, 0, fu * (1.0 - fv)),
                (0, 1, (1.0 - fu) * fv),
                (1, 1, fu * fv),
            ] {
                let (row, column) = (wrapped(v0 as i32 + dv), wrapped(u0 as i32 + du));
                walls[row * side + column] += value * weight;
            }
        }
        // A tall wall is many surfels in one cell: the root, cut, keeps it from outvoting all else.
        let filled = walls
            .iter()
            .filter(|value| value.norm_sqr() > 0.0)
            .count()
            .max(1) as f32;
        let mean = walls.iter().map(|value| value.norm()).sum::<f32>() / filled;
        for value in &mut walls {
            let norm = value.norm();
            if norm > 0.0 {
                *value *= (norm / mean).sqrt().min(1.5) / norm;
            }
        }

        let mut free = vec![0.0; side * side];
        let step = std::f32::consts::TAU / station.free.len() as f32;
        for (index, &distance) in station.free.iter().enumerate() {
            let heading = yaw - std::f32::consts::PI + (index as f32 + 0.5) * step;
            let end = (distance.min(self.plan.farthest) / self.plan.cell - 1.5).max(0.0);
            let (sin, cos) = heading.sin_cos();
            for half in 0..(2.0 * end) as usize {
                let along = half as f32 / 2.0;
                // Rounded, without a call: baseline x86-64 has no instruction for it.
                let nearest = |v: f32| (v + 0.5_f32.copysign(v)) as i32;
                free[wrapped(nearest(along * sin)) * side + wrapped(nearest(along * cos))] = 1.0;
            }
        }
        (walls, free)
    }

    /// Transforms of the walls and of the conflict plan, whose parts are walls and free space in the given order.
    fn spectra(
        &self,
        station: &Upright,
        yaw: f32,
        walls_first: bool,
    ) -> ([Vec<Complex32>; 2], f32) {
        let (mut walls, free) = self.draw(station, yaw);
        let energy = walls.iter().map(Complex32::norm_sqr).sum();
        let mut conflicts: Vec<Complex32> = walls
            .iter()
            .zip(free)
            .map(|(wall, free)| {
                if walls_first {
                    Complex32::new(wall.norm(), free)
                } else {
                    Complex32::new(free, wall.norm())
                }
            })
            .collect();
        self.transform(&mut walls, &self.forward);
        self.transform(&mut conflicts, &self.forward);
        ([walls, conflicts], energy)
    }

    fn transform(&self, image: &mut [Complex32], fft: &Arc<dyn Fft<f32>>) {
        let side = self.plan.side;
        let mut scratch = vec![Complex32::default(); fft.get_inplace_scratch_len()];
        for _ in 0..2 {
            for line in image.chunks_mut(side) {
                fft.process_with_scratch(line, &mut scratch);
            }
            transpose(image, side);
        }
    }
}

fn transpose(image: &mut [Complex32], side: usize) {
    const TILE: usize = 32;
    for row0 in (0..side).step_by(TILE) {
        for column0 in (row0..side).step_by(TILE) {
            for row in row0..(row0 + TILE).min(side) {
                for column in column0.max(row + 1)..(column0 + TILE).min(side) {
                    image.swap(row * side + column, column * side + row);
                }
            }
        }
    }
}

/// How many placements are looked for.
#[derive(Clone, Copy, Debug)]
pub struct Wanted {
    /// Shifts a turn.
    pub shifts: usize,
    /// Shifts over all turns.
    pub places: usize,
    /// Heights a shift.
    pub heights: usize,
}

/// The best placements of `a` on `b` over the given turns about the vertical.
pub fn placements(
    a: &Upright,
    b: &Upright,
    yaws: &[f32],
    plan: Plan,
    wanted: Wanted,
) -> Vec<Placement> {
    let planner = Planner::new(plan);
    let side = plan.side;
    let (fixed, fixed_energy) = planner.spectra(b, 0.0, false);
    let signed = |index: usize| {
        if index > side / 2 {
            index as f32 - side as f32
        } else {
            index as f32
        }
    };
    let mut places: Vec<(usize, [f32; 2], f32)> = yaws
        .par_iter()
        .enumerate()
        .flat_map_iter(|(turn, &yaw)| {
            let (moving, energy) = planner.spectra(a, yaw, true);
            let scale =
                (fixed_energy * energy).sqrt().max(f32::MIN_POSITIVE) * (side * side) as f32;
            // The real part of a product of (walls + i free) with (free + i walls) is both ways' conflicts.
            let mut product: Vec<Complex32> = (0..side * side)
                .map(|i| {
                    fixed[0][i] * moving[0][i].conj() - fixed[1][i] * moving[1][i].conj() * CONFLICT
                })
                .collect();
            // Long walls slide along each other at no cost: a second plan, whitened, lets corners, doors and other
            // small features speak.
            let mut whitened: Vec<Complex32> = product
                .iter()
                .map(|value| value / value.norm().sqrt().max(f32::MIN_POSITIVE))
                .collect();
            planner.transform(&mut product, &planner.inverse);
            planner.transform(&mut whitened, &planner.inverse);
            let correlation: Vec<f32> = product.iter().map(|value| value.re / scale).collect();
            let sharp: Vec<f32> = whitened.iter().map(|value| value.re).collect();
            let mut cells = peaks(&correlation, side, wanted.shifts);
            let known: Vec<(usize, usize)> = cells.iter().map(|p| (p.0, p.1)).collect();
            cells.extend(
                peaks(&sharp, side, wanted.shifts / 2)
                    .into_iter()
                    .filter(|p| !known.contains(&(p.0, p.1)))
                    .map(|(row, column, _)| (row, column, correlation[row * side + column])),
            );
            cells.into_iter().map(move |(row, column, score)| {
                let shift = [signed(column) * plan.cell, signed(row) * plan.cell];
                (turn, shift, score)
            })
        })
        .collect();
    places.sort_by(|p, q| q.2.total_cmp(&p.2));
    places.truncate(wanted.places);
    let levels: Vec<Levels> = yaws
        .par_iter()
        .map(|&yaw| Levels::new(a, yaw, plan))
        .collect();
    let fixed_levels = Levels::new(b, 0.0, plan);
    places
        .par_iter()
        .flat_map_iter(|&(turn, [x, y], score)| {
            let yaw = yaws[turn];
            levels[turn]
                .heights(&fixed_levels, [x, y], wanted.heights)
                .into_iter()
                .map(move |(z, share)| Placement {
                    yaw,
                    shift: [x, y, z],
                    score: score * share,
                })
        })
        .collect()
}

fn peaks(correlation: &[f32], side: usize, count: usize) -> Vec<(usize, usize, f32)> {
    let line = |row: usize| &correlation[row * side..(row + 1) * side];
    let mut found: Vec<(usize, usize, f32)> = Vec::new();
    for row in 0..side {
        let lines = [
            line((row + side - 1) % side),
            line(row),
            line((row + 1) % side),
        ];
        for (column, &here) in lines[1].iter().enumerate() {
            if here <= 0.0 {
                continue;
            }
            let left = if column == 0 { side - 1 } else { column - 1 };
            let right = if column + 1 == side { 0 } else { column + 1 };
            if lines
                .iter()
                .all(|l| l[left] <= here && l[column] <= here && l[right] <= here)
            {
                found.push((row, column, here));
            }
        }
    }
    found.sort_by(|a, b| b.2.total_cmp(&a.2).then((a.0, a.1).cmp(&(b.0, b.1))));
    let mut kept: Vec<(usize, usize, f32)> = Vec::new();
    for peak in found {
        let apart = |a: usize, b: usize| a.abs_diff(b).min(side - a.abs_diff(b));
        if kept
            .iter()
            .all(|k| apart(k.0, peak.0) > PEAK_RADIUS || apart(k.1, peak.1) > PEAK_RADIUS)
        {
            kept.push(peak);
            if kept.len() == count {
                break;
            }
        }
    }
    kept
}

/// What stands at one height in a column of a plan.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Level {
    /// Surface that looks up.
    Floor,
    /// Surface that looks down.
    Ceiling,
    /// Where the upright surface ends: eaves are seen from afar, where the ground is not.
    WallTop,
}

/// The levels of a station by columns of its plan, heights in cells.
struct Levels {
    /// Edge of a column (m).
    coarse: f32,
    columns: FxHashMap<(i32, i32), Vec<(Level, i32)>>,
}

impl Levels {
    /// The levels of a station that is turned by `yaw`.
    fn new(station: &Upright, yaw: f32, plan: Plan) -> Self {
        let coarse = (4.0 * plan.cell).max(1.0);
        let (sin, cos) = yaw.sin_cos();
        let mut columns: FxHashMap<(i32, i32), Vec<(Level, i32)>> = FxHashMap::default();
        for (p, n) in station.points.iter().zip(&station.normals) {
            let level = match n[2] {
                up if up > LEVEL => Level::Floor,
                up if up < -LEVEL => Level::Ceiling,
                up if up.abs() <= UPRIGHT => Level::WallTop,
                _ => continue,
            };
            if p[0].hypot(p[1]) > plan.farthest {
                continue;
            }
            let (x, y) = (cos * p[0] - sin * p[1], sin * p[0] + cos * p[1]);
            let column = ((x / coarse).floor() as i32, (y / coarse).floor() as i32);
            let height = (p[2] / HEIGHT_CELL).floor() as i32;
            let levels = columns.entry(column).or_default();
            // However many surfels show it, a level of a column counts once: the ground at a scanner's feet would
            // outvote all that another scanner can see of it.
            match levels
                .iter_mut()
                .find(|known| known.0 == level && (level == Level::WallTop || known.1 == height))
            {
                Some(known) => known.1 = known.1.max(height),
                None => levels.push((level, height)),
            }
        }
        Self { coarse, columns }
    }

    /// Heights at which these levels, shifted, meet those of `other`, each with its share of all that meets at any
    /// height; best first.
    fn heights(&self, other: &Self, shift: [f32; 2], count: usize) -> Vec<(f32, f32)> {
        let [x, y] = shift.map(|length| (length / self.coarse).round() as i32);
        let mut histogram: BTreeMap<i32, f32> = BTreeMap::new();
        for (&(u, v), levels) in &self.columns {
            let Some(met) = other.columns.get(&(u + x, v + y)) else {
                continue;
            };
            for &(level, height) in levels {
                for &(_, other_height) in met.iter().filter(|other| other.0 == level) {
                    *histogram.entry(other_height - height).or_default() += 1.0 / met.len() as f32;
                }
            }
        }
        let smooth = |cell: i32| {
            [(-1, 0.5), (0, 1.0), (1, 0.5)]
                .iter()
                .map(|&(d, w)| w * histogram.get(&(cell + d)).unwrap_or(&0.0))
                .sum::<f32>()
        };
        let mut votes: Vec<(i32, f32)> =
            histogram.keys().map(|&cell| (cell, smooth(cell))).collect();
        votes.sort_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
        let all = histogram.values().sum::<f32>().max(1.0);
        let mut kept: Vec<(i32, f32)> = Vec::new();
        for (cell, vote) in votes {
            if kept.len() == count {
                break;
            }
            if kept.iter().all(|&(other, _)| (other - cell).abs() > 4) {
                kept.push((cell, vote / all));
            }
        }
        kept.into_iter()
            .map(|(cell, share)| (cell as f32 * HEIGHT_CELL, share))
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An L-shaped room with floor, ceiling and a pillar, seen from `(x, y)` at height `z` with a turn.
    fn room(x: f32, y: f32, z: f32, turn: f32) -> Upright {
        let mut surfaces: Vec<([f32; 3], [f32; 3])> = vec![];
        let corners = [
            (0.0, 0.0),
            (9.0, 0.0),
            (9.0, 4.0),
            (4.0, 4.0),
            (4.0, 7.0),
            (0.0, 7.0),
        ];
        for (i, &(x0, y0)) in corners.iter().enumerate() {
            let (x1, y1) = corners[(i + 1) % corners.len()];
            let (dx, dy) = (x1 - x0, y1 - y0);
            let length = f32::hypot(dx, dy);
            let steps = (length / 0.1) as usize;
            for k in 0..steps {
                let along = (k as f32 + 0.5) / steps as f32;
                for h in 0..30 {
                    let p = [x0 + along * dx, y0 + along * dy, 0.1 * (h as f32 + 0.5)];
                    surfaces.push((p, [-dy / length, dx / length, 0.0]));
                }
            }
        }
        for i in 0..40 {
            for j in 0..40 {
                let p = [0.1 * i as f32, 0.1 * j as f32];
                surfaces.push(([p[0], p[1], 0.0], [0.0, 0.0, 1.0]));
                surfaces.push(([p[0], p[1], 3.0], [0.0, 0.0, -1.0]));
            }
        }
        let (sin, cos) = turn.sin_cos();
        let turned = |v: [f32; 3]| [cos * v[0] + sin * v[1], -sin * v[0] + cos * v[1], v[2]];
        Upright {
            points: surfaces
                .iter()
                .map(|s| turned([s.0[0] - x, s.0[1] - y, s.0[2] - z]))
                .collect(),
            normals: surfaces.iter().map(|s| turned(s.1)).collect(),
            free: vec![0.0; 360],
        }
    }

    const PLAN: Plan = Plan {
        cell: 0.25,
        side: 128,
        farthest: 8.0,
    };

    const WANTED: Wanted = Wanted {
        shifts: 5,
        places: 20,
        heights: 2,
    };

    #[test]
    fn the_best_placement_is_the_truth() {
        let (a, b) = (room(2.0, 5.0, 1.5, 0.7), room(6.0, 2.0, 1.8, -0.4));
        let yaws = [0.3, 1.1, 1.1 + std::f32::consts::PI, 2.0];
        let mut found = placements(&a, &b, &yaws, PLAN, WANTED);
        found.sort_by(|p, q| q.score.total_cmp(&p.score));
        let best = found[0];
        // b's axes: the vector between the scanners turned by minus b's turn.
        let (sin, cos) = (-0.4_f32).sin_cos();
        let expected = [cos * -4.0 + sin * 3.0, -sin * -4.0 + cos * 3.0];
        assert_eq!(best.yaw, 1.1);
        assert!(
            (best.shift[0] - expected[0]).abs() < 0.3,
            "{:?} {expected:?}",
            best.shift
        );
        assert!((best.shift[1] - expected[1]).abs() < 0.3);
        let heights: Vec<f32> = found
            .iter()
            .filter(|p| p.score == best.score)
            .map(|p| (p.shift[2] - (1.5 - 1.8)).abs())
            .collect();
        assert!(heights.iter().any(|&off| off < 0.11), "{heights:?}");
        assert!(best.score > 0.5 && best.score <= 1.0);
    }

    #[test]
    fn where_no_floor_is_shared_wall_tops_say_at_which_height() {
        // Each sees the ground on its own side of the room only, and all of the walls up to their ends at 3 m.
        let own_floor = |station: Upright, east: bool, x: f32| {
            let (points, normals) = station
                .points
                .into_iter()
                .zip(station.normals)
                .filter(|(p, n)| n[2] == 0.0 || n[2] > 0.0 && (p[0] + x > 3.0) == east)
                .unzip();
            Upright {
                points,
                normals,
                free: station.free,
            }
        };
        let a = own_floor(room(2.0, 5.0, 1.5, 0.0), false, 2.0);
        let b = own_floor(room(6.0, 2.0, 1.8, 0.0), true, 6.0);
        let best = placements(&a, &b, &[0.0], PLAN, WANTED)
            .into_iter()
            .max_by(|p, q| p.score.total_cmp(&q.score))
            .expect("walls meet");
        for (found, expected) in best.shift.iter().zip([-4.0, 3.0, -0.3]) {
            assert!((found - expected).abs() < 0.26, "{:?}", best.shift);
        }
        assert!((best.shift[2] + 0.3).abs() < 0.11, "{:?}", best.shift);
    }

    #[test]
    fn transposing_twice_changes_nothing() {
        let side = 64;
        let mut image: Vec<Complex32> = (0..side * side)
            .map(|i| Complex32::new(i as f32, 0.0))
            .collect();
        let before = image.clone();
        transpose(&mut image, side);
        assert_eq!(image[1], before[side]);
        transpose(&mut image, side);
        assert_eq!(image, before);
    }
}
