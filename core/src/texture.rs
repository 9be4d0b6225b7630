//! A scan's surface as a mesh over its range image, and which of it a camera sees in each of its pixels.

use rayon::prelude::*;

use crate::range_image::{IndexImage, NO_POINT, median, noise_and_step};

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
/// Depths that differ by less than this many standard deviations of a range ...
const SAME_SIGMAS: f64 = 4.0;
/// ... or this share of a spacing are of one surface, measured several times: their mean is taken.
const SAME_SPACINGS: f64 = 0.25;
/// Rows of a picture that are worked on together.
const BAND: usize = 16;
/// Triangles that are looked at together.
const CHUNK: usize = 1 << 14;
/// Splats are not wider than so many pixels to each side.
const WIDEST_SPLAT: f32 = 48.0;

/// Triangles between neighbouring beams that met one surface, and the points where surfaces end.
pub struct Surface {
    /// The scan's points row by row, so that neighbours lie near each other in memory too, and behind them those put
    /// where a single beam among others on a surface was lost.
    pub points: Vec<[f32; 3]>,
    /// Which of the given points each of the scan's is.
    pub source: Vec<u32>,
    pub triangles: Vec<[u32; 3]>,
    /// Points beside which the surface ends: what lies behind them may be hidden up to half a spacing further.
    pub rim: Vec<u32>,
    /// Range from the scanner of each point (m).
    pub ranges: Vec<f32>,
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
    /// Whether neighbours at ranges `a` and `b` are of one surface; `before` and `after` are the beams beyond them.
    fn linked(&self, before: Option<f64>, a: f64, b: f64, after: Option<f64>, angle: f64) -> bool {
        if angle > GAP_STEPS * self.step {
            return false;
        }
        let apart = ((a - b).powi(2) + a * b * angle * angle).sqrt();
        if apart <= NEAR_SPACINGS * self.step * a.min(b) || apart <= BEND_SIGMAS * self.noise {
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
        let source = in_grid_order(&mut image, points.len());
        let points = taken(points, &source);
        let ranges: Vec<f32> = points.par_iter().map(range_of).collect();
        let (noise, _) = noise_and_step(&image, &points, &ranges);
        let points = bridged(&mut image, points, noise);
        let xyz = &points[..];
        let image = &image;
        let ranges: Vec<f32> = xyz.par_iter().map(range_of).collect();
        let (rows, columns) = (image.rows, image.columns);
        let at = |row: usize, column: usize| image.cells[row * columns + column % columns];
        let range = |index: u32| f64::from(ranges[index as usize]);
        let angle = |a: u32, b: u32| {
            let (p, q) = (xyz[a as usize], xyz[b as usize]);
            let apart2: f64 = (0..3).map(|k| f64::from(p[k] - q[k]).powi(2)).sum();
            let (ra, rb) = (range(a), range(b));
            ((apart2 - (ra - rb).powi(2)).max(0.0) / (ra * rb).max(1e-12)).sqrt()
        };
        let stride = (rows * columns / 100_000).max(1) | 1;
        let typical = |down: bool| {
            let mut found: Vec<f64> = (0..(rows - 1) * columns)
                .step_by(stride)
                .filter_map(|flat| {
                    let (row, column) = (flat / columns, flat % columns);
                    let (a, b) = if down {
                        (at(row, column), at(row + 1, column))
                    } else {
                        (at(row, column), at(row, column + 1))
                    };
                    (a != NO_POINT && b != NO_POINT).then(|| angle(a, b))
                })
                .collect();
            median(&mut found)
        };
        let down = Limits {
            step: typical(true),
            noise,
        };
        let across = Limits {
            step: typical(false),
            noise,
        };
        let seen = |index: u32| (index != NO_POINT).then(|| range(index));
        let linked = |limits: &Limits, before: u32, a: u32, b: u32, after: u32| {
            a != NO_POINT
                && b != NO_POINT
                && limits.linked(seen(before), range(a), range(b), seen(after), angle(a, b))
        };
        let across_links: Vec<bool> = (0..rows * columns)
            .into_par_iter()
            .map(|flat| {
                let (row, column) = (flat / columns, flat % columns);
                let before = at(row, column + columns - 1);
                linked(
                    &across,
                    before,
                    at(row, column),
                    at(row, column + 1),
                    at(row, column + 2),
                )
            })
            .collect();
        let down_links: Vec<bool> = (0..rows * columns)
            .into_par_iter()
            .map(|flat| {
                let (row, column) = (flat / columns, flat % columns);
                if row + 1 == rows {
                    return false;
                }
                let before = if row > 0 {
                    at(row - 1, column)
                } else {
                    NO_POINT
                };
                let after = if row + 2 < rows {
                    at(row + 2, column)
                } else {
                    NO_POINT
                };
                linked(&down, before, at(row, column), at(row + 1, column), after)
            })
            .collect();
        let triangles: Vec<[u32; 3]> = (0..(rows - 1) * columns)
            .into_par_iter()
            .flat_map_iter(|flat| {
                let (row, column) = (flat / columns, flat % columns);
                let next = (column + 1) % columns;
                let [a, b, c, d] = [
                    at(row, column),
                    at(row, next),
                    at(row + 1, next),
                    at(row + 1, column),
                ];
                let ab = across_links[flat];
                let dc = across_links[flat + columns];
                let ad = down_links[flat];
                let bc = down_links[row * columns + next];
                // Corners in order around the cell; a triangle needs the two sides that meet in its middle corner.
                let mut out: [Option<[u32; 3]>; 2] = [None, None];
                if ab && bc && dc && ad {
                    out = [Some([a, b, c]), Some([a, c, d])];
                } else if ab && bc {
                    out[0] = Some([a, b, c]);
                } else if bc && dc {
                    out[0] = Some([b, c, d]);
                } else if dc && ad {
                    out[0] = Some([c, d, a]);
                } else if ad && ab {
                    out[0] = Some([d, a, b]);
                }
                out.into_iter().flatten()
            })
            .collect();
        let rim: Vec<u32> = (0..rows * columns)
            .into_par_iter()
            .filter_map(|flat| {
                let here = image.cells[flat];
                if here == NO_POINT {
                    return None;
                }
                let (row, column) = (flat / columns, flat % columns);
                let left = (column + columns - 1) % columns;
                let ends = |linked: bool, other: u32| {
                    !linked && (other == NO_POINT || range(other) > range(here))
                };
                let beside = [
                    (across_links[flat], at(row, column + 1)),
                    (across_links[row * columns + left], at(row, left)),
                    (
                        row + 1 == rows || down_links[flat],
                        if row + 1 < rows {
                            at(row + 1, column)
                        } else {
                            here
                        },
                    ),
                    (
                        row == 0 || down_links[flat - columns],
                        if row > 0 { at(row - 1, column) } else { here },
                    ),
                ];
                beside
                    .into_iter()
                    .any(|(link, other)| ends(link, other))
                    .then_some(here)
            })
            .collect();
        Self {
            triangles,
            rim,
            ranges,
            step: down.step.max(across.step),
            range_noise: noise,
            points,
            source,
        }
    }
}

impl Surface {
    /// Points before a camera, and no farther from its axis than an angle of cosine `least` and `steps` steps between
    /// beams as they are seen from there.
    pub fn in_cone(&self, centre: [f32; 3], axis: [f32; 3], least: f32, steps: f32) -> Vec<u32> {
        let wider = steps * self.step as f32;
        (0..self.points.len())
            .into_par_iter()
            .filter(|&index| {
                let point = self.points[index];
                let offset: [f32; 3] = std::array::from_fn(|k| point[k] - centre[k]);
                let along: f32 = (0..3).map(|k| offset[k] * axis[k]).sum();
                along > 1e-6 && along + wider * self.ranges[index] >= least * range_of(&offset)
            })
            .map(|index| index as u32)
            .collect()
    }
}

fn taken(points: Vec<[f32; 3]>, which: &[u32]) -> Vec<[f32; 3]> {
    which.par_iter().map(|&p| points[p as usize]).collect()
}

/// Renumbers the points of an image in the order of its cells, those in none behind them; which was which.
fn in_grid_order(image: &mut IndexImage, count: usize) -> Vec<u32> {
    let mut source = Vec::with_capacity(count);
    let mut placed = vec![false; count];
    for cell in &mut image.cells {
        if *cell != NO_POINT {
            placed[*cell as usize] = true;
            source.push(*cell);
            *cell = source.len() as u32 - 1;
        }
    }
    source.extend((0..count as u32).filter(|&index| !placed[index as usize]));
    source
}

fn range_of(p: &[f32; 3]) -> f32 {
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

/// A picture's geometry: where each point falls, and where each pixel looks.
pub struct Picture<'a> {
    pub width: usize,
    pub height: usize,
    /// Camera's centre in the frame of the points.
    pub centre: [f32; 3],
    /// Unit direction of each pixel, row by row, in the axes of the points; NaN where the lens shows nothing.
    pub rays: &'a [[f32; 3]],
    /// Pixel (column, row) of each point, also outside the picture; NaN where the camera cannot show it.
    pub pixels: &'a [[f32; 2]],
    /// Distance of each point from the camera's centre (m).
    pub distances: &'a [f32],
    pub pixels_per_radian: f32,
    /// Columns after which the picture begins again: a full panorama.
    pub period: Option<f32>,
}

/// Distances from the camera (m) per pixel, infinite where nothing is known.
pub struct Depths {
    /// Of the surface that shows in the pixel's centre.
    pub surface: Vec<f32>,
    /// Of the nearest thing that may hide what lies behind: the surface, or the rim of one.
    pub nearest: Vec<f32>,
}

struct Drawn {
    corners: [[f32; 2]; 3],
    triangle: u32,
}

/// Draws the surface into a picture. The result does not depend on the number of threads.
pub fn draw(surface: &Surface, picture: &Picture) -> Depths {
    let (width, height) = (picture.width, picture.height);
    let hidden = |triangle: &[u32; 3]| picture.pixels[triangle[0] as usize][0].is_nan();
    let drawn: Vec<Drawn> = surface
        .triangles
        .par_chunks(CHUNK)
        .enumerate()
        .flat_map_iter(|(chunk, triangles)| {
            let indices = (chunk * CHUNK) as u32..;
            let shown = indices.zip(triangles).filter(|(_, t)| !hidden(t));
            shown.flat_map(|(index, triangle)| placed(picture, triangle, index))
        })
        .collect();
    let bands = height.div_ceil(BAND);
    let mut of_band: Vec<Vec<u32>> = vec![Vec::new(); bands];
    for (index, one) in drawn.iter().enumerate() {
        let rows = one.corners.map(|c| c[1]);
        let low = rows
            .iter()
            .copied()
            .fold(f32::INFINITY, f32::min)
            .ceil()
            .max(0.0) as usize;
        let high = rows
            .iter()
            .copied()
            .fold(f32::NEG_INFINITY, f32::max)
            .floor();
        if high < 0.0 || low >= height {
            continue;
        }
        let high = (high as usize).min(height - 1);
        if low > high {
            continue;
        }
        for list in &mut of_band[low / BAND..=high / BAND] {
            list.push(index as u32);
        }
    }
    let splats = splats(surface, picture, bands);

    let mut mean = vec![f32::INFINITY; width * height];
    let mut nearest = vec![f32::INFINITY; width * height];
    mean.par_chunks_mut(BAND * width)
        .zip(nearest.par_chunks_mut(BAND * width))
        .enumerate()
        .for_each(|(band, (mean, nearest))| {
            let first_row = band * BAND;
            let rows = mean.len() / width;
            for &index in &of_band[band] {
                fill(
                    &drawn[index as usize],
                    surface,
                    picture,
                    first_row,
                    rows,
                    |pixel, depth| {
                        if depth < nearest[pixel] {
                            nearest[pixel] = depth;
                        }
                    },
                );
            }
            let mut sum = vec![0.0_f64; mean.len()];
            let mut count = vec![0_u32; mean.len()];
            for &index in &of_band[band] {
                fill(
                    &drawn[index as usize],
                    surface,
                    picture,
                    first_row,
                    rows,
                    |pixel, depth| {
                        let same = (SAME_SIGMAS * surface.range_noise)
                            .max(SAME_SPACINGS * surface.step * f64::from(depth));
                        if f64::from(depth - nearest[pixel]) <= same {
                            sum[pixel] += f64::from(depth);
                            count[pixel] += 1;
                        }
                    },
                );
            }
            for pixel in 0..mean.len() {
                if count[pixel] > 0 {
                    mean[pixel] = (sum[pixel] / f64::from(count[pixel])) as f32;
                }
            }
            for &point in &splats[band] {
                let [x, y] = picture.pixels[point as usize];
                let (depth, radius) = (
                    picture.distances[point as usize],
                    splat_radius(surface, picture, point),
                );
                let top = (y - radius).ceil().max(first_row as f32) as usize;
                let bottom = (y + radius).floor().min((first_row + rows - 1) as f32);
                if bottom < top as f32 {
                    continue;
                }
                for row in top..=bottom as usize {
                    let half = (radius * radius - (row as f32 - y).powi(2)).max(0.0).sqrt();
                    let (from, to) = (
                        (x - half).ceil().max(0.0),
                        (x + half).floor().min((width - 1) as f32),
                    );
                    if to < from {
                        continue;
                    }
                    for column in from as usize..=to as usize {
                        let cell = &mut nearest[(row - first_row) * width + column];
                        *cell = cell.min(depth);
                    }
                }
            }
        });
    Depths {
        surface: mean,
        nearest,
    }
}

/// A triangle's corners in the picture; of a full panorama also one turn to each side, where that shows.
fn placed(
    picture: &Picture,
    triangle: &[u32; 3],
    index: u32,
) -> impl Iterator<Item = Drawn> + use<> {
    let mut corners = triangle.map(|p| picture.pixels[p as usize]);
    let mut shifts = [None, None, None];
    if corners.iter().flatten().all(|v| v.is_finite()) {
        shifts[0] = Some(0.0);
        if let Some(period) = picture.period {
            for k in 1..3 {
                let turns = ((corners[k][0] - corners[0][0]) / period).round();
                corners[k][0] -= turns * period;
            }
            let low = corners.iter().map(|c| c[0]).fold(f32::INFINITY, f32::min);
            let high = corners
                .iter()
                .map(|c| c[0])
                .fold(f32::NEG_INFINITY, f32::max);
            if low < 0.0 {
                shifts[1] = Some(period);
            }
            if high > picture.width as f32 - 1.0 {
                shifts[2] = Some(-period);
            }
        }
    }
    let (width, height) = (picture.width as f32, picture.height as f32);
    shifts.into_iter().flatten().filter_map(move |shift| {
        let corners = corners.map(|c| [c[0] + shift, c[1]]);
        let shows = |axis: usize, size: f32| {
            corners.iter().any(|c| c[axis] >= 0.0) && corners.iter().any(|c| c[axis] <= size - 1.0)
        };
        (shows(0, width) && shows(1, height)).then_some(Drawn {
            corners,
            triangle: index,
        })
    })
}

fn splat_radius(surface: &Surface, picture: &Picture, point: u32) -> f32 {
    let spacing = 0.5 * surface.step as f32 * surface.ranges[point as usize];
    (spacing / picture.distances[point as usize] * picture.pixels_per_radian)
        .clamp(0.5, WIDEST_SPLAT)
}

/// The rim points that reach into each band of rows.
fn splats(surface: &Surface, picture: &Picture, bands: usize) -> Vec<Vec<u32>> {
    let mut of_band = vec![Vec::new(); bands];
    for &point in &surface.rim {
        let [x, y] = picture.pixels[point as usize];
        if !(x.is_finite() && y.is_finite()) {
            continue;
        }
        let radius = splat_radius(surface, picture, point);
        if x + radius < 0.0 || x - radius > picture.width as f32 {
            continue;
        }
        let (low, high) = ((y - radius).ceil(), (y + radius).floor());
        if high < 0.0 || low > (picture.height - 1) as f32 || low > high {
            continue;
        }
        let (low, high) = (
            low.max(0.0) as usize,
            (high as usize).min(picture.height - 1),
        );
        for list in &mut of_band[low / BAND..=high / BAND] {
            list.push(point);
        }
    }
    of_band
}

/// Calls `put` with each pixel of a band whose centre lies in the triangle, and the distance along the pixel's ray.
fn fill(
    one: &Drawn,
    surface: &Surface,
    picture: &Picture,
    first_row: usize,
    rows: usize,
    mut put: impl FnMut(usize, f32),
) {
    let [a, b, c] = one.corners;
    let area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
    if area == 0.0 || !area.is_finite() {
        return;
    }
    let low = |k: usize| a[k].min(b[k]).min(c[k]);
    let high = |k: usize| a[k].max(b[k]).max(c[k]);
    let top = low(1).ceil().max(first_row as f32);
    let bottom = high(1).floor().min((first_row + rows - 1) as f32);
    let left = low(0).ceil().max(0.0);
    let right = high(0).floor().min((picture.width - 1) as f32);
    if bottom < top || right < left {
        return;
    }
    let corners = surface.triangles[one.triangle as usize];
    let depths = corners.map(|p| picture.distances[p as usize]);
    let [p, q, r] = corners.map(|p| surface.points[p as usize].map(f64::from));
    let (e, f) = (difference(q, p), difference(r, p));
    let normal = cross(e, f);
    let height = dot(normal, difference(p, picture.centre.map(f64::from)));
    let least = depths.iter().copied().fold(f32::INFINITY, f32::min);
    let most = depths.iter().copied().fold(0.0_f32, f32::max);
    for row in top as usize..=bottom as usize {
        for column in left as usize..=right as usize {
            let (x, y) = (column as f32, row as f32);
            let w0 = ((b[0] - x) * (c[1] - y) - (b[1] - y) * (c[0] - x)) / area;
            let w1 = ((c[0] - x) * (a[1] - y) - (c[1] - y) * (a[0] - x)) / area;
            let w2 = 1.0 - w0 - w1;
            const OUTSIDE: f32 = -1e-5;
            if w0 < OUTSIDE || w1 < OUTSIDE || w2 < OUTSIDE {
                continue;
            }
            let ray = picture.rays[row * picture.width + column].map(f64::from);
            let met = (height / dot(normal, ray)) as f32;
            // A triangle seen edge-on has no depth of its own along the ray: then its corners' are mixed.
            let depth = if met >= least && met <= most {
                met
            } else {
                1.0 / (w0 / depths[0] + w1 / depths[1] + w2 / depths[2])
            };
            if depth.is_finite() && ray[0].is_finite() {
                put((row - first_row) * picture.width + column, depth);
            }
        }
    }
}

fn difference(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    ]
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

#[cfg(test)]
mod tests {
    use super::*;

    const STEP: f64 = 0.01;
    const ROWS: usize = 60;
    const COLUMNS: usize = 80;

    /// A wall 5 m ahead, and before its middle columns a board 3 m ahead; the beam of `lost` had no return.
    fn wall_and_board(lost: Option<(usize, usize)>) -> (IndexImage, Vec<[f32; 3]>) {
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
        (IndexImage::from_grid(&rows, &columns).unwrap(), xyz)
    }

    fn seen_from(surface: &Surface, centre: [f32; 3], focal: f32) -> Depths {
        let (width, height) = (120, 90);
        let project = |p: &[f32; 3]| {
            let v: [f32; 3] = std::array::from_fn(|k| p[k] - centre[k]);
            [focal * v[0] / v[2] + 59.5, focal * v[1] / v[2] + 44.5]
        };
        let pixels: Vec<[f32; 2]> = surface.points.iter().map(project).collect();
        let distances: Vec<f32> = surface
            .points
            .iter()
            .map(|p| range_of(&std::array::from_fn(|k| p[k] - centre[k])))
            .collect();
        let rays: Vec<[f32; 3]> = (0..width * height)
            .map(|at| {
                let (x, y) = ((at % width) as f32, (at / width) as f32);
                let ray = [(x - 59.5) / focal, (y - 44.5) / focal, 1.0];
                ray.map(|v| v / range_of(&ray))
            })
            .collect();
        draw(
            surface,
            &Picture {
                width,
                height,
                centre,
                rays: &rays,
                pixels: &pixels,
                distances: &distances,
                pixels_per_radian: focal,
                period: None,
            },
        )
    }

    #[test]
    fn no_triangle_spans_the_jump() {
        let (image, xyz) = wall_and_board(None);
        let surface = Surface::new(image, xyz);
        assert!(surface.triangles.len() > 2 * (ROWS - 1) * (COLUMNS - 5));
        for triangle in &surface.triangles {
            let depths = triangle.map(|p| surface.points[p as usize][2]);
            assert!(depths.iter().all(|&d| (d - depths[0]).abs() < 0.1));
        }
    }

    #[test]
    fn every_pixel_knows_the_plane_it_shows() {
        let (image, xyz) = wall_and_board(None);
        let surface = Surface::new(image, xyz);
        let centre = [0.2, -0.1, 0.0];
        let depths = seen_from(&surface, centre, 200.0);
        let mut known = 0;
        for (at, &distance) in depths.surface.iter().enumerate() {
            if distance.is_finite() {
                let ray = [
                    ((at % 120) as f32 - 59.5) / 200.0,
                    ((at / 120) as f32 - 44.5) / 200.0,
                    1.0,
                ];
                let depth = distance / range_of(&ray);
                assert!(
                    (depth - 3.0).abs() < 1e-4 || (depth - 5.0).abs() < 1e-4,
                    "{depth}"
                );
                known += 1;
            }
        }
        assert!(known > 120 * 90 * 8 / 10, "{known}");
    }

    #[test]
    fn the_board_hides_half_a_spacing_more_than_its_mesh() {
        let (image, xyz) = wall_and_board(None);
        let surface = Surface::new(image, xyz);
        let depths = seen_from(&surface, [0.0; 3], 200.0);
        let before = |depths: &[f32]| depths.iter().filter(|&&d| d < 3.9).count();
        assert!(before(&depths.nearest) > before(&depths.surface) + 90);
        assert!(
            depths
                .nearest
                .iter()
                .zip(&depths.surface)
                .all(|(n, s)| n <= s)
        );
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

    #[test]
    fn the_number_of_threads_changes_nothing() {
        let run = |threads| {
            rayon::ThreadPoolBuilder::new()
                .num_threads(threads)
                .build()
                .unwrap()
                .install(|| {
                    let (image, xyz) = wall_and_board(None);
                    let surface = Surface::new(image, xyz);
                    let depths = seen_from(&surface, [0.2, -0.1, 0.0], 200.0);
                    (surface.triangles, depths.surface, depths.nearest)
                })
        };
        assert_eq!(run(1), run(3));
    }

    #[test]
    fn no_points_no_surface() {
        let surface = Surface::new(IndexImage::by_projection(&[], 0.01), Vec::new());
        assert!(surface.triangles.is_empty() && surface.rim.is_empty());
        let depths = seen_from(&surface, [0.0; 3], 100.0);
        assert!(depths.nearest.iter().all(|d| d.is_infinite()));
    }
}
