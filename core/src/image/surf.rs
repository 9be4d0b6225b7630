//! SURF keypoints and descriptors, after Bay, Ess, Tuytelaars and Van Gool, "Speeded-Up Robust Features (SURF)",
//! Computer Vision and Image Understanding 110 (2008).
//!
//! Every filter is a sum of boxes on the integral image, which holds whole numbers: sums are exact, and keypoints are
//! worked on one by one, so the result does not depend on the number of threads.

use nalgebra::{Matrix3, Vector3};
use rayon::prelude::*;

/// What is found and how it is described.
#[derive(Clone, Copy, Debug)]
pub struct Options {
    /// Each doubles the filter sizes and the sampling distance.
    pub octaves: usize,
    /// Least determinant of the Hessian, for grey values in 0..1.
    pub threshold: f32,
    /// Keypoints keep the picture's own axes.
    pub upright: bool,
    /// 128 values instead of 64: sums are kept apart by the sign of the other axis.
    pub extended: bool,
    /// Keypoints at the most, the strongest.
    pub most: usize,
}

/// A blob.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Keypoint {
    /// Pixels; pixel centres at integers.
    pub x: f32,
    pub y: f32,
    /// Sigma of the Gaussian that the filter stands for (pixels).
    pub scale: f32,
    /// Orientation (rad), from x towards y; 0 for upright keypoints.
    pub angle: f32,
    /// Determinant of the Hessian.
    pub strength: f32,
    /// The blob is bright on dark (-1) or dark on bright (1): sign of the Laplacian.
    pub sign: f32,
}

/// Sums of all pixels above and left of a place.
///
/// They wrap around in large pictures; the sum of a box is right all the same, as long as it fits itself.
pub struct Integral {
    width: usize,
    height: usize,
    sums: Vec<u32>,
}

impl Integral {
    /// From grey values, row-major.
    ///
    /// # Panics
    /// If the number of pixels is not width times height.
    pub fn new(pixels: &[u8], width: usize, height: usize) -> Self {
        assert_eq!(pixels.len(), width * height, "pixels of a picture");
        let stride = width + 1;
        let mut sums = vec![0_u32; stride * (height + 1)];
        for y in 0..height {
            let (above, below) = sums.split_at_mut((y + 1) * stride);
            let above = &above[y * stride + 1..];
            let mut row_sum = 0_u32;
            for ((sum, &above), &pixel) in below[1..stride]
                .iter_mut()
                .zip(above)
                .zip(&pixels[y * width..])
            {
                row_sum = row_sum.wrapping_add(u32::from(pixel));
                *sum = above.wrapping_add(row_sum);
            }
        }
        Self {
            width,
            height,
            sums,
        }
    }

    /// Sums before pixel row `y`.
    fn row(&self, y: usize) -> &[u32] {
        let stride = self.width + 1;
        &self.sums[y * stride..(y + 1) * stride]
    }

    /// Sum of the pixels of rows `top..bottom` and columns `left..right`.
    pub fn sum(&self, left: usize, top: usize, right: usize, bottom: usize) -> u32 {
        let (top, bottom) = (self.row(top), self.row(bottom));
        bottom[right]
            .wrapping_sub(bottom[left])
            .wrapping_sub(top[right])
            .wrapping_add(top[left])
    }

    /// Haar wavelets along x and y of side `2 half`, centred on the corner before pixel (x, y); `None` outside.
    fn haar(&self, x: i32, y: i32, half: i32) -> Option<(f32, f32)> {
        if x < half || y < half || x + half > self.width as i32 || y + half > self.height as i32 {
            return None;
        }
        let (x, y, half) = (x as usize, y as usize, half as usize);
        let (top, middle, bottom) = (self.row(y - half), self.row(y), self.row(y + half));
        let at = |row: &[u32], x: usize| row[x];
        let (a, b, c) = (at(top, x - half), at(top, x), at(top, x + half));
        let (d, e) = (at(middle, x - half), at(middle, x + half));
        let (f, g, h) = (at(bottom, x - half), at(bottom, x), at(bottom, x + half));
        let whole = h.wrapping_sub(c).wrapping_sub(f).wrapping_add(a) as i32;
        let left = g.wrapping_sub(b).wrapping_sub(f).wrapping_add(a) as i32;
        let upper = e.wrapping_sub(c).wrapping_sub(d).wrapping_add(a) as i32;
        Some(((whole - 2 * left) as f32, (whole - 2 * upper) as f32))
    }
}

/// The approximation of the Gaussians by boxes makes the mixed derivative too great by this (the paper's w).
const MIXED: f32 = 0.9;
/// Filters of an octave; extrema are sought in the inner ones.
const LAYERS: usize = 4;
/// Side of the least filter, which stands for `LEAST_SIGMA`.
const LEAST_SIDE: usize = 9;
const LEAST_SIGMA: f32 = 1.2;

/// Side of the filter of an octave's layer: 9, 15, 21, 27; 15, 27, 39, 51; 27, 51, ...
pub fn filter_side(octave: usize, layer: usize) -> usize {
    3 * ((2 << octave) * (layer + 1) + 1)
}

/// Determinants of the Hessian of one layer, sampled every `step` pixels; 0 where the filter leaves the picture.
struct Layer {
    columns: usize,
    /// Samples nearer than this to a border have no response.
    border: usize,
    values: Vec<f32>,
}

impl Layer {
    fn new(integral: &Integral, side: usize, step: usize) -> Self {
        let (columns, rows) = (
            integral.width.div_ceil(step),
            integral.height.div_ceil(step),
        );
        let mut values = vec![0.0; columns * rows];
        let reach = side / 2;
        if integral.width >= side && integral.height >= side {
            let inner = integral.width - side + 1;
            values.par_chunks_mut(columns).enumerate().for_each_init(
                || [vec![0.0; inner], vec![0.0; inner]],
                |[determinants, second], (row, values)| {
                    let y = row * step;
                    if y < reach || y + reach >= integral.height {
                        return;
                    }
                    determinant_row(integral, side, y, determinants, second);
                    let first = reach.div_ceil(step);
                    for (value, x) in values[first..]
                        .iter_mut()
                        .zip((first * step..).step_by(step))
                    {
                        let Some(&determinant) = determinants.get(x - reach) else {
                            break;
                        };
                        *value = determinant;
                    }
                },
            );
        }
        Self {
            columns,
            border: reach.div_ceil(step),
            values,
        }
    }

    /// Every second sample of every second row.
    fn halved(&self, rows: usize, side: usize, step: usize) -> Self {
        let columns = self.columns.div_ceil(2);
        let mut values = Vec::with_capacity(columns * rows.div_ceil(2));
        for row in self.values.chunks(self.columns).step_by(2) {
            values.extend(row.iter().step_by(2));
        }
        Self {
            columns,
            border: (side / 2).div_ceil(step),
            values,
        }
    }

    fn rows(&self) -> usize {
        self.values.len() / self.columns.max(1)
    }
}

/// Determinants along row `y`, for every x where the filter fits.
fn determinant_row(
    integral: &Integral,
    side: usize,
    y: usize,
    out: &mut [f32],
    second: &mut [f32],
) {
    let (reach, lobe) = (side / 2, side / 3);
    let half_lobe = lobe / 2;
    let inner = out.len();
    // The filter's centre in the first place is at x = reach; a cut before pixel x = reach + k.
    let cut = |row: usize, k: isize| {
        let first = (reach as isize + k) as usize;
        &integral.row(row)[first..first + inner]
    };
    let box_sums =
        |target: &mut [f32], rows: [usize; 2], columns: [isize; 2], weight: f32, add: bool| {
            let (a, b) = (cut(rows[0], columns[0]), cut(rows[0], columns[1]));
            let (c, d) = (cut(rows[1], columns[0]), cut(rows[1], columns[1]));
            let sums = a
                .iter()
                .zip(b)
                .zip(c.iter().zip(d))
                .map(|((a, b), (c, d))| {
                    weight * d.wrapping_sub(*c).wrapping_sub(*b).wrapping_add(*a) as i32 as f32
                });
            if add {
                target.iter_mut().zip(sums).for_each(|(t, s)| *t += s);
            } else {
                target.iter_mut().zip(sums).for_each(|(t, s)| *t = s);
            }
        };
    let scale = 1.0 / (255.0 * (side * side) as f32);
    let (r, l, h) = (reach as isize, lobe as isize, half_lobe as isize);
    // Along y: three lobes, 1 -2 1, each `lobe` high and 2 lobe - 1 wide; along x the same, turned.
    box_sums(out, [y - reach, y + reach + 1], [1 - l, l], scale, false);
    box_sums(
        out,
        [y - half_lobe, y + half_lobe + 1],
        [1 - l, l],
        -3.0 * scale,
        true,
    );
    box_sums(second, [y + 1 - lobe, y + lobe], [-r, r + 1], scale, false);
    box_sums(
        second,
        [y + 1 - lobe, y + lobe],
        [-h, h + 1],
        -3.0 * scale,
        true,
    );
    out.iter_mut()
        .zip(second.iter())
        .for_each(|(yy, xx)| *yy *= xx);
    // Mixed: four squares around the centre's row and column.
    let mixed = MIXED * scale;
    box_sums(second, [y - lobe, y], [-l, 0], mixed, false);
    box_sums(second, [y + 1, y + 1 + lobe], [1, l + 1], mixed, true);
    box_sums(second, [y - lobe, y], [1, l + 1], -mixed, true);
    box_sums(second, [y + 1, y + 1 + lobe], [-l, 0], -mixed, true);
    out.iter_mut()
        .zip(second.iter())
        .for_each(|(det, xy)| *det -= xy * xy);
}

/// Determinant of the Hessian at every pixel for one filter side, row-major; 0 where the filter leaves the picture.
pub fn determinants(integral: &Integral, side: usize) -> Vec<f32> {
    Layer::new(integral, side, 1).values
}

/// Blobs of the picture, the strongest first; orientation not yet known.
///
/// `mask`, row-major, says at which pixels keypoints may lie.
pub fn detect(integral: &Integral, mask: Option<&[bool]>, options: &Options) -> Vec<Keypoint> {
    let mut found = Vec::new();
    let mut layers: Vec<Layer> = Vec::new();
    for octave in 0..options.octaves {
        let step = 1 << octave;
        let side = |layer: usize| filter_side(octave, layer);
        if integral.width.min(integral.height) < side(2) + 2 * step {
            break;
        }
        let rows = layers.first().map_or(0, Layer::rows);
        let fresh = |layer: usize| Layer::new(integral, side(layer), step);
        layers = if octave == 0 {
            (0..LAYERS).map(fresh).collect()
        } else {
            let kept = [1, 3].map(|k: usize| layers[k].halved(rows, side(k / 2), step));
            kept.into_iter().chain([fresh(2), fresh(3)]).collect()
        };
        for inner in 1..LAYERS - 1 {
            found.extend(extrema(
                &layers[inner - 1..=inner + 1],
                octave,
                inner,
                options,
            ));
        }
    }
    found.retain(|keypoint| {
        let (x, y) = (keypoint.x.round() as usize, keypoint.y.round() as usize);
        mask.is_none_or(|mask| mask[y * integral.width + x])
    });
    found.sort_by(|a, b| {
        b.strength
            .total_cmp(&a.strength)
            .then(a.y.total_cmp(&b.y))
            .then(a.x.total_cmp(&b.x))
            .then(a.scale.total_cmp(&b.scale))
    });
    found.truncate(options.most);
    for keypoint in &mut found {
        keypoint.sign = laplacian_sign(integral, keypoint);
    }
    found
}

/// Maxima over the 26 neighbours in place and scale, refined to fractions of a sample.
fn extrema(layers: &[Layer], octave: usize, inner: usize, options: &Options) -> Vec<Keypoint> {
    let [below, here, above] = layers else {
        return Vec::new();
    };
    let border = above.border + 1;
    let (columns, rows) = (here.columns, here.rows());
    if columns <= 2 * border || rows <= 2 * border {
        return Vec::new();
    }
    (border..rows - border)
        .into_par_iter()
        .flat_map_iter(|row| {
            (border..columns - border).filter_map(move |column| {
                let at = row * columns + column;
                let value = here.values[at];
                if value <= options.threshold {
                    return None;
                }
                let around = |layer: &Layer, same: bool| {
                    [at - columns, at, at + columns].into_iter().all(|middle| {
                        (middle - 1..=middle + 1)
                            .all(|k| (same && k == at) || layer.values[k] < value)
                    })
                };
                if !(around(here, true) && around(above, false) && around(below, false)) {
                    return None;
                }
                refined([below, here, above], at, row, column, octave, inner)
            })
        })
        .collect()
}

/// The top of the parabola through the neighbours (Brown and Lowe 2002); `None` where it lies beyond them.
fn refined(
    layers: [&Layer; 3],
    at: usize,
    row: usize,
    column: usize,
    octave: usize,
    inner: usize,
) -> Option<Keypoint> {
    let columns = layers[1].columns as isize;
    let value = |dx: isize, dy: isize, ds: isize| {
        layers[(1 + ds) as usize].values[(at as isize + dy * columns + dx) as usize]
    };
    let centre = value(0, 0, 0);
    let slope = Vector3::new(
        (value(1, 0, 0) - value(-1, 0, 0)) / 2.0,
        (value(0, 1, 0) - value(0, -1, 0)) / 2.0,
        (value(0, 0, 1) - value(0, 0, -1)) / 2.0,
    );
    let xx = value(1, 0, 0) + value(-1, 0, 0) - 2.0 * centre;
    let yy = value(0, 1, 0) + value(0, -1, 0) - 2.0 * centre;
    let ss = value(0, 0, 1) + value(0, 0, -1) - 2.0 * centre;
    let xy = (value(1, 1, 0) - value(-1, 1, 0) - value(1, -1, 0) + value(-1, -1, 0)) / 4.0;
    let xs = (value(1, 0, 1) - value(-1, 0, 1) - value(1, 0, -1) + value(-1, 0, -1)) / 4.0;
    let ys = (value(0, 1, 1) - value(0, -1, 1) - value(0, 1, -1) + value(0, -1, -1)) / 4.0;
    let offset = -Matrix3::new(xx, xy, xs, xy, yy, ys, xs, ys, ss)
        .try_inverse()
        .map(|inverse| inverse * slope)?;
    if !offset.iter().all(|o| o.abs() <= 1.0) {
        return None;
    }
    let step = (1 << octave) as f32;
    let side = filter_side(octave, inner) as f32 + offset.z * 6.0 * step;
    Some(Keypoint {
        x: (column as f32 + offset.x) * step,
        y: (row as f32 + offset.y) * step,
        scale: side * LEAST_SIGMA / LEAST_SIDE as f32,
        angle: 0.0,
        strength: centre + 0.5 * slope.dot(&offset),
        sign: 0.0,
    })
}

/// A blob's centre is darker than its surroundings (1) or brighter (-1): the sign of the filter's trace.
fn laplacian_sign(integral: &Integral, keypoint: &Keypoint) -> f32 {
    // The greatest odd lobe that is not wider than the blob's own filter.
    let lobe =
        ((keypoint.scale * LEAST_SIDE as f32 / LEAST_SIGMA / 3.0 - 1.0) / 2.0) as usize * 2 + 1;
    let (x, y) = (keypoint.x.round() as usize, keypoint.y.round() as usize);
    let clipped = |reach_x: usize, reach_y: usize| {
        let (left, top) = (x.saturating_sub(reach_x), y.saturating_sub(reach_y));
        let (right, bottom) = (
            (x + reach_x + 1).min(integral.width),
            (y + reach_y + 1).min(integral.height),
        );
        i64::from(integral.sum(left, top, right, bottom))
    };
    let (wide, half, long) = (lobe - 1, lobe / 2, 3 * lobe / 2);
    let trace = clipped(wide, long) - 3 * clipped(wide, half) + clipped(long, wide)
        - 3 * clipped(half, wide);
    if trace < 0 { -1.0 } else { 1.0 }
}

/// Radius (in scales) of the circle whose gradients give the orientation.
const ORIENTATION_RADIUS: i32 = 6;
/// Sigma (in scales) of their weights.
const ORIENTATION_SIGMA: f32 = 2.0;
/// Directions are told apart by a degree; the sector whose gradients are added up is 60 degrees wide.
const DIRECTIONS: usize = 360;
const SECTOR: usize = 60;

/// Places (in scales) whose gradients give the orientation, and their weights.
fn orientation_samples() -> Vec<(f32, f32, f32)> {
    let reach = -ORIENTATION_RADIUS..=ORIENTATION_RADIUS;
    reach
        .clone()
        .flat_map(|v| reach.clone().map(move |u| (u, v, u * u + v * v)))
        .filter(|&(_, _, squared)| squared <= ORIENTATION_RADIUS * ORIENTATION_RADIUS)
        .map(|(u, v, squared)| {
            let weight = (-squared as f32 / (2.0 * ORIENTATION_SIGMA * ORIENTATION_SIGMA)).exp();
            (u as f32, v as f32, weight)
        })
        .collect()
}

/// The direction of the sector with the longest sum of gradients.
fn orientation(integral: &Integral, keypoint: &Keypoint, samples: &[(f32, f32, f32)]) -> f32 {
    let scale = keypoint.scale;
    let half = ((2.0 * scale).round() as i32).max(1);
    let mut by_direction = [(0.0_f32, 0.0_f32); DIRECTIONS];
    for &(u, v, weight) in samples {
        let x = (keypoint.x + u * scale + 0.5).round() as i32;
        let y = (keypoint.y + v * scale + 0.5).round() as i32;
        if let Some((dx, dy)) = integral.haar(x, y, half) {
            let sum = &mut by_direction[direction(dx, dy)];
            sum.0 += dx * weight;
            sum.1 += dy * weight;
        }
    }
    // Sums of all before a direction, around and on, so that a sector is the difference of two.
    let mut before = [(0.0_f64, 0.0_f64); DIRECTIONS + SECTOR];
    for k in 1..before.len() {
        let (dx, dy) = by_direction[(k - 1) % DIRECTIONS];
        let (x, y) = before[k - 1];
        before[k] = (x + f64::from(dx), y + f64::from(dy));
    }
    let (mut longest, mut along) = (0.0, (1.0, 0.0));
    for (from, to) in before.iter().zip(&before[SECTOR..]) {
        let (x, y) = (to.0 - from.0, to.1 - from.1);
        let length = x * x + y * y;
        if length > longest {
            (longest, along) = (length, (x, y));
        }
    }
    along.1.atan2(along.0) as f32
}

/// Which of the `DIRECTIONS` a gradient has.
fn direction(dx: f32, dy: f32) -> usize {
    let turns = dy.atan2(dx) / std::f32::consts::TAU + 0.5;
    ((turns * DIRECTIONS as f32) as usize).min(DIRECTIONS - 1)
}

/// Fields along each side of the descriptor's window, samples (one scale apart) from one to the next, and samples along
/// each side of a field: neighbouring fields overlap, so that a small error of place moves little from one to another
/// (Agrawal, Konolige and Blas, "CenSurE", ECCV 2008; without overlap, as in Bay et al., fewer matches were right).
const FIELDS: usize = 4;
const SPACING: usize = 5;
const SAMPLES: usize = 9;
const WINDOW: usize = SPACING * (FIELDS - 1) + SAMPLES;
/// Sigma of the weights within a field (samples) and of those of the fields (fields).
const SAMPLE_SIGMA: f32 = 2.5;
const FIELD_SIGMA: f32 = 1.5;
/// Length of a descriptor: its values are whole numbers, so that their products are exact in any order.
const LENGTH: f32 = 512.0;

/// Values of a descriptor.
pub const fn descriptor_size(extended: bool) -> usize {
    FIELDS * FIELDS * if extended { 8 } else { 4 }
}

/// Weights of normal distributions, by distance from the middle of `N` places.
fn bell<const N: usize>(sigma: f32) -> [f32; N] {
    std::array::from_fn(|k| {
        let from_middle = (k as f32 - (N as f32 - 1.0) / 2.0) / sigma;
        (-0.5 * from_middle * from_middle).exp()
    })
}

/// Orientation (unless upright) and descriptor of each keypoint, in their order.
pub fn describe(integral: &Integral, keypoints: &mut [Keypoint], options: &Options) -> Vec<f32> {
    let size = descriptor_size(options.extended);
    let mut descriptors = vec![0.0; size * keypoints.len()];
    let samples = orientation_samples();
    keypoints
        .par_iter_mut()
        .zip(descriptors.par_chunks_mut(size))
        .for_each(|(keypoint, descriptor)| {
            if !options.upright {
                keypoint.angle = orientation(integral, keypoint, &samples);
            }
            fill_descriptor(integral, keypoint, options.extended, descriptor);
        });
    descriptors
}

fn fill_descriptor(integral: &Integral, keypoint: &Keypoint, extended: bool, out: &mut [f32]) {
    let gradients = window(integral, keypoint);
    let within: [f32; SAMPLES] = bell(SAMPLE_SIGMA);
    let among: [f32; FIELDS] = bell(FIELD_SIGMA);
    let values = out.len() / (FIELDS * FIELDS);
    for (index, field) in out.chunks_mut(values).enumerate() {
        let (row, column) = (index / FIELDS, index % FIELDS);
        for (v, weight_v) in within.iter().enumerate() {
            let first = (row * SPACING + v) * WINDOW + column * SPACING;
            for ((dx, dy), weight_u) in gradients[first..first + SAMPLES].iter().zip(&within) {
                let weight = weight_u * weight_v;
                add(field, weight * dx, weight * dy, extended);
            }
        }
        for value in field {
            *value *= among[row] * among[column];
        }
    }
    let length = out.iter().map(|value| value * value).sum::<f32>().sqrt();
    if length > 0.0 {
        for value in out {
            *value = (*value * LENGTH / length).round();
        }
    }
}

/// Gradients over the window, along the keypoint's own axes; none where the wavelets leave the picture.
fn window(integral: &Integral, keypoint: &Keypoint) -> [(f32, f32); WINDOW * WINDOW] {
    let scale = keypoint.scale;
    let half = (scale.round() as i32).max(1);
    let (sin, cos) = keypoint.angle.sin_cos();
    let middle = (WINDOW as f32 - 1.0) / 2.0;
    let mut gradients = [(0.0, 0.0); WINDOW * WINDOW];
    for (index, gradient) in gradients.iter_mut().enumerate() {
        let u = scale * ((index % WINDOW) as f32 - middle);
        let v = scale * ((index / WINDOW) as f32 - middle);
        let x = keypoint.x + cos * u - sin * v + 0.5;
        let y = keypoint.y + sin * u + cos * v + 0.5;
        if let Some((dx, dy)) = integral.haar(x.round() as i32, y.round() as i32, half) {
            *gradient = (cos * dx + sin * dy, cos * dy - sin * dx);
        }
    }
    gradients
}

fn add(field: &mut [f32], dx: f32, dy: f32, extended: bool) {
    let (x, y) = if extended {
        (if dy < 0.0 { 0 } else { 2 }, if dx < 0.0 { 4 } else { 6 })
    } else {
        (0, 2)
    };
    field[x] += dx;
    field[x + 1] += dx.abs();
    field[y] += dy;
    field[y + 1] += dy.abs();
}

#[cfg(test)]
mod tests {
    use super::*;

    const OPTIONS: Options = Options {
        octaves: 4,
        threshold: 1e-4,
        upright: false,
        extended: false,
        most: usize::MAX,
    };

    /// Reproducible grey values: a sum of waves with a hashed grain.
    fn picture(width: usize, height: usize) -> Vec<u8> {
        (0..width * height)
            .map(|index| {
                let (x, y) = ((index % width) as f32, (index / width) as f32);
                let waves = (x * 0.21).sin() * (y * 0.17).cos() + (x * 0.05 + y * 0.09).sin();
                let grain = (index as u32).wrapping_mul(2_654_435_761) >> 27;
                (110.0 + 45.0 * waves) as u8 + grain as u8
            })
            .collect()
    }

    /// A Gaussian blob of sigma `sigma` in the middle of a square.
    fn blob(side: usize, x: f32, y: f32, sigma: f32, bright: bool) -> Vec<u8> {
        (0..side * side)
            .map(|index| {
                let (u, v) = ((index % side) as f32 - x, (index / side) as f32 - y);
                let height = 120.0 * (-(u * u + v * v) / (2.0 * sigma * sigma)).exp();
                (if bright {
                    60.0 + height
                } else {
                    200.0 - height
                })
                .round() as u8
            })
            .collect()
    }

    #[test]
    fn box_sums_are_those_of_the_pixels() {
        let (width, height) = (37, 23);
        let pixels = picture(width, height);
        let integral = Integral::new(&pixels, width, height);
        for (left, top, right, bottom) in
            [(0, 0, 37, 23), (3, 5, 4, 6), (10, 0, 31, 22), (7, 7, 7, 9)]
        {
            let direct: u32 = (top..bottom)
                .flat_map(|y| &pixels[y * width + left..y * width + right])
                .map(|&p| u32::from(p))
                .sum();
            assert_eq!(integral.sum(left, top, right, bottom), direct);
        }
    }

    #[test]
    fn box_sums_survive_that_the_whole_wraps_around() {
        let (width, height) = (4200, 4100);
        let integral = Integral::new(&vec![255; width * height], width, height);
        assert!(width as u64 * height as u64 * 255 > u64::from(u32::MAX));
        assert_eq!(integral.sum(4000, 4000, 4200, 4100), 200 * 100 * 255);
    }

    #[test]
    fn filters_have_the_sides_of_the_paper() {
        let sides = |octave| {
            (0..LAYERS)
                .map(|layer| filter_side(octave, layer))
                .collect::<Vec<_>>()
        };
        assert_eq!(sides(0), [9, 15, 21, 27]);
        assert_eq!(sides(1), [15, 27, 39, 51]);
        assert_eq!(sides(2), [27, 51, 75, 99]);
    }

    #[test]
    fn a_blob_is_found_where_it_is_with_its_size_and_sign() {
        for (sigma, bright) in [(3.0, true), (3.0, false), (5.0, true), (9.0, false)] {
            let pixels = blob(160, 80.3, 78.6, sigma, bright);
            let found = detect(&Integral::new(&pixels, 160, 160), None, &OPTIONS);
            let best = found[0];
            assert!(
                (best.x - 80.3).abs() < 0.25 && (best.y - 78.6).abs() < 0.25,
                "{best:?}"
            );
            // A Gaussian's determinant is greatest at its own sigma; the boxes of a filter that stands for a sigma are
            // those of one a third greater (zero crossings at a sixth of the side, 1.5 for 1.2), whatever the size.
            let share = best.scale / sigma;
            assert!((share - 0.75).abs() < 0.08, "{best:?} for {sigma}");
            assert_eq!(best.sign, if bright { -1.0 } else { 1.0 });
        }
    }

    #[test]
    fn no_keypoint_lies_outside_the_mask() {
        let (width, height) = (200, 150);
        let integral = Integral::new(&picture(width, height), width, height);
        let mask: Vec<bool> = (0..width * height)
            .map(|i| i % width < 90 && i / width > 40)
            .collect();
        let all = detect(&integral, None, &OPTIONS);
        let kept = detect(&integral, Some(&mask), &OPTIONS);
        assert!(!kept.is_empty() && kept.len() < all.len());
        let inside = |k: &&Keypoint| mask[k.y.round() as usize * width + k.x.round() as usize];
        assert_eq!(kept, all.iter().filter(inside).copied().collect::<Vec<_>>());
    }

    #[test]
    fn pictures_without_contrast_or_too_small_have_none() {
        for (width, height) in [(0, 0), (1, 1), (5, 300), (26, 26), (300, 200)] {
            let integral = Integral::new(&vec![77; width * height], width, height);
            assert!(detect(&integral, None, &OPTIONS).is_empty());
        }
    }

    #[test]
    fn the_number_of_threads_changes_nothing() {
        let (width, height) = (320, 240);
        let integral = Integral::new(&picture(width, height), width, height);
        let run = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new()
                .num_threads(threads)
                .build()
                .unwrap();
            pool.install(|| {
                let mut keypoints = detect(&integral, None, &OPTIONS);
                let descriptors = describe(&integral, &mut keypoints, &OPTIONS);
                (keypoints, descriptors)
            })
        };
        let one = run(1);
        assert!(one.0.len() > 20);
        assert_eq!(one, run(3));
    }

    #[test]
    fn the_orientation_is_that_of_the_gradient() {
        for degrees in [0.0_f32, 30.0, 100.0, -60.0, -170.0] {
            let (sin, cos) = degrees.to_radians().sin_cos();
            let pixels: Vec<u8> = (0..121 * 121)
                .map(|i| {
                    let (x, y) = ((i % 121) as f32 - 60.0, (i / 121) as f32 - 60.0);
                    (128.0 + 1.4 * (x * cos + y * sin)) as u8
                })
                .collect();
            let keypoint = Keypoint {
                x: 60.0,
                y: 60.0,
                scale: 3.0,
                angle: 0.0,
                strength: 1.0,
                sign: 1.0,
            };
            let angle = orientation(
                &Integral::new(&pixels, 121, 121),
                &keypoint,
                &orientation_samples(),
            );
            assert!(
                (angle - degrees.to_radians()).abs() < 0.02,
                "{angle} for {degrees}"
            );
        }
    }
}
