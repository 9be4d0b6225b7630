//! Which points a scan saw beside each other, told by their directions alone: for scans without the scanner's grid.
//!
//! Beams may be in rows and columns about any axis, in several sweeps, in rings, or what a thinning left of them: only
//! who is near whom in direction is used, never an order.

use std::f64::consts::{PI, TAU};
use std::ops::Range;

use nalgebra::{Vector2, Vector3};
use rayon::prelude::*;
use wide::{CmpLe, f32x4};

use crate::scan::mixed_points::{APART_SIGMAS, APART_SPACINGS, MixedPoints};
use crate::scan::range_image::{elevation_and_turn, even_step, median};

/// Beams that are wanted about a direction, its own among them.
const FEWEST: usize = 9;
/// Rings of cells that are looked through for them, at the most.
const RINGS: usize = 4;
/// Beams that are looked through for them, at the most: about the poles of a grid there may be thousands.
const CANDIDATES: usize = 96;
/// Variance of the neighbours' directions across over that along, below which they lie in one row.
const ONE_ROW: f64 = 0.02;
/// Angular spacing falls with the range to this power or more: the scan was thinned in space.
const THINNED_POWER: f64 = 0.3;
/// Cells of a run whose beams are counted.
const COUNTED: usize = 8;
/// Beams that noise and spacing are told from.
const SAMPLES: usize = 200_000;

/// Radians and cells that beams are projected along at once, at the most.
const WIDEST_RUN: f64 = 0.1;
const LONGEST_RUN: usize = 16;
/// Beams that are summed side by side.
const LANES: usize = 4;
/// On a plane of directions, next to nothing.
const FAR: f32 = 1e9;

#[derive(Clone, Copy)]
struct Beam {
    direction: [f32; 3],
    range: f32,
}

/// Beams by direction, in bands of equal height with cells of about equal size.
struct Cells {
    /// First cell of each band, and the number of cells at the end.
    bands: Vec<usize>,
    /// First beam of each cell, and the number of beams at the end.
    starts: Vec<u32>,
    /// Edge of a cell, about (rad).
    step: f64,
    /// By cell, and the point of each.
    beams: Vec<Beam>,
    points: Vec<u32>,
}

impl Cells {
    /// Cells of about `step` (rad) a side, of the points that are not at the scanner.
    fn new(xyz: &[[f32; 3]], step: f64) -> Self {
        let rows = ((PI / step).round() as usize).clamp(4, 1 << 13);
        let mut bands = vec![0];
        for row in 0..rows {
            let middle = ((row as f64 + 0.5) / rows as f64 - 0.5) * PI;
            let across = (TAU * middle.cos() / step).round().max(1.0) as usize;
            bands.push(bands[row] + across);
        }
        let cell_of: Vec<u32> = xyz.par_iter().map(|&p| cell_of(&bands, p)).collect();
        let mut starts = vec![0_u32; bands[rows] + 1];
        for &cell in cell_of.iter().filter(|&&cell| cell != u32::MAX) {
            starts[cell as usize + 1] += 1;
        }
        for cell in 1..starts.len() {
            starts[cell] += starts[cell - 1];
        }
        let mut next = starts.clone();
        let mut points = vec![0; starts[bands[rows]] as usize];
        for (point, &cell) in cell_of.iter().enumerate() {
            if cell != u32::MAX {
                let place = &mut next[cell as usize];
                points[*place as usize] = point as u32;
                *place += 1;
            }
        }
        let beams = points
            .par_iter()
            .map(|&point: &u32| beam(xyz[point as usize]));
        Self {
            beams: beams.collect(),
            bands,
            starts,
            step,
            points,
        }
    }

    fn beams_of(&self, cells: Range<usize>) -> Range<usize> {
        self.starts[cells.start] as usize..self.starts[cells.end] as usize
    }

    /// How the numbers of beams in runs of cells scatter, over how they would if directions were drawn at random.
    fn randomness(&self) -> f64 {
        let counts = |band: &[usize]| {
            let starts = (band[0]..band[1].saturating_sub(COUNTED)).step_by(COUNTED);
            let count = |start| self.beams_of(start..start + COUNTED).len() as f64;
            starts.map(count).collect::<Vec<_>>()
        };
        let apart = |two: &[f64]| (two[0] - two[1]).powi(2) / (two[0] + two[1]);
        let mut scatter: Vec<f64> = (self.bands.windows(2))
            .flat_map(|band| counts(band).windows(2).map(apart).collect::<Vec<_>>())
            .filter(|one| one.is_finite())
            .collect();
        if scatter.is_empty() {
            return 0.0;
        }
        // Half of a chi-squared of one degree of freedom lies below this.
        (median(&mut scatter) / 0.455).min(1.0)
    }

    /// The beams in the cells within `rings` of one, those of each band a range; evenly drawn where they are many.
    fn around(&self, row: usize, column: usize, rings: usize, found: &mut Vec<Range<usize>>) {
        found.clear();
        let turn = (column as f64 + 0.5) / (self.bands[row + 1] - self.bands[row]) as f64;
        for row in row.saturating_sub(rings)..=(row + rings).min(self.bands.len() - 2) {
            let (first, end) = (self.bands[row], self.bands[row + 1]);
            let across = end - first;
            let mut take = |cells| found.push(self.beams_of(cells));
            if across <= 2 * rings + 1 {
                take(first..end);
                continue;
            }
            let from = ((turn * across as f64) as usize + across - rings) % across;
            let to = from + 2 * rings + 1;
            take(first + from..first + to.min(across));
            if to > across {
                take(first..first + to - across);
            }
        }
        let count = count_of(found);
        if count > CANDIDATES {
            let mut some = found.iter().flat_map(Range::clone).enumerate();
            let even = (0..CANDIDATES).map(|kept| kept * count / CANDIDATES);
            let kept = even.filter_map(|at| some.find(|(index, _)| *index == at));
            *found = kept.map(|(_, beam)| beam..beam + 1).collect();
        }
    }

    /// What `work` makes of each beam and those about it, beams in the order of their cells.
    ///
    /// Cells are skipped where it wants none of the beams about them: `unknown` for their beams then, and where too few
    /// were seen about a direction.
    fn for_each<T: Copy + Send>(
        &self,
        unknown: T,
        wanted: impl Fn(&[Range<usize>]) -> bool + Sync,
        work: impl Fn(usize, &Around) -> T + Sync,
    ) -> Vec<T> {
        let mut made = vec![unknown; self.beams.len()];
        let block = ((WIDEST_RUN / self.step) as usize).clamp(1, LONGEST_RUN);
        let of_row = |(row, made): (usize, &mut [T])| {
            let (first, end) = (self.bands[row], self.bands[row + 1]);
            let before = self.beams_of(first..end).start;
            let mut around = Around::default();
            for start in (first..end).step_by(block) {
                let run = start..end.min(start + block);
                around.run.sections.clear();
                for cell in run.clone() {
                    let own = self.beams_of(cell..cell + 1);
                    if own.is_empty() {
                        continue;
                    }
                    self.around(row, cell - first, 1, &mut around.beams);
                    if !wanted(&around.beams) {
                        continue;
                    }
                    let mut rings = 1;
                    while rings < RINGS && count_of(&around.beams) < FEWEST {
                        rings += 1;
                        self.around(row, cell - first, rings, &mut around.beams);
                    }
                    if count_of(&around.beams) < FEWEST {
                        continue;
                    }
                    if around.run.sections.is_empty() {
                        around.run.project(self, row, run.clone());
                    }
                    around.gather(self);
                    let radius = rings as f64 * self.step;
                    for beam in own {
                        around.about(&self.beams[beam], radius as f32);
                        made[beam - before] = work(beam, &around);
                    }
                }
            }
        };
        let (mut rows, mut rest) = (Vec::new(), &mut made[..]);
        for band in self.bands.windows(2) {
            let row;
            (row, rest) = rest.split_at_mut(self.beams_of(band[0]..band[1]).len());
            rows.push(row);
        }
        rows.into_par_iter().enumerate().for_each(of_row);
        made
    }
}

fn count_of(beams: &[Range<usize>]) -> usize {
    beams.iter().map(Range::len).sum()
}

/// Cell of a point; `u32::MAX` at the scanner.
fn cell_of(bands: &[usize], p: [f32; 3]) -> u32 {
    let rows = bands.len() - 1;
    match elevation_and_turn(p) {
        None => u32::MAX,
        Some((elevation, turn)) => {
            let row = ((elevation * rows as f32) as usize).min(rows - 1);
            let across = bands[row + 1] - bands[row];
            (bands[row] + ((turn * across as f32) as usize).min(across - 1)) as u32
        }
    }
}

fn beam(p: [f32; 3]) -> Beam {
    let range = (p[0] * p[0] + p[1] * p[1] + p[2] * p[2]).sqrt();
    Beam {
        direction: p.map(|v| v / range),
        range,
    }
}

/// Beams on a plane that touches the sphere of directions, where inverse ranges over the cosine are linear over every plane
/// that is seen.
#[derive(Default)]
struct Projected {
    right: Vec<f32>,
    up: Vec<f32>,
    inverse: Vec<f32>,
}

impl Projected {
    fn clear(&mut self) {
        self.right.clear();
        self.up.clear();
        self.inverse.clear();
    }

    fn push(&mut self, [right, up, inverse]: [f32; 3]) {
        self.right.push(right);
        self.up.push(up);
        self.inverse.push(inverse);
    }

    fn extend(&mut self, other: &Self, part: Range<usize>) {
        self.right.extend_from_slice(&other.right[part.clone()]);
        self.up.extend_from_slice(&other.up[part.clone()]);
        self.inverse.extend_from_slice(&other.inverse[part]);
    }

    fn get(&self, at: usize) -> [f32; 3] {
        [self.right[at], self.up[at], self.inverse[at]]
    }
}

/// The beams about a run of cells of one band.
#[derive(Default)]
struct Run {
    /// The plane's normal, and its axes.
    frame: [Vector3<f32>; 3],
    /// Beams of this band and of those beside it, and where the first of them lies among the projected ones.
    sections: Vec<(Range<usize>, usize)>,
    projected: Projected,
}

impl Run {
    fn project(&mut self, cells: &Cells, row: usize, run: Range<usize>) {
        let turn = |cell: usize| {
            (cell - cells.bands[row]) as f64 / (cells.bands[row + 1] - cells.bands[row]) as f64
        };
        // The middle of the run, whatever the order of its beams.
        let (azimuth, elevation) = (
            PI * (turn(run.start) + turn(run.end) - 1.0),
            ((row as f64 + 0.5) / (cells.bands.len() - 1) as f64 - 0.5) * PI,
        );
        let (level, turned) = (elevation.cos(), (azimuth.cos(), azimuth.sin()));
        let direction =
            Vector3::new(level * turned.0, level * turned.1, elevation.sin()).cast::<f32>();
        let aside = if direction.z.abs() < 0.9 {
            Vector3::z()
        } else {
            Vector3::x()
        };
        let right = direction.cross(&aside).normalize();
        self.frame = [direction, right, right.cross(&direction)];
        self.sections.clear();
        self.projected.clear();
        for band in row.saturating_sub(1)..=(row + 1).min(cells.bands.len() - 2) {
            let (first, end) = (cells.bands[band], cells.bands[band + 1]);
            let at = |cell| first + (turn(cell) * (end - first) as f64) as usize;
            let beams =
                cells.beams_of(at(run.start).max(first + 1) - 1..(at(run.end) + 1).min(end));
            self.sections
                .push((beams.clone(), self.projected.right.len()));
            for beam in &cells.beams[beams] {
                self.projected.push(projected(&self.frame, beam));
            }
        }
    }

    /// Adds where some beams lie to `places`.
    fn add(&self, cells: &Cells, beams: &Range<usize>, places: &mut Projected) {
        let within =
            |one: &&(Range<usize>, usize)| one.0.start <= beams.start && beams.end <= one.0.end;
        match self.sections.iter().find(within) {
            Some((all, start)) => {
                let start = start + beams.start - all.start;
                places.extend(&self.projected, start..start + beams.len());
            }
            None => {
                for beam in &cells.beams[beams.clone()] {
                    places.push(projected(&self.frame, beam));
                }
            }
        }
    }
}

/// The beams about one.
#[derive(Default)]
struct Around {
    run: Run,
    beams: Vec<Range<usize>>,
    projected: Projected,
    /// The same of the beam itself, its range (m), and the square within which others are next to it.
    own: [f32; 3],
    range: f32,
    square: f32,
}

/// How a beam lies to those beside it.
#[derive(Clone, Copy)]
struct Fit {
    /// Off the plane through its neighbours, along the ray (m), and the standard deviation of that where ranges have one
    /// of 1.
    off: f32,
    sigma: f32,
    /// Side of the square that it has to itself (rad).
    spacing: f32,
}

impl Fit {
    /// Of a beam that is alone.
    const UNKNOWN: Self = Self {
        off: 0.0,
        sigma: 1.0,
        spacing: f32::NAN,
    };
}

impl Around {
    /// Takes the beams' places from those about the run.
    fn gather(&mut self, cells: &Cells) {
        self.projected.clear();
        for beams in &self.beams {
            self.run.add(cells, beams, &mut self.projected);
        }
        // Beams that are next to none fill the last lanes.
        while !self.projected.right.len().is_multiple_of(LANES) {
            self.projected.push([FAR, FAR, 0.0]);
        }
    }

    /// Turns to a beam.
    fn about(&mut self, beam: &Beam, radius: f32) {
        self.own = projected(&self.run.frame, beam);
        self.range = beam.range;
        self.square = radius * radius;
    }

    /// The inverse ranges of a plane are linear in direction, however oblique the plane is: a linear fit to the neighbours
    /// says where the beam should end.
    fn fit(&self) -> Fit {
        let [right, up, inverse] = self.own;
        let scale = self.range / inverse;
        let [right, up, range, scale, square] =
            [right, up, self.range, scale, self.square].map(f32x4::splat);
        let mut sums = [f32x4::ZERO; 9];
        let lanes = |values: &[f32]| f32x4::new([values[0], values[1], values[2], values[3]]);
        let Projected {
            right: rights,
            up: ups,
            inverse: inverses,
        } = &self.projected;
        let places = rights.chunks_exact(LANES).zip(ups.chunks_exact(LANES));
        for ((rights, ups), inverses) in places.zip(inverses.chunks_exact(LANES)) {
            let (x, y) = (lanes(rights) - right, lanes(ups) - up);
            let next = (x * x + y * y).cmp_le(square);
            let behind = range - scale * lanes(inverses);
            let (x, y) = (next & x, next & y);
            let terms = [
                next & f32x4::ONE,
                x,
                y,
                next & behind,
                x * x,
                x * y,
                y * y,
                x * behind,
                y * behind,
            ];
            for (sum, term) in sums.iter_mut().zip(terms) {
                *sum += term;
            }
        }
        let sums = sums.map(|lanes| f64::from(lanes.reduce_add()));
        // The beam itself is among them, with nothing but a one.
        let [count, x, y, behind, xx, xy, yy, xb, yb] = sums;
        let count = count - 1.0;
        if count < 1.0 {
            return Fit::UNKNOWN;
        }
        let (x, y, behind) = (x / count, y / count, behind / count);
        let (xx, xy, yy) = (xx - count * x * x, xy - count * x * y, yy - count * y * y);
        let product = Vector2::new(xb - count * x * behind, yb - count * y * behind);
        let centre = Vector2::new(x, y);
        let (both, determinant) = (xx + yy, xx * yy - xy * xy);
        // A row tells nothing across itself.
        let towards = if determinant > ONE_ROW / (1.0 + ONE_ROW).powi(2) * both * both {
            Vector2::new(yy * x - xy * y, xx * y - xy * x) / determinant
        } else if both > 0.0 {
            let long = 0.5 * both + (0.25 * both * both - determinant).max(0.0).sqrt();
            let along = if xx > yy {
                Vector2::new(long - yy, xy)
            } else {
                Vector2::new(xy, long - xx)
            };
            along * (along.dot(&centre) / (along.norm_squared() * long))
        } else {
            Vector2::zeros()
        };
        Fit {
            off: (behind - towards.dot(&product)) as f32,
            sigma: (1.0 + 1.0 / count + towards.dot(&centre)).sqrt() as f32,
            spacing: (PI * f64::from(self.square) / (count + 1.0)).sqrt() as f32,
        }
    }

    /// Whether the beam `at` is of no surface: alone at its range, or between a nearer and a farther edge on either side.
    fn mixed(&self, at: usize, edges: &[bool], limit: f32) -> bool {
        let [right, up, inverse] = self.own;
        let scale = self.range / inverse;
        let (mut alone, mut nearer, mut farther) = (edges[at], Vec::new(), Vec::new());
        for (index, beam) in self.beams.iter().flat_map(Range::clone).enumerate() {
            let [to_right, to_up, of_inverse] = self.projected.get(index);
            let place = Vector2::new(to_right - right, to_up - up);
            if beam == at || place.norm_squared() > self.square {
                continue;
            }
            let behind = self.range - scale * of_inverse;
            alone &= behind.abs() > limit;
            if edges[beam] && behind.abs() > limit {
                (if behind < 0.0 {
                    &mut nearer
                } else {
                    &mut farther
                })
                .push(place);
            }
        }
        alone
            || nearer
                .iter()
                .any(|near| farther.iter().any(|far| near.dot(far) < 0.0))
    }
}

fn projected(frame: &[Vector3<f32>; 3], beam: &Beam) -> [f32; 3] {
    let direction = Vector3::from(beam.direction);
    let [along, right, up] = frame.map(|axis| axis.dot(&direction));
    let along = along.max(0.1);
    [right / along, up / along, 1.0 / (along * beam.range)]
}

/// Finds mixed points, range noise and spacing from directions.
pub fn mixed_by_direction(xyz: &[[f32; 3]]) -> MixedPoints {
    let cells = Cells::new(xyz, even_step(xyz));
    let fits = cells.for_each(Fit::UNKNOWN, |_| true, |_, around| around.fit());

    let stride = (fits.len() / SAMPLES).max(1);
    let sampled = || {
        (fits.iter().zip(&cells.beams))
            .step_by(stride)
            .filter(|(fit, _)| fit.spacing.is_finite())
            .map(|(fit, beam)| (*fit, f64::from(beam.range)))
    };
    let mut offs: Vec<f64> = sampled()
        .map(|(fit, _)| f64::from(fit.off.abs() / fit.sigma))
        .collect();
    let range_noise = 1.4826 * median(&mut offs);
    let spacing = angular_step(
        sampled()
            .map(|(fit, range)| (range, f64::from(fit.spacing)))
            .collect(),
    );
    // Beams of a pattern keep clear of each other, so that one and its neighbours share the square of all; where they
    // are drawn at random, there are as many neighbours about one as about any direction.
    let own = cells.randomness() * spacing * spacing / (PI * cells.step * cells.step);
    let step = spacing / (1.0 - own.min(0.5)).sqrt();

    let least = |spacing: f64, range: f64| APART_SPACINGS * spacing * range;
    let edges: Vec<bool> = (fits.par_iter().zip(&cells.beams))
        .map(|(fit, beam)| {
            let noise = APART_SIGMAS * f64::from(fit.sigma) * range_noise;
            f64::from(fit.off.abs())
                > noise.max(least(f64::from(fit.spacing), f64::from(beam.range)))
        })
        .collect();
    let mixed = cells.for_each(
        false,
        |about| {
            about
                .iter()
                .any(|beams| edges[beams.clone()].contains(&true))
        },
        |beam, around| {
            let spacing = f64::from(fits[beam].spacing);
            let limit = (APART_SIGMAS * range_noise).max(least(spacing, f64::from(around.range)));
            around.mixed(beam, &edges, limit as f32)
        },
    );
    let mut of_point = vec![false; xyz.len()];
    for (&point, mixed) in cells.points.iter().zip(mixed) {
        of_point[point as usize] = mixed;
    }
    MixedPoints {
        mixed: of_point,
        range_noise,
        step,
    }
}

/// Median spacing (rad); NaN where points are even in space instead of in angle, from ranges and spacings.
fn angular_step(mut of_range: Vec<(f64, f64)>) -> f64 {
    let third = of_range.len() / 3;
    if third == 0 {
        return f64::NAN;
    }
    of_range.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)));
    let middle = |part: &[(f64, f64)]| {
        let mut spacings: Vec<f64> = part.iter().map(|one| one.1).collect();
        (part[part.len() / 2].0, median(&mut spacings))
    };
    let (near, at_near) = middle(&of_range[..third]);
    let (far, at_far) = middle(&of_range[of_range.len() - third..]);
    let power = (at_near / at_far).ln() / (far / near).ln();
    if far > 1.2 * near && power > THINNED_POWER {
        return f64::NAN;
    }
    middle(&of_range).1
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Rotation3;

    const NOISE: f64 = 0.003;

    /// Uniform numbers, the same in each run.
    struct Draw(u64);

    impl Draw {
        fn uniform(&mut self) -> f64 {
            self.0 = (self.0)
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            (self.0 >> 11) as f64 / (1_u64 << 53) as f64
        }

        fn normal(&mut self) -> f64 {
            (0..12).map(|_| self.uniform()).sum::<f64>() - 6.0
        }
    }

    /// Directions of a part of the sphere, by patterns that scanners and programs leave.
    fn directions(pattern: &str) -> Vec<Vector3<f64>> {
        let mut draw = Draw(5);
        let polar = |azimuth: f64, elevation: f64| {
            let level = elevation.cos();
            Vector3::new(
                level * azimuth.cos(),
                level * azimuth.sin(),
                elevation.sin(),
            )
        };
        let grid = |across: f64, up: f64, shift: f64| {
            let (columns, rows) = ((100.0 / across) as i32, (80.0 / up) as i32);
            let angle = move |k: i32, step: f64| (step * (f64::from(k) + shift)).to_radians();
            let row =
                move |r| (0..columns).map(move |c| polar(angle(c, across), angle(r, up) - 0.7));
            (0..rows).flat_map(row).collect::<Vec<_>>()
        };
        match pattern {
            "regular" => grid(0.4, 0.4, 0.0),
            "tilted" => {
                let turn = Rotation3::from_euler_angles(0.2, -0.3, 0.0);
                grid(0.4, 0.4, 0.0).into_iter().map(|d| turn * d).collect()
            }
            "rings" => grid(0.2, 0.8, 0.0),
            "two sweeps" => [grid(0.55, 0.55, 0.0), grid(0.55, 0.55, 0.37)].concat(),
            "random" => (0..50_000)
                .map(|_| {
                    let low = (-0.7_f64).sin();
                    let z = low + ((80_f64.to_radians() - 0.7).sin() - low) * draw.uniform();
                    polar(100_f64.to_radians() * draw.uniform(), z.asin())
                })
                .collect(),
            _ => unreachable!(),
        }
    }

    /// A floor, two walls and a board before one of them: range, and whether the beam, of some width, falls on two of them.
    fn scene(direction: &Vector3<f64>) -> (f64, bool) {
        let behind = [
            (direction.z < 0.0).then(|| -1.6 / direction.z),
            (direction.x > 0.0).then(|| 7.0 / direction.x),
            (direction.y > 0.0).then(|| 9.0 / direction.y),
        ];
        let behind = behind.into_iter().flatten().fold(f64::INFINITY, f64::min);
        let board = 3.0 / direction.x;
        let place = direction * board;
        let inside = 1.0 - (place.y - 2.0).abs().max((place.z - 0.3).abs());
        let width = 0.004 * board;
        if direction.x <= 0.0 || inside < -width {
            (behind, false)
        } else if inside > width {
            (board, false)
        } else {
            (
                board + (behind - board) * (0.5 - 0.5 * inside / width),
                true,
            )
        }
    }

    fn scan(pattern: &str) -> (Vec<[f32; 3]>, Vec<bool>) {
        let mut draw = Draw(11);
        let beams = directions(pattern).into_iter().map(|direction| {
            let (range, mixed) = scene(&direction);
            let point = direction * (range + NOISE * draw.normal());
            (<[f32; 3]>::from(point.map(|v| v as f32)), mixed)
        });
        beams.unzip()
    }

    #[test]
    fn mixed_points_are_found_and_edges_stay_whatever_the_pattern() {
        for pattern in ["regular", "tilted", "rings", "two sweeps", "random"] {
            let (xyz, mixed) = scan(pattern);
            let found = mixed_by_direction(&xyz);
            let of = |wanted: bool| {
                let those = (found.mixed.iter().zip(&mixed)).filter(|one| *one.1 == wanted);
                let (all, hits) = those.fold((0, 0), |n, one| (n.0 + 1, n.1 + usize::from(*one.0)));
                (all, f64::from(hits as u32) / f64::from(all))
            };
            let (count, share) = of(true);
            assert!(count > 100, "{pattern}: {count}");
            assert!(
                share > 0.6,
                "{pattern}: {share} of the mixed points are found"
            );
            assert!(
                of(false).1 < 0.01,
                "{pattern}: {} of the true points",
                of(false).1
            );
            let noise = found.range_noise / NOISE;
            assert!(
                (0.8..1.25).contains(&noise),
                "{pattern}: noise {noise} of the true one"
            );
            let solid =
                100_f64.to_radians() * ((80_f64.to_radians() - 0.7).sin() - (-0.7_f64).sin());
            let step = found.step / (solid / xyz.len() as f64).sqrt();
            assert!(
                (0.85..1.2).contains(&step)
                    && (pattern != "random" || (0.95..1.05).contains(&step)),
                "{pattern}: step {step} of the even one"
            );
        }
    }

    #[test]
    fn any_order_of_points_gives_the_same() {
        let (xyz, _) = scan("tilted");
        let found = mixed_by_direction(&xyz);
        let count = xyz.len();
        let place = |index: usize| index * 7919 % count;
        let shuffled: Vec<[f32; 3]> = (0..count).map(|index| xyz[place(index)]).collect();
        let other = mixed_by_direction(&shuffled);
        let differ = (0..count).filter(|&index| other.mixed[index] != found.mixed[place(index)]);
        assert_eq!(differ.count(), 0);
        assert!((other.range_noise / found.range_noise - 1.0).abs() < 1e-3);
    }

    #[test]
    fn a_scan_thinned_in_space_has_no_angular_step() {
        let (xyz, _) = scan("regular");
        let mut taken = rustc_hash::FxHashSet::default();
        let voxel = |p: &[f32; 3]| p.map(|v| (v / 0.1).floor() as i32);
        let thinned: Vec<[f32; 3]> = xyz.into_iter().filter(|p| taken.insert(voxel(p))).collect();
        assert!(mixed_by_direction(&thinned).step.is_nan());
    }

    #[test]
    fn many_points_in_one_direction_and_none_at_all_are_dealt_with() {
        let along: Vec<[f32; 3]> = (0..200_000)
            .map(|i| [1.0 + i as f32 * 1e-5, 0.0, 0.0])
            .collect();
        assert_eq!(mixed_by_direction(&along).mixed.len(), along.len());
        assert!(mixed_by_direction(&[]).mixed.is_empty());
        assert!(!mixed_by_direction(&[[0.0; 3], [1.0, 0.0, 0.0]]).mixed[0]);
    }
}
