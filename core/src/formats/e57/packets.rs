//! The packets of a scan's points: pieces of one stream a field.

use std::io::{Read, Seek};

use super::describe::ScanInfo;
use super::pages::{PageReader, physical};
use super::streams::{Decoding, Stream, u16_at, u64_at};
use crate::formats::error::{FormatError, Result, fail};

/// So many points that need no bits are made at a time.
const BATCH: usize = 65_536;
/// The most values of a field that may wait for those of others.
const MOST_WAITING: usize = 1 << 24;

const SECTION_HEADER: u64 = 32;
const DATA_PACKET: u8 = 1;

/// The packets of one section.
pub struct Packets<'a, R> {
    pages: &'a mut PageReader<R>,
    /// Where the packets begin and end, logical bytes.
    pub start: u64,
    pub end: u64,
    buffer: Vec<u8>,
}

impl<'a, R: Read + Seek> Packets<'a, R> {
    /// Finds the section of a scan.
    pub fn open(pages: &'a mut PageReader<R>, scan: &ScanInfo) -> Result<Self> {
        let beyond = || FormatError::whole("it is cut short: the points lie beyond its end");
        let section = pages.logical(scan.offset).ok_or_else(beyond)?;
        pages.seek(section);
        let mut header = [0; SECTION_HEADER as usize];
        pages.read_exact(&mut header)?;
        if header[0] != 1 {
            fail!(byte scan.offset, "no section of points begins there");
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
    pub fn next(&mut self, fields: &mut Fields) -> Result<bool> {
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
            if stream.waiting().len() > MOST_WAITING {
                return damaged("the fields of the points do not advance together");
            }
            from = to;
        }
        Ok(true)
    }
}

/// The fields of a scan, by their place in the packets.
pub struct Fields {
    streams: Vec<Stream>,
    pub cartesian: Option<[usize; 3]>,
    pub cartesian_state: Option<usize>,
    pub spherical: Option<[usize; 3]>,
    pub spherical_state: Option<usize>,
    pub intensity: Option<usize>,
    pub intensity_state: Option<usize>,
    pub color: Option<[usize; 3]>,
    pub color_state: Option<usize>,
    pub row: Option<usize>,
    pub column: Option<usize>,
}

impl Fields {
    /// Finds the fields that are wanted.
    pub fn new(scan: &ScanInfo) -> Result<Self> {
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
            fail!(
                whole,
                "its points have neither Cartesian nor spherical coordinates"
            );
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
                    field.coding.into()
                } else {
                    Decoding::Ignored
                })
            })
            .collect();
        Ok(fields)
    }

    /// Points that every column holds, `most` at most; where no column says, a handy number.
    pub fn complete(&self, most: u64) -> usize {
        let held = self
            .streams
            .iter()
            .filter(|stream| !matches!(stream.decoding, Decoding::Ignored | Decoding::Constant(_)))
            .map(|stream| stream.waiting().len())
            .min()
            .unwrap_or(BATCH);
        usize::try_from(most).map_or(held, |most| held.min(most))
    }

    /// Points that every column with bits holds; none where there is no such column.
    pub fn waiting(&self) -> u64 {
        let constant =
            |stream: &Stream| matches!(stream.decoding, Decoding::Ignored | Decoding::Constant(_));
        match self.streams.iter().all(constant) {
            true => 0,
            false => self.complete(u64::MAX) as u64,
        }
    }

    /// Gives the fields without bits their values, so that every wanted column holds `count`.
    pub fn fill_constants(&mut self, count: usize) {
        for stream in &mut self.streams {
            stream.fill_constant(count);
        }
    }

    /// Forgets the first `count` values of every field.
    pub fn drop_first(&mut self, count: usize) {
        for stream in &mut self.streams {
            stream.drop_first(count);
        }
    }

    /// The first `count` values of a field.
    pub fn first(&self, field: usize, count: usize) -> &[f64] {
        &self.streams[field].waiting()[..count]
    }
}
