//! Points of one scan, decoded column by column.
//!
//! A compressed vector section (ASTM E2807) is a header and packets; a data packet carries a piece of
//! one byte stream per field, and values may straddle packets. Each field that matters is unpacked into a short
//! column; points are taken as soon as every column holds them.

use std::io::{Read, Seek};

use super::describe::{Coding as Stored, ScanInfo};
use super::pages::{PageReader, physical};
use crate::formats::cloud::{FARTHEST, LARGE, ORIGIN_STEP};
use crate::formats::error::{FormatError, Result};

/// So many points decide the local origin, and so many that need no bits are made at a time.
const SAMPLE: usize = 65_536;
/// The most points that fields without a single bit may stand for.
const MOST_CONSTANT_POINTS: u64 = 1 << 20;

/// The most values of a field that may wait for those of others.
const MOST_WAITING: usize = 1 << 24;

const SECTION_HEADER: u64 = 32;
const DATA_PACKET: u8 = 1;

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
    /// Intensities were scaled by their own extremes: the file states no limits, or limits that do not hold.
    pub intensity_by_extremes: bool,
    /// Colours are floats without limits; the depth was taken from the largest.
    pub color_by_extremes: bool,
}

/// Reads the points of `scan` from `file`, in metres when `metres_per_unit` is the length of the file's unit.
pub fn read_points<R: Read + Seek>(
    file: R,
    scan: &ScanInfo,
    metres_per_unit: f64,
) -> Result<Points> {
    let mut pages = PageReader::new(file)?;
    let mut fields = Fields::new(scan)?;
    let mut sink = Sink::new(scan, &fields, metres_per_unit);
    if scan.records == 0 {
        return sink.finish();
    }
    let mut packets = Packets::open(&mut pages, scan)?;
    check_record_count(scan, packets.end - packets.start)?;
    sink.reserve(scan.records)?;
    let mut left = scan.records;
    while left > 0 {
        let complete = fields.complete(left);
        if complete == 0 {
            if !packets.next(&mut fields)? {
                return Err(FormatError::whole(format!(
                    "it promises {} points but holds {}",
                    scan.records,
                    scan.records - left
                )));
            }
            continue;
        }
        fields.fill_constants(complete);
        sink.take(&fields, complete);
        fields.drop_first(complete);
        left -= complete as u64;
    }
    sink.finish()
}

/// A count that the section has no room for is refused before anything is allocated for it.
fn check_record_count(scan: &ScanInfo, section_bytes: u64) -> Result<()> {
    let bits: u64 = scan
        .fields
        .iter()
        .map(|field| u64::from(field.coding.bits()))
        .sum();
    let room = (section_bytes * 8)
        .checked_div(bits)
        .unwrap_or(MOST_CONSTANT_POINTS);
    if scan.records > room {
        return Err(FormatError::whole(format!(
            "it promises {} points, but there is room for {room} at most",
            scan.records
        )));
    }
    Ok(())
}

/// The packets of one section.
struct Packets<'a, R> {
    pages: &'a mut PageReader<R>,
    start: u64,
    end: u64,
    buffer: Vec<u8>,
}

impl<'a, R: Read + Seek> Packets<'a, R> {
    fn open(pages: &'a mut PageReader<R>, scan: &ScanInfo) -> Result<Self> {
        let beyond = || FormatError::whole("it is cut short: the points lie beyond its end");
        let section = pages.logical(scan.offset).ok_or_else(beyond)?;
        pages.seek(section);
        let mut header = [0; SECTION_HEADER as usize];
        pages.read_exact(&mut header)?;
        if header[0] != 1 {
            return Err(FormatError::byte(
                scan.offset,
                "no section of points begins there",
            ));
        }
        let length = u64_at(&header, 8);
        let start = pages.logical(u64_at(&header, 16)).ok_or_else(beyond)?;
        let end = section.checked_add(length).ok_or_else(beyond)?;
        if end > pages.len() || start < section + SECTION_HEADER || start > end {
            return Err(beyond());
        }
        pages.seek(start);
        Ok(Self {
            pages,
            start,
            end,
            buffer: Vec::new(),
        })
    }

    /// Hands the streams of the next packet to the fields; false after the last packet.
    fn next(&mut self, fields: &mut Fields) -> Result<bool> {
        let at = self.pages.position();
        if at + 4 > self.end {
            return Ok(false);
        }
        let damaged = |reason: &str| Err(FormatError::byte(physical(at), reason));
        let mut head = [0; 4];
        self.pages.read_exact(&mut head)?;
        let length = usize::from(u16_at(&head, 2)) + 1;
        if length < 4 || !length.is_multiple_of(4) || at + length as u64 > self.end {
            return damaged("a packet of points has an impossible length");
        }
        if head[0] > 2 {
            return damaged("a packet of points is of no known kind");
        }
        self.buffer.resize(length - 4, 0);
        self.pages.read_exact(&mut self.buffer)?;
        if head[0] != DATA_PACKET {
            return Ok(true);
        }
        let count = fields.streams.len();
        let sizes_end = 2 + 2 * count;
        if self.buffer.len() < sizes_end || usize::from(u16_at(&self.buffer, 0)) != count {
            return damaged("a packet of points does not have the fields that the scan declares");
        }
        let mut from = sizes_end;
        for (index, stream) in fields.streams.iter_mut().enumerate() {
            let to = from + usize::from(u16_at(&self.buffer, 2 + 2 * index));
            let Some(bytes) = self.buffer.get(from..to) else {
                return damaged("the streams of a packet of points are longer than the packet");
            };
            stream.push(bytes);
            if stream.values.len() > MOST_WAITING {
                return damaged("the fields of the points do not advance together");
            }
            from = to;
        }
        Ok(true)
    }
}

fn u16_at(bytes: &[u8], at: usize) -> u16 {
    u16::from_le_bytes([bytes[at], bytes[at + 1]])
}

fn u64_at(bytes: &[u8], at: usize) -> u64 {
    let mut word = [0; 8];
    word.copy_from_slice(&bytes[at..at + 8]);
    u64::from_le_bytes(word)
}

#[derive(Clone, Copy)]
enum Coding {
    /// A field that nothing is wanted of.
    Ignored,
    Single,
    Double,
    /// Always the same value, in no bits.
    Constant(f64),
    Packed {
        bits: u32,
        min: i64,
        scale: f64,
        offset: f64,
    },
}

/// One field's bytes that are not yet values, and its values that are not yet points.
struct Stream {
    coding: Coding,
    bytes: Vec<u8>,
    /// Bits of `bytes` that are used up.
    bit: usize,
    values: Vec<f64>,
}

/// Bytes after the last one that unpacking may look at.
const PADDING: usize = 16;

impl Stream {
    fn new(coding: Coding) -> Self {
        Self {
            coding,
            bytes: Vec::new(),
            bit: 0,
            values: Vec::new(),
        }
    }

    fn push(&mut self, bytes: &[u8]) {
        let bits = match self.coding {
            Coding::Ignored | Coding::Constant(_) => return,
            Coding::Single => 32,
            Coding::Double => 64,
            Coding::Packed { bits, .. } => bits as usize,
        };
        self.bytes.drain(..self.bit / 8);
        self.bit %= 8;
        self.bytes.extend_from_slice(bytes);
        let count = (self.bytes.len() * 8 - self.bit) / bits;
        match self.coding {
            Coding::Single => self.values.extend(
                self.bytes
                    .chunks_exact(4)
                    .map(|b| f64::from(f32::from_le_bytes([b[0], b[1], b[2], b[3]]))),
            ),
            Coding::Double => self.values.extend(
                self.bytes
                    .chunks_exact(8)
                    .map(|b| f64::from_bits(u64_at(b, 0))),
            ),
            Coding::Packed {
                bits,
                min,
                scale,
                offset,
            } => {
                let whole = self.bytes.len();
                self.bytes.resize(whole + PADDING, 0);
                let value = |raw: u64| raw.cast_signed().wrapping_add(min) as f64 * scale + offset;
                self.values.extend(
                    (0..count).map(|index| value(bits_at(&self.bytes, self.bit, bits, index))),
                );
                self.bytes.truncate(whole);
            }
            Coding::Ignored | Coding::Constant(_) => {}
        }
        self.bit += count * bits;
    }
}

/// The unsigned integer number `index` of `bits` bits each, the least significant bit first.
fn bits_at(bytes: &[u8], first_bit: usize, bits: u32, index: usize) -> u64 {
    let at = first_bit + index * bits as usize;
    let low = u64_at(bytes, at / 8) >> (at % 8);
    let value = if bits <= 57 {
        low
    } else {
        // Such a value may reach into a ninth byte.
        low | u64::from(bytes[at / 8 + 8]).unbounded_shl(64 - (at % 8) as u32)
    };
    value & (u64::MAX >> (64 - bits))
}

/// The fields of a scan, by their place in the packets.
struct Fields {
    streams: Vec<Stream>,
    cartesian: Option<[usize; 3]>,
    cartesian_state: Option<usize>,
    spherical: Option<[usize; 3]>,
    spherical_state: Option<usize>,
    intensity: Option<usize>,
    intensity_state: Option<usize>,
    color: Option<[usize; 3]>,
    color_state: Option<usize>,
    row: Option<usize>,
    column: Option<usize>,
}

impl Fields {
    fn new(scan: &ScanInfo) -> Result<Self> {
        let place = |name: &str| scan.place(name);
        let three = |names: [&str; 3]| {
            let [a, b, c] = names.map(place);
            Some([a?, b?, c?])
        };
        let mut fields = Self {
            streams: Vec::new(),
            cartesian: three(["cartesianX", "cartesianY", "cartesianZ"]),
            cartesian_state: place("cartesianInvalidState"),
            spherical: three(["sphericalRange", "sphericalAzimuth", "sphericalElevation"]),
            spherical_state: place("sphericalInvalidState"),
            intensity: place("intensity"),
            intensity_state: place("isIntensityInvalid"),
            color: three(["colorRed", "colorGreen", "colorBlue"]),
            color_state: place("isColorInvalid"),
            row: place("rowIndex"),
            column: place("columnIndex"),
        };
        if fields.cartesian.is_none() && fields.spherical.is_none() {
            return Err(FormatError::whole(
                "its points have neither Cartesian nor spherical coordinates",
            ));
        }
        if fields.row.is_none() || fields.column.is_none() {
            fields.row = None;
            fields.column = None;
        }
        let wanted: Vec<usize> = [
            fields.cartesian_state,
            fields.spherical_state,
            fields.intensity,
            fields.intensity_state,
            fields.color_state,
            fields.row,
            fields.column,
        ]
        .into_iter()
        .flatten()
        .chain(
            [fields.cartesian, fields.spherical, fields.color]
                .into_iter()
                .flatten()
                .flatten(),
        )
        .collect();
        fields.streams = scan
            .fields
            .iter()
            .enumerate()
            .map(|(index, field)| {
                Stream::new(if wanted.contains(&index) {
                    coding(field.coding)
                } else {
                    Coding::Ignored
                })
            })
            .collect();
        Ok(fields)
    }

    /// Points that every column holds, `most` at most; where no column says, a handy number.
    fn complete(&self, most: u64) -> usize {
        let held = self
            .streams
            .iter()
            .filter(|stream| !matches!(stream.coding, Coding::Ignored | Coding::Constant(_)))
            .map(|stream| stream.values.len())
            .min()
            .unwrap_or(SAMPLE);
        usize::try_from(most).map_or(held, |most| held.min(most))
    }

    /// Gives the fields without bits their values, so that every wanted column holds `count`.
    fn fill_constants(&mut self, count: usize) {
        for stream in &mut self.streams {
            if let Coding::Constant(value) = stream.coding {
                stream.values.resize(count, value);
            }
        }
    }

    fn drop_first(&mut self, count: usize) {
        for stream in &mut self.streams {
            stream.values.drain(..count.min(stream.values.len()));
        }
    }

    fn first(&self, field: usize, count: usize) -> &[f64] {
        &self.streams[field].values[..count]
    }
}

fn coding(stored: Stored) -> Coding {
    match stored {
        Stored::Single { .. } => Coding::Single,
        Stored::Double { .. } => Coding::Double,
        Stored::Integer {
            min, scale, offset, ..
        } => match stored.bits() {
            0 => Coding::Constant(min as f64 * scale + offset),
            bits => Coding::Packed {
                bits,
                min,
                scale,
                offset,
            },
        },
    }
}

/// What a field may be at the least and at the most, as far as limits or the field's type say.
fn limits(stated: Option<(f64, f64)>, field: Stored) -> Option<(f64, f64)> {
    let usable = |(low, high): &(f64, f64)| low < high && high - low < f64::from(f32::MAX);
    stated.filter(usable).or(field.range().filter(usable))
}

/// Collects points.
struct Sink {
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
    /// The largest value that each colour can have; none where only the data tells.
    color_full: Option<[f64; 3]>,
    /// Colours that wait for their largest value.
    raw_colors: Vec<[f32; 3]>,
}

impl Sink {
    fn new(scan: &ScanInfo, fields: &Fields, metres_per_unit: f64) -> Self {
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
            intensity_range,
            color_full,
            raw_colors: Vec::new(),
        }
    }

    fn reserve(&mut self, records: u64) -> Result<()> {
        let too_many =
            |_| FormatError::whole(format!("its {records} points do not fit into memory"));
        let count = usize::try_from(records).unwrap_or(usize::MAX);
        let points = &mut self.points;
        points
            .xyz
            .try_reserve_exact(count.saturating_mul(3))
            .map_err(too_many)?;
        if let Some(values) = &mut points.intensity {
            values.try_reserve_exact(count).map_err(too_many)?;
        }
        if let Some(values) = &mut points.color {
            values
                .try_reserve_exact(count.saturating_mul(3))
                .map_err(too_many)?;
        }
        for values in [&mut points.row, &mut points.column].into_iter().flatten() {
            values.try_reserve_exact(count).map_err(too_many)?;
        }
        Ok(())
    }

    /// Takes the first `count` points of the columns.
    fn take(&mut self, fields: &Fields, count: usize) {
        self.take_coordinates(fields, count);
        let kept = Kept {
            keep: &self.keep,
            all: self.keep.iter().all(|&keep| keep),
        };
        let points = &mut self.points;
        if let (Some(values), Some(field)) = (&mut points.intensity, fields.intensity) {
            let (low, width) = self.intensity_range.unwrap_or((0.0, 1.0));
            let stored = fields.first(field, count);
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
            if waiting.len() >= SAMPLE {
                self.settle_origin();
            }
        } else {
            push_relative(&mut self.points.xyz, &self.batch, self.points.local_origin);
        }
    }

    /// Large coordinates are counted from a round place near the middle of the first points.
    fn settle_origin(&mut self) {
        let Some(waiting) = self.waiting.take() else {
            return;
        };
        if waiting.is_empty() {
            return;
        }
        let middle = waiting.len() / 2;
        let mut median = [0.0; 3];
        let mut order = waiting.clone();
        for (axis, value) in median.iter_mut().enumerate() {
            *value = order
                .select_nth_unstable_by(middle, |a, b| a[axis].total_cmp(&b[axis]))
                .1[axis];
        }
        if median.iter().any(|value| value.abs() > LARGE) {
            self.points.local_origin =
                median.map(|value| (value / ORIGIN_STEP).round() * ORIGIN_STEP);
        }
        push_relative(&mut self.points.xyz, &waiting, self.points.local_origin);
    }

    fn finish(mut self) -> Result<Points> {
        self.settle_origin();
        let points = &mut self.points;
        if let Some(values) = &mut points.intensity {
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
        if let Some(values) = &mut points.intensity {
            values.shrink_to_fit();
        }
        if let Some(values) = &mut points.color {
            values.shrink_to_fit();
        }
        for values in [&mut points.row, &mut points.column].into_iter().flatten() {
            values.shrink_to_fit();
        }
        Ok(self.points)
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
    use std::fs::File;
    use std::path::Path;

    use ::e57::{E57Writer, Record, RecordDataType, RecordName, RecordValue};

    use super::*;
    use crate::formats::e57::describe;

    /// Bits of a number, one at a time, as the standard lays them out.
    fn slow_bits(bytes: &[u8], first_bit: usize, bits: u32, index: usize) -> u64 {
        (0..bits as usize).fold(0, |value, bit| {
            let at = first_bit + index * bits as usize + bit;
            value | u64::from(bytes[at / 8] >> (at % 8) & 1) << bit
        })
    }

    #[test]
    fn numbers_of_any_width_unpack() {
        let bytes: Vec<u8> = (0..200_u32).map(|i| (i * 167 + 13) as u8).collect();
        for bits in 1..=64 {
            for first_bit in 0..8 {
                for index in 0..20 {
                    assert_eq!(
                        bits_at(&bytes, first_bit, bits, index),
                        slow_bits(&bytes, first_bit, bits, index),
                        "{bits} bits, number {index} after {first_bit} bits"
                    );
                }
            }
        }
    }

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

    fn write(path: &Path, prototype: Vec<Record>, points: Vec<Vec<RecordValue>>) {
        let mut file = E57Writer::from_file(path, "{file}").unwrap();
        let mut cloud = file.add_pointcloud("{scan}", prototype).unwrap();
        for point in points {
            cloud.add_point(point).unwrap();
        }
        cloud.finalize().unwrap();
        file.finalize().unwrap();
    }

    fn read(path: &Path) -> Result<Points> {
        let found = describe(File::open(path)?)?;
        read_points(File::open(path)?, found.scans[0].as_ref().unwrap(), 1.0)
    }

    fn record(name: RecordName, data_type: RecordDataType) -> Record {
        Record { name, data_type }
    }

    fn scaled(scale: f64) -> RecordDataType {
        RecordDataType::ScaledInteger {
            min: -1_000_000,
            max: 3_000_000,
            scale,
            offset: 0.25,
        }
    }

    #[test]
    fn spherical_scaled_integers_become_x_y_z() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("spherical.e57");
        let state = RecordDataType::Integer { min: 0, max: 2 };
        let prototype = vec![
            record(RecordName::SphericalAzimuth, scaled(1e-6)),
            record(RecordName::SphericalInvalidState, state),
            record(RecordName::SphericalElevation, scaled(4e-7)),
            record(RecordName::SphericalRange, scaled(1e-5)),
        ];
        let raw: Vec<[i64; 4]> = (0..30_000)
            .map(|i| {
                [
                    i * 97 % 4_000_001 - 1_000_000,
                    i % 3,
                    i * 61 % 4_000_001 - 1_000_000,
                    i * 7,
                ]
            })
            .collect();
        let values = raw.iter().map(|&[azimuth, state, elevation, range]| {
            vec![
                RecordValue::ScaledInteger(azimuth),
                RecordValue::Integer(state),
                RecordValue::ScaledInteger(elevation),
                RecordValue::ScaledInteger(range),
            ]
        });
        write(&path, prototype, values.collect());
        let points = read(&path).unwrap();
        assert_eq!((points.xyz.len(), points.invalid), (30_000, 20_000));
        let valid = raw.iter().filter(|values| values[1] == 0);
        for (xyz, &[azimuth, _, elevation, range]) in points.xyz.chunks_exact(3).zip(valid) {
            let azimuth = azimuth as f64 * 1e-6 + 0.25;
            let elevation = elevation as f64 * 4e-7 + 0.25;
            let range = range as f64 * 1e-5 + 0.25;
            let [x, y, z] = [0, 1, 2].map(|axis| f64::from(xyz[axis]));
            assert!((x.hypot(y).hypot(z) - range).abs() < 1e-6);
            assert!((y.atan2(x) - azimuth).abs() < 1e-6);
            assert!((z.atan2(x.hypot(y)) - elevation).abs() < 1e-6);
        }
    }

    #[test]
    fn spherical_coordinates_stand_in_where_cartesian_ones_are_invalid() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("both.e57");
        let double = || RecordDataType::Double {
            min: None,
            max: None,
        };
        let state = || RecordDataType::Integer { min: 0, max: 2 };
        let prototype = [
            (RecordName::CartesianX, double()),
            (RecordName::CartesianY, double()),
            (RecordName::CartesianZ, double()),
            (RecordName::CartesianInvalidState, state()),
            (RecordName::SphericalRange, double()),
            (RecordName::SphericalAzimuth, double()),
            (RecordName::SphericalElevation, double()),
            (RecordName::SphericalInvalidState, state()),
        ]
        .map(|(name, data_type)| record(name, data_type));
        let point = |flat: i64, round: i64| {
            let mut values = [1.0, 2.0, 3.0].map(RecordValue::Double).to_vec();
            values.push(RecordValue::Integer(flat));
            values.extend([5.0, 0.0, 0.0].map(RecordValue::Double));
            values.push(RecordValue::Integer(round));
            values
        };
        let points = vec![
            point(0, 0),
            point(2, 0),
            point(0, 2),
            point(2, 1),
            point(1, 2),
        ];
        write(&path, prototype.to_vec(), points);
        let points = read(&path).unwrap();
        assert_eq!(points.xyz, [1.0, 2.0, 3.0, 5.0, 0.0, 0.0, 1.0, 2.0, 3.0]);
        assert_eq!(points.invalid, 2);
    }

    #[test]
    fn fields_without_a_bit_and_of_64_bits_live_side_by_side() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("widths.e57");
        let prototype = vec![
            record(
                RecordName::CartesianX,
                RecordDataType::Integer { min: 7, max: 7 },
            ),
            record(
                RecordName::CartesianY,
                RecordDataType::Integer {
                    min: i64::MIN,
                    max: i64::MAX,
                },
            ),
            record(
                RecordName::CartesianZ,
                RecordDataType::Integer { min: 0, max: 1 },
            ),
        ];
        let points = (0..20_001).map(|i| {
            vec![7, i - 10_000, i % 2]
                .into_iter()
                .map(RecordValue::Integer)
                .collect()
        });
        write(&path, prototype, points.collect());
        let points = read(&path).unwrap();
        assert_eq!(points.xyz.len(), 3 * 20_001);
        for (i, xyz) in points.xyz.chunks_exact(3).enumerate() {
            assert_eq!(xyz, [7.0, i as f32 - 10_000.0, (i % 2) as f32]);
        }
    }

    #[test]
    fn the_local_origin_is_round_and_near_most_points() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("large.e57");
        let axes = [
            RecordName::CartesianX,
            RecordName::CartesianY,
            RecordName::CartesianZ,
        ];
        let double = RecordDataType::Double {
            min: None,
            max: None,
        };
        let prototype = axes.map(|name| record(name, double.clone())).to_vec();
        // The first point is far off, and must not decide.
        let points: Vec<[f64; 3]> = (0..200)
            .map(|i| {
                let far = if i == 0 { 9e6 } else { 0.0 };
                [500_012.345 + f64::from(i) + far, 5_400_000.678, 310.001]
            })
            .collect();
        write(
            &path,
            prototype,
            points
                .iter()
                .map(|xyz| xyz.map(RecordValue::Double).to_vec())
                .collect(),
        );
        let read = read(&path).unwrap();
        assert_eq!(read.local_origin, [500_100.0, 5_400_000.0, 300.0]);
        for (xyz, point) in read.xyz.chunks_exact(3).zip(points).skip(1) {
            for axis in 0..3 {
                let back = f64::from(xyz[axis]) + read.local_origin[axis];
                assert!((back - point[axis]).abs() < 1e-5);
            }
        }
    }
}
