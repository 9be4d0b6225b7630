//! PCD, the Point Cloud Library's format: a text header, then ASCII, binary or LZF-compressed records.
//!
//! Format: <https://pointclouds.org/documentation/tutorials/pcd_file_format.html>.

use std::io::Read;

use super::cloud::{Channels, Cloud};
use super::error::{FormatError, Result, fail};
use super::limits::{BYTES_PER_POINT, allowed_memory};
use super::lzf;
use super::record::{Column, Layout, Room, Scalar, layout_of};
use super::text::{Lines, excerpt, is_blank, not_a_point, numbers};

/// Points that are taken at a time.
const BLOCK: usize = 1 << 13;

/// How the records are stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Encoding {
    Ascii,
    Binary,
    Compressed,
}

#[derive(Clone, Debug)]
pub struct Field {
    pub name: String,
    pub scalar: Scalar,
    pub count: usize,
}

#[derive(Clone, Debug)]
pub struct Header {
    pub fields: Vec<Field>,
    pub width: u64,
    pub height: u64,
    pub points: u64,
    /// Translation x y z, then the quaternion w x y z.
    pub viewpoint: Option<[f64; 7]>,
    pub encoding: Encoding,
    /// Where the records start.
    pub data_offset: u64,
}

impl Header {
    fn record_size(&self) -> usize {
        self.fields
            .iter()
            .map(|field| field.scalar.size() * field.count)
            .sum()
    }

    /// Where the values of a point are: words of a line, interleaved records, or one array a field.
    pub fn layout(&self) -> Result<Layout> {
        let mut offset = 0;
        let mut columns = Vec::with_capacity(self.fields.len());
        for field in &self.fields {
            let size = field.scalar.size() * field.count;
            let (stride, step) = match self.encoding {
                Encoding::Ascii => (0, field.count),
                Encoding::Binary => (self.record_size(), size),
                Encoding::Compressed => (size, size * self.points as usize),
            };
            columns.push((
                field.name.clone(),
                Column {
                    scalar: field.scalar,
                    offset,
                    stride,
                },
            ));
            offset += step;
        }
        layout_of(&columns, false).map_err(FormatError::whole)
    }
}

/// Reads the header and leaves the stream at the first record.
pub fn read_header<R: Read>(source: R, file_size: u64) -> Result<(Header, Lines<R>)> {
    let mut lines = Lines::new(source);
    let mut names: Vec<String> = Vec::new();
    let mut sizes: Vec<usize> = Vec::new();
    let mut types: Vec<String> = Vec::new();
    let mut counts: Vec<usize> = Vec::new();
    let (mut width, mut height, mut points, mut viewpoint) = (None, None, None, None);
    let encoding = loop {
        let at = lines.number() + 1;
        let Some(line) = lines.next_line()? else {
            fail!(whole, "the PCD header has no DATA line");
        };
        let Ok(text) = std::str::from_utf8(line) else {
            fail!(line at, "the PCD header is not text");
        };
        let text = text.trim_start_matches('\u{feff}').trim();
        if text.is_empty() || text.starts_with('#') {
            continue;
        }
        let mut words = text.split_ascii_whitespace();
        let keyword = words.next().unwrap_or_default();
        let rest: Vec<&str> = words.collect();
        let whole = |word: Option<&&str>| -> Result<u64> {
            word.and_then(|word| word.parse().ok()).ok_or_else(|| {
                FormatError::line(at, format!("{keyword} is not followed by whole numbers"))
            })
        };
        let wholes = || -> Result<Vec<usize>> {
            rest.iter()
                .map(|word| Ok(whole(Some(word))? as usize))
                .collect()
        };
        match keyword.to_ascii_uppercase().as_str() {
            "VERSION" => {}
            "FIELDS" | "COLUMNS" => names = rest.iter().map(|word| word.to_string()).collect(),
            "SIZE" => sizes = wholes()?,
            "TYPE" => types = rest.iter().map(|word| word.to_ascii_uppercase()).collect(),
            "COUNT" => counts = wholes()?,
            "WIDTH" => width = Some(whole(rest.first())?),
            "HEIGHT" => height = Some(whole(rest.first())?),
            "POINTS" => points = Some(whole(rest.first())?),
            "VIEWPOINT" => {
                let values: Vec<f64> = rest.iter().filter_map(|word| word.parse().ok()).collect();
                let values: [f64; 7] = values.try_into().map_err(|_| {
                    FormatError::line(at, "VIEWPOINT is not followed by seven numbers")
                })?;
                viewpoint = Some(values);
            }
            "DATA" => {
                break match rest
                    .first()
                    .map(|word| word.to_ascii_lowercase())
                    .as_deref()
                {
                    Some("ascii") => Encoding::Ascii,
                    Some("binary") => Encoding::Binary,
                    Some("binary_compressed") => Encoding::Compressed,
                    _ => fail!(line at, "DATA is none of ascii, binary, binary_compressed"),
                };
            }
            _ => fail!(line at, "the PCD header is missing or damaged: it has '{}'", excerpt(line)),
        }
    };
    if counts.is_empty() {
        counts = vec![1; names.len()];
    }
    if names.is_empty() || [sizes.len(), types.len(), counts.len()] != [names.len(); 3] {
        fail!(
            whole,
            "the PCD header's FIELDS, SIZE, TYPE and COUNT do not have the same number of entries"
        );
    }
    let mut fields = Vec::with_capacity(names.len());
    for (((name, size), kind), count) in names.into_iter().zip(sizes).zip(types).zip(counts) {
        let scalar = match (kind.as_str(), size) {
            ("I", 1) => Scalar::I8,
            ("U", 1) => Scalar::U8,
            ("I", 2) => Scalar::I16,
            ("U", 2) => Scalar::U16,
            ("I", 4) => Scalar::I32,
            ("U", 4) => Scalar::U32,
            ("I", 8) => Scalar::I64,
            ("U", 8) => Scalar::U64,
            ("F", 4) => Scalar::F32,
            ("F", 8) => Scalar::F64,
            _ => fail!(
                whole,
                "PCD field {name} has no known type: TYPE {kind}, SIZE {size}"
            ),
        };
        if count == 0 || count > 65_536 {
            fail!(whole, "PCD field {name} has an absurd COUNT of {count}");
        }
        fields.push(Field {
            name,
            scalar,
            count,
        });
    }
    let height = height.unwrap_or(1);
    let width = match (width, points) {
        (Some(width), _) => width,
        (None, Some(points)) => points,
        (None, None) => fail!(whole, "the PCD header has no WIDTH or POINTS"),
    };
    let cells = width.checked_mul(height);
    let points = points.or(cells).unwrap_or(0);
    if cells != Some(points) {
        fail!(
            whole,
            "the PCD header contradicts itself: WIDTH {width} x HEIGHT {height} is not POINTS {points}"
        );
    }
    let header = Header {
        fields,
        width,
        height,
        points,
        viewpoint,
        encoding,
        data_offset: lines.offset(),
    };
    let room = file_size.saturating_sub(header.data_offset);
    let least = match encoding {
        // A value takes a character, and one more parts it from the next; the last line may lack its end.
        Encoding::Ascii => {
            let values: usize = header.fields.iter().map(|field| field.count).sum();
            (points as u128 * 2 * values as u128).saturating_sub(1)
        }
        Encoding::Binary => points as u128 * header.record_size() as u128,
        Encoding::Compressed => 8,
    };
    if least > room as u128 {
        fail!(
            whole,
            "the file is too short for its header: {points} points need {least} bytes or more, {room} follow the header"
        );
    }
    Ok((header, lines))
}

/// Reads every point.
pub fn read<R: Read>(source: R, file_size: u64, metres_per_unit: f64) -> Result<(Header, Cloud)> {
    let (header, mut lines) = read_header(source, file_size)?;
    if header.points == 0 {
        return Ok((header, Cloud::new(Channels::default(), metres_per_unit, 0)));
    }
    let points = header.points as usize;
    if header.encoding == Encoding::Compressed {
        let block = unpack_block(&header, lines.into_rest(), file_size)?;
        let layout = header.layout()?;
        let mut cloud = Cloud::new(layout.channels(header.height > 1), metres_per_unit, points);
        let mut room = Room::default();
        for from in (0..points).step_by(BLOCK) {
            let count = BLOCK.min(points - from);
            push(&layout, &block, from, count, &header, &mut room, &mut cloud)?;
        }
        return Ok((header, cloud.finished()));
    }
    let layout = header.layout()?;
    let mut cloud = Cloud::new(layout.channels(header.height > 1), metres_per_unit, points);
    if header.encoding == Encoding::Ascii {
        read_ascii(&header, &layout, &mut lines, &mut cloud)?;
        cloud.open_end = lines.open();
        cloud.surplus = lines.rows_left()?;
    } else {
        let mut source = lines.into_rest();
        read_binary(&header, &layout, &mut source, &mut cloud)?;
        let rest = std::io::copy(&mut source, &mut std::io::sink())?;
        cloud.surplus = rest / header.record_size() as u64;
    }
    Ok((header, cloud.finished()))
}

/// Adds the points of `count` records, from record `from` of the buffer.
fn push(
    layout: &Layout,
    buffer: &[u8],
    from: usize,
    count: usize,
    header: &Header,
    room: &mut Room,
    cloud: &mut Cloud,
) -> Result<()> {
    layout
        .points(buffer, from, count, room, |mut point| {
            point.cell = cell(cloud.records(), header.width);
            cloud.push(&point);
        })
        .ok_or_else(|| FormatError::whole("a point lies beyond its block"))
}

/// Row and column of an organised cloud, which is stored row by row.
#[inline]
fn cell(number: u64, width: u64) -> [i32; 2] {
    let width = width.max(1);
    [(number / width) as i32, (number % width) as i32]
}

fn read_binary<R: Read>(
    header: &Header,
    layout: &Layout,
    source: &mut R,
    cloud: &mut Cloud,
) -> Result<()> {
    let size = header.record_size();
    let records = ((1 << 18) / size).clamp(1, BLOCK);
    let mut room = Room::default();
    let mut block = vec![0; size * records];
    let mut done = 0;
    while done < header.points {
        let count = (header.points - done).min(records as u64) as usize;
        source.read_exact(&mut block[..count * size]).map_err(|_| {
            FormatError::byte(
                header.data_offset + done * size as u64,
                format!("the file ends within its {} points", header.points),
            )
        })?;
        push(layout, &block, 0, count, header, &mut room, cloud)?;
        done += count as u64;
    }
    Ok(())
}

fn unpack_block<R: Read>(header: &Header, mut source: R, file_size: u64) -> Result<Vec<u8>> {
    let mut sizes = [0; 8];
    source.read_exact(&mut sizes)?;
    let [a, b, c, d, e, f, g, h] = sizes;
    let packed = u32::from_le_bytes([a, b, c, d]) as u64;
    let unpacked = u32::from_le_bytes([e, f, g, h]) as u64;
    let place = header.data_offset;
    let room = file_size.saturating_sub(place + 8);
    if packed > room {
        fail!(byte place, "the compressed block should have {packed} bytes, the file has {room} left");
    }
    let needed = header.points as u128 * header.record_size() as u128;
    if unpacked as u128 != needed {
        fail!(byte place, "the compressed block holds {unpacked} bytes, {} points need {needed}", header.points);
    }
    // Three bytes of LZF give 264 at most.
    if unpacked > packed * 88 + 264 {
        fail!(byte place, "the compressed block cannot grow to the size it claims");
    }
    let memory = packed + unpacked + header.points * BYTES_PER_POINT;
    if memory > allowed_memory(file_size) {
        fail!(byte place, "{packed} compressed bytes cannot be worth {} points", header.points);
    }
    let mut input = vec![0; packed as usize];
    source.read_exact(&mut input)?;
    lzf::unpack(&input, unpacked as usize)
        .ok_or_else(|| FormatError::byte(place + 8, "the compressed block is damaged"))
}

fn read_ascii<R: Read>(
    header: &Header,
    layout: &Layout,
    lines: &mut Lines<R>,
    cloud: &mut Cloud,
) -> Result<()> {
    let total = header.fields.iter().map(|field| field.count).sum();
    let mut values = vec![0.0; total];
    let mut done = 0;
    while done < header.points {
        let (number, line) = lines.point_line(done, header.points)?;
        if is_blank(line) {
            continue;
        }
        let count = numbers(line, &mut values).map_err(|_| not_a_point(number, line))?;
        if count != total {
            fail!(line number, "there are {count} values, the header says {total}");
        }
        let mut point = layout
            .point_of_words(&values)
            .ok_or_else(|| FormatError::line(number, "the line is too short"))?;
        point.cell = cell(done, header.width);
        cloud.push(&point);
        done += 1;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    const HEADER: &str = "VERSION 0.7\nFIELDS x y z rgb\nSIZE 4 4 4 4\nTYPE F F F U\nCOUNT 1 1 1 1\nWIDTH 2\nHEIGHT 1\nVIEWPOINT 0 0 1.5 1 0 0 0\nPOINTS 2\n";

    fn read_bytes(bytes: &[u8]) -> Result<(Header, Cloud)> {
        read(bytes, bytes.len() as u64, 1.0)
    }

    fn records() -> Vec<u8> {
        let mut bytes = Vec::new();
        for (xyz, rgb) in [
            ([1.0f32, 2.0, 3.0], 0x0a0b0cu32),
            ([-1.0, 0.5, 0.25], 0xff0001),
        ] {
            xyz.iter()
                .for_each(|value| bytes.extend(value.to_le_bytes()));
            bytes.extend(rgb.to_le_bytes());
        }
        bytes
    }

    fn check(bytes: &[u8]) {
        let (header, cloud) = read_bytes(bytes).unwrap();
        assert_eq!(header.viewpoint.unwrap()[2], 1.5);
        assert_eq!(cloud.xyz, vec![1.0, 2.0, 3.0, -1.0, 0.5, 0.25]);
        assert_eq!(cloud.color, vec![10, 11, 12, 255, 0, 1]);
    }

    #[test]
    fn the_same_points_in_each_encoding() {
        check(format!("{HEADER}DATA ascii\n1 2 3 658188\n-1 0.5 .25 16711681\n").as_bytes());
        let mut binary = format!("{HEADER}DATA binary\n").into_bytes();
        binary.extend(records());
        check(&binary);
        let interleaved = records();
        let mut arrays = Vec::new();
        for field in 0..4 {
            for record in 0..2 {
                let at = record * 16 + field * 4;
                arrays.extend_from_slice(&interleaved[at..at + 4]);
            }
        }
        let mut packed = vec![31];
        packed.extend_from_slice(&arrays);
        let mut compressed = format!("{HEADER}DATA binary_compressed\n").into_bytes();
        compressed.extend(33u32.to_le_bytes());
        compressed.extend(32u32.to_le_bytes());
        compressed.extend(packed);
        check(&compressed);
    }

    #[test]
    fn counts_beyond_the_file_are_refused_before_anything_is_allocated() {
        let huge = HEADER
            .replace("WIDTH 2", "WIDTH 4000000000000")
            .replace("POINTS 2", "POINTS 4000000000000");
        for data in ["ascii", "binary", "binary_compressed"] {
            let mut bytes = format!("{huge}DATA {data}\n").into_bytes();
            bytes.extend(records());
            assert!(read_bytes(&bytes).is_err(), "{data}");
        }
        let mut cut = format!("{HEADER}DATA binary\n").into_bytes();
        cut.extend(&records()[..31]);
        assert!(read_bytes(&cut).is_err());
    }
}
