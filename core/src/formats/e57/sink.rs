//! Takes the numbers of the fields in batches and keeps the valid points.

use std::collections::TryReserveError;

use super::describe::{Coding, ScanInfo};
use super::packets::Fields;
use crate::formats::cloud::{FARTHEST, ORIGIN_SAMPLE, local_origin};
use crate::formats::error::FormatError;

/// A range of intensities that is wider than this would leave a 32-bit float nothing of what lies close together.
const WIDE: f64 = 1e6;
/// Share of such a range that intensities fill at the least, if they were meant to.
const FILLED: f64 = 1.0 / 256.0;

/// What a field may be at the least and at the most, as far as limits or the field's type say.
fn limits(stated: Option<(f64, f64)>, field: Coding) -> Option<(f64, f64)> {
    let usable = |(low, high): &(f64, f64)| low < high && high - low < f64::from(f32::MAX);
    stated.filter(usable).or(field.range().filter(usable))
}

/// The valid points of a scan.
#[derive(Debug, Default, PartialEq)]
pub struct Points {
    /// x, y, z of each point, metres, station coordinates minus `local_origin`.
    pub xyz: Vec<f32>,
    /// Zero unless the coordinates are too large for 32-bit floats.
    pub local_origin: [f64; 3],
    /// One a point, 0 to 1.
    pub intensity: Option<Vec<f32>>,
    /// Red, green, blue of each point.
    pub color: Option<Vec<u8>>,
    /// Grid row, as stored.
    pub row: Option<Vec<i32>>,
    /// Grid column, as stored.
    pub column: Option<Vec<i32>>,
    /// Points left out because the file marks them as invalid.
    pub invalid: u64,
    /// Points left out because a coordinate is no finite number, or beyond any place on Earth.
    pub not_finite: u64,
    /// Points left out because they lie at the scanner itself: what writers without a validity flag store for "no
    /// return".
    pub no_return: u64,
    /// Points behind the last one that the file promises, which are not read.
    pub surplus: u64,
    /// Intensities were scaled by their own extremes: the file states no limits, or limits that do not hold.
    pub intensity_by_extremes: bool,
    /// Colours are floats without limits; the depth was taken from the largest.
    pub color_by_extremes: bool,
}

/// Points as they come, and what they wait for.
pub struct Sink {
    points: Points,
    metres_per_unit: f64,
    /// Coordinates that wait for the local origin.
    waiting: Option<Vec<[f64; 3]>>,
    keep: Vec<bool>,
    /// Coordinates and colours of the batch in hand.
    batch: Vec<[f64; 3]>,
    colors: Vec<[u8; 3]>,
    /// Lowest intensity and width of its range, from the file.
    intensity_range: Option<(f64, f64)>,
    /// Whether that is too wide for 32-bit floats, and the first intensity, from which they are counted then.
    wide: bool,
    first_intensity: Option<f64>,
    /// The largest value that each colour can have; none where only the data tells.
    color_full: Option<[f64; 3]>,
    /// Colours that wait for their largest value.
    raw_colors: Vec<[f32; 3]>,
}

impl Sink {
    /// Takes over what the file says of intensities and colours.
    pub fn new(scan: &ScanInfo, fields: &Fields, metres_per_unit: f64) -> Self {
        let intensity_range = fields.intensity.and_then(|field| {
            limits(scan.intensity_limits, scan.fields[field].coding)
                .map(|(low, high)| (low, high - low))
        });
        let color_full = fields.color.and_then(|places| {
            let full = |channel: usize| {
                let stated = scan.color_limits.map(|high| (0.0, high[channel]));
                Some(depth(
                    limits(stated, scan.fields[places[channel]].coding)?.1,
                ))
            };
            Some([full(0)?, full(1)?, full(2)?])
        });
        Self {
            points: Points {
                intensity: fields.intensity.map(|_| Vec::new()),
                color: fields.color.map(|_| Vec::new()),
                row: fields.row.map(|_| Vec::new()),
                column: fields.column.map(|_| Vec::new()),
                color_by_extremes: fields.color.is_some() && color_full.is_none(),
                ..Points::default()
            },
            metres_per_unit,
            waiting: Some(Vec::new()),
            keep: Vec::new(),
            batch: Vec::new(),
            colors: Vec::new(),
            wide: intensity_range.is_some_and(|(_, width)| width > WIDE),
            first_intensity: None,
            intensity_range,
            color_full,
            raw_colors: Vec::new(),
        }
    }

    /// Sets memory aside.
    pub fn reserve(&mut self, records: u64) -> Result<(), FormatError> {
        fn room<T>(values: Option<&mut Vec<T>>, count: usize) -> Result<(), TryReserveError> {
            values.map_or(Ok(()), |values| values.try_reserve_exact(count))
        }
        let count = usize::try_from(records).unwrap_or(usize::MAX);
        let points = &mut self.points;
        room(Some(&mut points.xyz), count.saturating_mul(3))
            .and_then(|()| room(points.intensity.as_mut(), count))
            .and_then(|()| room(points.color.as_mut(), count.saturating_mul(3)))
            .and_then(|()| room(points.row.as_mut(), count))
            .and_then(|()| room(points.column.as_mut(), count))
            .map_err(|_| FormatError::whole(format!("its {records} points do not fit into memory")))
    }

    /// Takes the first `count` points of the columns.
    pub fn take(&mut self, fields: &Fields, count: usize) {
        self.take_coordinates(fields, count);
        let kept = Kept {
            keep: &self.keep,
            all: self.keep.iter().all(|&keep| keep),
        };
        let points = &mut self.points;
        if let (Some(values), Some(field)) = (&mut points.intensity, fields.intensity) {
            let (mut low, mut width) = self.intensity_range.unwrap_or((0.0, 1.0));
            let stored = fields.first(field, count);
            if self.wide {
                let first = stored.first().copied().unwrap_or(0.0);
                (low, width) = (*self.first_intensity.get_or_insert(first), 1.0);
            }
            match fields
                .intensity_state
                .map(|state| fields.first(state, count))
            {
                None => kept.extend(values, |index| ((stored[index] - low) / width) as f32),
                Some(state) => kept.extend(values, |index| {
                    if state[index] == 0.0 {
                        ((stored[index] - low) / width) as f32
                    } else {
                        f32::NAN
                    }
                }),
            }
        }
        if let (Some(values), Some(places)) = (&mut points.color, fields.color) {
            let [red, green, blue] = places.map(|field| fields.first(field, count));
            let state = fields.color_state.map(|state| fields.first(state, count));
            let valid = |index: usize| state.is_none_or(|state| state[index] == 0.0);
            let full = self.color_full.unwrap_or([255.0; 3]);
            let factor = full.map(|full| 255.0 / full);
            if self.color_full.is_some() {
                self.colors.clear();
                kept.extend(&mut self.colors, |index| {
                    if valid(index) {
                        [
                            to_byte(red[index] * factor[0]),
                            to_byte(green[index] * factor[1]),
                            to_byte(blue[index] * factor[2]),
                        ]
                    } else {
                        [0; 3]
                    }
                });
                values.extend_from_slice(self.colors.as_flattened());
            } else {
                kept.extend(&mut self.raw_colors, |index| {
                    if valid(index) {
                        [red[index] as f32, green[index] as f32, blue[index] as f32]
                    } else {
                        [0.0; 3]
                    }
                });
            }
        }
        for (values, field) in [
            (&mut points.row, fields.row),
            (&mut points.column, fields.column),
        ] {
            if let (Some(values), Some(field)) = (values, field) {
                let stored = fields.first(field, count);
                kept.extend(values, |index| stored[index] as i32);
            }
        }
    }

    /// Takes the coordinates of the valid ones among the first `count` points, and remembers which those are.
    fn take_coordinates(&mut self, fields: &Fields, count: usize) {
        self.keep.clear();
        self.batch.clear();
        let column = |field: usize| fields.first(field, count);
        let flat = fields
            .cartesian
            .map(|places| (places.map(column), fields.cartesian_state.map(column)));
        let round = fields
            .spherical
            .map(|places| (places.map(column), fields.spherical_state.map(column)));
        let valid =
            |state: Option<&[f64]>, index: usize| state.is_none_or(|state| state[index] == 0.0);
        for index in 0..count {
            let stored = match (flat, round) {
                (Some(([x, y, z], state)), _) if valid(state, index) => {
                    [x[index], y[index], z[index]]
                }
                (_, Some((places, state))) if valid(state, index) => {
                    cartesian(places.map(|column| column[index]))
                }
                _ => {
                    self.points.invalid += 1;
                    self.keep.push(false);
                    continue;
                }
            };
            let xyz = stored.map(|value| value * self.metres_per_unit);
            let finite = xyz.iter().all(|value| value.abs() <= FARTHEST);
            let measured = xyz != [0.0; 3];
            self.points.not_finite += u64::from(!finite);
            self.points.no_return += u64::from(!measured);
            self.keep.push(finite && measured);
            if finite && measured {
                self.batch.push(xyz);
            }
        }
        if let Some(waiting) = &mut self.waiting {
            waiting.append(&mut self.batch);
            if waiting.len() >= ORIGIN_SAMPLE {
                self.settle_origin();
            }
        } else {
            push_relative(&mut self.points.xyz, &self.batch, self.points.local_origin);
        }
    }

    fn settle_origin(&mut self) {
        let Some(waiting) = self.waiting.take() else {
            return;
        };
        self.points.local_origin = local_origin(&waiting);
        push_relative(&mut self.points.xyz, &waiting, self.points.local_origin);
    }

    /// Scales what waited for the last point.
    pub fn finish(mut self) -> Points {
        self.settle_origin();
        let points = &mut self.points;
        if let Some(values) = &mut points.intensity {
            if let (Some(first), Some(range)) = (self.first_intensity, self.intensity_range) {
                narrow(values, first, range);
            }
            points.intensity_by_extremes = scale_intensity(values, self.intensity_range.is_some());
        }
        if let Some(values) = &mut points.color
            && self.color_full.is_none()
        {
            let largest = self
                .raw_colors
                .iter()
                .flatten()
                .copied()
                .fold(0.0, f32::max);
            let factor = 255.0 / depth(f64::from(largest));
            values.extend(
                self.raw_colors
                    .as_flattened()
                    .iter()
                    .map(|&value| to_byte(f64::from(value) * factor)),
            );
        }
        points.xyz.shrink_to_fit();
        points.intensity.iter_mut().for_each(Vec::shrink_to_fit);
        points.color.iter_mut().for_each(Vec::shrink_to_fit);
        points.row.iter_mut().for_each(Vec::shrink_to_fit);
        points.column.iter_mut().for_each(Vec::shrink_to_fit);
        self.points
    }
}

/// Which points of a batch are kept.
struct Kept<'a> {
    keep: &'a [bool],
    all: bool,
}

impl Kept<'_> {
    /// Appends one value for each point that is kept.
    fn extend<T>(&self, out: &mut Vec<T>, value: impl Fn(usize) -> T) {
        if self.all {
            out.extend((0..self.keep.len()).map(value));
        } else {
            out.extend(
                (0..self.keep.len())
                    .filter(|&index| self.keep[index])
                    .map(value),
            );
        }
    }
}

fn push_relative(out: &mut Vec<f32>, points: &[[f64; 3]], origin: [f64; 3]) {
    out.extend(
        points
            .as_flattened()
            .iter()
            .zip(origin.iter().cycle())
            .map(|(value, origin)| (value - origin) as f32),
    );
}

/// Range, azimuth, elevation to x, y, z (ASTM E2807).
fn cartesian([range, azimuth, elevation]: [f64; 3]) -> [f64; 3] {
    let (sin_azimuth, cos_azimuth) = azimuth.sin_cos();
    let (sin_elevation, cos_elevation) = elevation.sin_cos();
    [
        range * cos_elevation * cos_azimuth,
        range * cos_elevation * sin_azimuth,
        range * sin_elevation,
    ]
}

/// The full scale of a colour whose largest value is `high`: 1, or all bits set. Some writers state the largest
/// value that occurs, so the depth counts, not the value.
fn depth(high: f64) -> f64 {
    if high <= 1.0 {
        1.0
    } else {
        (high.floor() + 1.0).log2().ceil().exp2() - 1.0
    }
}

/// Rounds; what does not fit becomes the nearest that does.
fn to_byte(value: f64) -> u8 {
    (value + 0.5) as u8
}

/// Scales intensities, counted from a first one, by their wide range; where they fill little of it, by the 8 or 16 bits
/// that hold them. What neither holds is left for `scale_intensity`.
fn narrow(values: &mut [f32], first: f64, (low, width): (f64, f64)) {
    let finite = || values.iter().copied().filter(|value| value.is_finite());
    let least = first + f64::from(finite().fold(f32::INFINITY, f32::min));
    let most = first + f64::from(finite().fold(f32::NEG_INFINITY, f32::max));
    let (low, width) = if most - least >= FILLED * width {
        (low, width)
    } else if least >= 0.0 && most <= 65_535.0 {
        (0.0, if most <= 255.0 { 255.0 } else { 65_535.0 })
    } else {
        // One step is one, far outside of 0..1: the extremes count.
        (least - 2.0, 1.0)
    };
    for value in values {
        *value = ((f64::from(*value) + (first - low)) / width) as f32;
    }
}

/// Clamps intensities to 0..1, or scales them by their extremes where there are no limits or most of the range
/// lies outside of them. Says whether it did the latter. A missing intensity (NaN) becomes 0.
fn scale_intensity(values: &mut [f32], has_limits: bool) -> bool {
    let finite = || values.iter().copied().filter(|value| value.is_finite());
    let low = finite().fold(f32::INFINITY, f32::min);
    let high = finite().fold(f32::NEG_INFINITY, f32::max);
    let by_extremes = low <= high && (!has_limits || low < -1.0 || high > 2.0);
    let (low, width) = if by_extremes && high > low {
        (low, high - low)
    } else {
        (0.0, 1.0)
    };
    for value in values {
        *value = if value.is_nan() {
            0.0
        } else {
            ((*value - low) / width).clamp(0.0, 1.0)
        };
    }
    by_extremes
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colours_keep_their_depth_where_the_stated_largest_is_not_the_full_scale() {
        for (high, full) in [
            (1.0, 1.0),
            (0.7, 1.0),
            (240.0, 255.0),
            (255.0, 255.0),
            (1023.0, 1023.0),
            (65_280.0, 65_535.0),
        ] {
            assert_eq!(depth(high), full);
        }
        assert_eq!(to_byte(-3.0), 0);
        assert_eq!(to_byte(254.6), 255);
        assert_eq!(to_byte(1e9), 255);
    }

    #[test]
    fn intensities_that_fill_little_of_a_wide_range() {
        let full = (f64::from(i32::MIN), 2f64.powi(32) - 1.0);
        let scaled = |stored: [f64; 3]| {
            let mut values = stored.map(|value| (value - stored[0]) as f32);
            narrow(&mut values, stored[0], full);
            let by_extremes = scale_intensity(&mut values, true);
            (values, by_extremes)
        };
        assert_eq!(
            scaled([0.0, 45_000.0, 65_535.0]),
            ([0.0, 45_000.0 / 65_535.0, 1.0], false)
        );
        assert_eq!(scaled([51.0, 0.0, 255.0]), ([0.2, 0.0, 1.0], false));
        let high = [2_000_000_100.0, 2_000_000_000.0, 2_000_000_400.0];
        assert_eq!(scaled(high), ([0.25, 0.0, 1.0], true));
        let (values, _) = scaled([f64::from(i32::MIN), 0.0, f64::from(i32::MAX)]);
        assert!((values[1] - 0.5).abs() < 1e-6);
    }

    #[test]
    fn intensities_are_clamped_or_scaled_by_their_extremes() {
        let mut held = [-0.1, 0.5, 1.2, f32::NAN];
        assert!(!scale_intensity(&mut held, true));
        assert_eq!(held, [0.0, 0.5, 1.0, 0.0]);
        let mut beyond = [0.0, 100.0, 400.0];
        assert!(scale_intensity(&mut beyond, true));
        assert_eq!(beyond, [0.0, 0.25, 1.0]);
        let mut unknown = [-50.0, 0.0, 50.0];
        assert!(scale_intensity(&mut unknown, false));
        assert_eq!(unknown, [0.0, 0.5, 1.0]);
        assert!(!scale_intensity(&mut [], false));
    }
}
