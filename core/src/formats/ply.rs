//! PLY, the Stanford polygon format: a text header, then elements as text or in either byte order.
//!
//! Described at <http://paulbourke.net/dataformats/ply/>. Points are the element `vertex`; every other element and
//! all lists are passed over.

use std::io::{BufReader, Read};

use super::cloud::{Channels, Cloud};
use super::error::{FormatError, Result, fail};
use super::record::{Column, Layout, Room, Scalar, layout_of};
use super::text::{Lines, excerpt, is_blank, not_a_point, numbers};

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Encoding {
    Ascii,
    Binary { big_endian: bool },
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Kind {
    Value(Scalar),
    List { count: Scalar, item: Scalar },
}

#[derive(Clone, Debug)]
pub struct Property {
    pub name: String,
    pub kind: Kind,
}

#[derive(Clone, Debug)]
pub struct Element {
    pub name: String,
    pub count: u64,
    pub properties: Vec<Property>,
}

impl Element {
    /// The bytes of a record if every list is empty.
    fn least_size(&self) -> usize {
        self.properties
            .iter()
            .map(|property| match property.kind {
                Kind::Value(scalar) => scalar.size(),
                Kind::List { count, .. } => count.size(),
            })
            .sum()
    }

    fn has_lists(&self) -> bool {
        self.properties
            .iter()
            .any(|property| matches!(property.kind, Kind::List { .. }))
    }
}

#[derive(Clone, Debug)]
pub struct Header {
    pub encoding: Encoding,
    pub elements: Vec<Element>,
    /// Which element is `vertex`.
    vertex: usize,
    /// Where the first element starts.
    pub data_offset: u64,
}

impl Header {
    pub fn vertex(&self) -> &Element {
        &self.elements[self.vertex]
    }

    /// Whether nothing follows the points.
    fn ends_with_points(&self) -> bool {
        let later = &self.elements[self.vertex + 1..];
        later.iter().all(|element| element.count == 0)
    }

    /// Where the values of a point are once its lists are dropped: bytes of a record, or words of a line.
    pub fn layout(&self) -> Result<Layout> {
        let values = || {
            self.vertex()
                .properties
                .iter()
                .filter_map(|property| match property.kind {
                    Kind::Value(scalar) => Some((property.name.clone(), scalar)),
                    Kind::List { .. } => None,
                })
        };
        let ascii = self.encoding == Encoding::Ascii;
        let stride = values().map(|(_, scalar)| scalar.size()).sum();
        let mut offset = 0;
        let columns: Vec<(String, Column)> = values()
            .map(|(name, scalar)| {
                let column = Column {
                    scalar,
                    offset,
                    stride,
                };
                offset += if ascii { 1 } else { scalar.size() };
                (name, column)
            })
            .collect();
        let big_endian = self.encoding == Encoding::Binary { big_endian: true };
        layout_of(&columns, big_endian).map_err(FormatError::whole)
    }
}

fn scalar_of(name: &str) -> Option<Scalar> {
    Some(match name {
        "char" | "int8" => Scalar::I8,
        "uchar" | "uint8" => Scalar::U8,
        "short" | "int16" => Scalar::I16,
        "ushort" | "uint16" => Scalar::U16,
        "int" | "int32" => Scalar::I32,
        "uint" | "uint32" => Scalar::U32,
        "int64" | "long" => Scalar::I64,
        "uint64" | "ulong" => Scalar::U64,
        "float" | "float32" => Scalar::F32,
        "double" | "float64" => Scalar::F64,
        _ => return None,
    })
}

/// Reads the header and leaves the stream at the first element.
pub fn read_header<R: Read>(source: R, file_size: u64) -> Result<(Header, Lines<R>)> {
    let mut lines = Lines::new(source);
    let mut encoding = None;
    let mut elements: Vec<Element> = Vec::new();
    loop {
        let at = lines.number() + 1;
        let Some(line) = lines.next_line()? else {
            fail!(line at, "the file ends within its PLY header");
        };
        let damaged =
            || FormatError::line(at, format!("'{}' is no PLY header line", excerpt(line)));
        let text = std::str::from_utf8(line).map_err(|_| damaged())?;
        let words: Vec<&str> = text.split_ascii_whitespace().collect();
        match words.as_slice() {
            ["ply"] if at == 1 => {}
            _ if at == 1 => fail!(line 1, "a PLY file begins with 'ply'"),
            [] | ["comment" | "obj_info", ..] => {}
            ["format", kind, ..] => {
                encoding = Some(match *kind {
                    "ascii" => Encoding::Ascii,
                    "binary_little_endian" => Encoding::Binary { big_endian: false },
                    "binary_big_endian" => Encoding::Binary { big_endian: true },
                    _ => return Err(damaged()),
                });
            }
            ["element", name, count] => elements.push(Element {
                name: name.to_string(),
                count: count.parse().map_err(|_| damaged())?,
                properties: Vec::new(),
            }),
            ["property", rest @ ..] => {
                let element = elements.last_mut().ok_or_else(damaged)?;
                let (kind, name) = match rest {
                    ["list", count, item, name] => {
                        let count = scalar_of(count).filter(|scalar| !scalar.is_float());
                        let kind = Kind::List {
                            count: count.ok_or_else(damaged)?,
                            item: scalar_of(item).ok_or_else(damaged)?,
                        };
                        (kind, name)
                    }
                    [kind, name] => (Kind::Value(scalar_of(kind).ok_or_else(damaged)?), name),
                    _ => return Err(damaged()),
                };
                element.properties.push(Property {
                    name: name.to_string(),
                    kind,
                });
            }
            ["end_header"] => break,
            _ => return Err(damaged()),
        }
    }
    let encoding =
        encoding.ok_or_else(|| FormatError::whole("the PLY header has no format line"))?;
    let vertex = elements
        .iter()
        .position(|element| element.name == "vertex")
        .ok_or_else(|| FormatError::whole("the PLY file has no element 'vertex'"))?;
    let header = Header {
        encoding,
        elements,
        vertex,
        data_offset: lines.offset(),
    };
    let room = file_size.saturating_sub(header.data_offset);
    let least: u128 = header.elements[..=vertex]
        .iter()
        .map(|element| {
            let each = match encoding {
                Encoding::Ascii => 2 * element.properties.len(),
                Encoding::Binary { .. } => element.least_size(),
            };
            element.count as u128 * each as u128
        })
        .sum();
    if least > room as u128 + 1 {
        fail!(
            whole,
            "the file is too short for its header: {} points need {least} bytes or more, {room} follow the header",
            header.vertex().count
        );
    }
    Ok((header, lines))
}

/// Reads every point.
pub fn read<R: Read>(source: R, file_size: u64, metres_per_unit: f64) -> Result<(Header, Cloud)> {
    let (header, mut lines) = read_header(source, file_size)?;
    let layout = header.layout()?;
    let count = header.vertex().count;
    if count == 0 {
        return Ok((header, Cloud::new(Channels::default(), metres_per_unit, 0)));
    }
    let mut cloud = Cloud::new(layout.channels(false), metres_per_unit, count as usize);
    match header.encoding {
        Encoding::Ascii => read_ascii(&header, &layout, &mut lines, &mut cloud)?,
        Encoding::Binary { .. } => {
            let mut source = BufReader::with_capacity(1 << 18, lines.into_rest());
            read_binary(&header, &layout, &mut source, &mut cloud)?;
            if header.ends_with_points() {
                let rest = std::io::copy(&mut source, &mut std::io::sink())?;
                cloud.surplus = rest / header.vertex().least_size() as u64;
            }
            return Ok((header, cloud.finished()));
        }
    }
    if header.ends_with_points() {
        cloud.open_end = lines.open();
        cloud.surplus = lines.rows_left()?;
    }
    Ok((header, cloud.finished()))
}

fn read_ascii<R: Read>(
    header: &Header,
    layout: &Layout,
    lines: &mut Lines<R>,
    cloud: &mut Cloud,
) -> Result<()> {
    for element in &header.elements[..header.vertex] {
        if element.properties.is_empty() {
            continue;
        }
        if lines.skip(element.count)? < element.count {
            fail!(line lines.number(), "the file ends within its element '{}'", element.name);
        }
    }
    let vertex = header.vertex();
    let lists = vertex.has_lists();
    let mut words = vec![0.0; vertex.properties.len()];
    let mut all = Vec::new();
    let mut done = 0;
    while done < vertex.count {
        let (at, line) = lines.point_line(done, vertex.count)?;
        if is_blank(line) {
            continue;
        }
        let wrong = || not_a_point(at, line);
        if lists {
            all.clear();
            all.resize(line.len() / 2 + 1, 0.0);
            let count = numbers(line, &mut all).map_err(|_| wrong())?;
            drop_lists(vertex, &all[..count], &mut words).ok_or_else(wrong)?;
        } else if numbers(line, &mut words).map_err(|_| wrong())? != words.len() {
            return Err(wrong());
        }
        cloud.push(&layout.point_of_words(&words).ok_or_else(wrong)?);
        done += 1;
    }
    Ok(())
}

/// The single values of a line that has lists among them.
fn drop_lists(element: &Element, line: &[f64], words: &mut [f64]) -> Option<()> {
    let mut at = 0;
    let mut kept = 0;
    for property in &element.properties {
        let value = *line.get(at)?;
        at += 1;
        match property.kind {
            Kind::Value(_) => {
                *words.get_mut(kept)? = value;
                kept += 1;
            }
            Kind::List { .. } if value >= 0.0 && value <= line.len() as f64 => at += value as usize,
            Kind::List { .. } => return None,
        }
    }
    (at == line.len()).then_some(())
}

fn read_binary<R: Read>(
    header: &Header,
    layout: &Layout,
    source: &mut R,
    cloud: &mut Cloud,
) -> Result<()> {
    let big_endian = layout.big_endian;
    let mut record = Vec::new();
    for element in &header.elements[..header.vertex] {
        for _ in 0..element.count {
            if element.properties.is_empty() {
                break;
            }
            record.clear();
            read_record(element, source, big_endian, &mut record)?;
        }
    }
    let vertex = header.vertex();
    let mut room = Room::default();
    let ends = || FormatError::whole(format!("the file ends within its {} points", vertex.count));
    if vertex.has_lists() {
        for _ in 0..vertex.count {
            record.clear();
            read_record(vertex, source, big_endian, &mut record)?;
            layout
                .points(&record, 0, 1, &mut room, |point| cloud.push(&point))
                .ok_or_else(ends)?;
        }
        return Ok(());
    }
    let size = vertex.least_size();
    let records = ((1 << 18) / size).max(1);
    let mut block = vec![0; size * records];
    let mut done = 0;
    while done < vertex.count {
        let count = (vertex.count - done).min(records as u64) as usize;
        source
            .read_exact(&mut block[..count * size])
            .map_err(|_| ends())?;
        layout
            .points(&block, 0, count, &mut room, |point| cloud.push(&point))
            .ok_or_else(ends)?;
        done += count as u64;
    }
    Ok(())
}

/// Reads one record and keeps its single values.
fn read_record<R: Read>(
    element: &Element,
    source: &mut R,
    big_endian: bool,
    record: &mut Vec<u8>,
) -> Result<()> {
    let ends = || {
        FormatError::whole(format!(
            "the file ends within its element '{}'",
            element.name
        ))
    };
    let mut bytes = [0; 8];
    for property in &element.properties {
        match property.kind {
            Kind::Value(scalar) => {
                let value = &mut bytes[..scalar.size()];
                source.read_exact(value).map_err(|_| ends())?;
                record.extend_from_slice(value);
            }
            Kind::List { count, item } => {
                let value = &mut bytes[..count.size()];
                source.read_exact(value).map_err(|_| ends())?;
                let length = count.read(value, big_endian).unwrap_or(-1.0);
                if length < 0.0 {
                    fail!(
                        whole,
                        "a list of element '{}' has a negative length",
                        element.name
                    );
                }
                let skip = (length as u64).saturating_mul(item.size() as u64);
                let skipped = std::io::copy(&mut source.by_ref().take(skip), &mut std::io::sink())?;
                if skipped < skip {
                    return Err(ends());
                }
            }
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read_bytes(bytes: &[u8]) -> Result<(Header, Cloud)> {
        read(bytes, bytes.len() as u64, 1.0)
    }

    fn header(format: &str) -> String {
        format!(
            "ply\nformat {format} 1.0\ncomment a\nobj_info b\nelement face 2\nproperty list uchar int vertex_indices\n\
             element vertex 2\nproperty uchar red\nproperty uchar green\nproperty uchar blue\nproperty double z\n\
             property list ushort float weights\nproperty float y\nproperty short x\nelement edge 1\nproperty int a\nend_header\n"
        )
    }

    fn check(bytes: &[u8]) {
        let (_, cloud) = read_bytes(bytes).unwrap();
        assert_eq!(cloud.xyz, vec![-1.0, 2.5, 3.25, 7.0, 8.0, 9.0]);
        assert_eq!(cloud.color, vec![1, 2, 3, 4, 5, 6]);
    }

    #[test]
    fn any_order_of_elements_properties_and_bytes() {
        let text = "3 0 1 0\n0\n1 2 3 3.25 2 0.5 0.5 2.5 -1\n4 5 6 9 0 8 7\n5\n";
        check((header("ascii") + text).as_bytes());
        for big in [false, true] {
            let (name, order) = if big {
                ("binary_big_endian", true)
            } else {
                ("binary_little_endian", false)
            };
            let mut bytes = header(name).into_bytes();
            let mut put = |raw: &[u8]| {
                if order {
                    bytes.extend(raw.iter().rev());
                } else {
                    bytes.extend(raw);
                }
            };
            put(&[3]);
            [0i32, 1, 0]
                .iter()
                .for_each(|index| put(&index.to_le_bytes()));
            put(&[0]);
            [1, 2, 3].iter().for_each(|value| put(&[*value]));
            put(&3.25f64.to_le_bytes());
            put(&2u16.to_le_bytes());
            [0.5f32, 0.5, 2.5]
                .iter()
                .for_each(|value| put(&value.to_le_bytes()));
            put(&(-1i16).to_le_bytes());
            [4, 5, 6].iter().for_each(|value| put(&[*value]));
            put(&9f64.to_le_bytes());
            put(&0u16.to_le_bytes());
            put(&8f32.to_le_bytes());
            put(&7i16.to_le_bytes());
            check(&bytes);
            assert!(read_bytes(&bytes[..bytes.len() - 3]).is_err());
        }
    }

    #[test]
    fn counts_beyond_the_file_are_refused() {
        for format in ["ascii", "binary_little_endian"] {
            for what in ["vertex", "face"] {
                let huge =
                    header(format).replace(&format!("{what} 2"), &format!("{what} 99999999999"));
                assert!(read_bytes(huge.as_bytes()).is_err());
            }
        }
    }
}
