//! A copy of an E57 file with other poses: everything but the XML section, the header and checksums stays byte
//! for byte, and of the XML all but the poses.

use std::collections::BTreeMap;
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::ops::Range;

use roxmltree::{Document, Node};

use super::columns::Matrix;
use super::pages::{PAGE, PAYLOAD, checksum};
use super::write::{cdata, transform};
use super::xml::{Header, child, entries, parse, read_xml};
use crate::formats::error::{FormatError, Result, fail};

/// New poses by the place of their scan or picture in the file.
pub type Poses = BTreeMap<usize, Matrix>;

/// Pages copied at a time.
const BATCH: usize = 256;

/// Why a copy failed.
#[derive(Debug)]
pub enum CopyError {
    /// The source cannot be used.
    Source(FormatError),
    /// The copy cannot be written.
    Target(io::Error),
}

impl From<FormatError> for CopyError {
    fn from(error: FormatError) -> Self {
        Self::Source(error)
    }
}

/// Copies `source` to `target` with the poses given and, if there is one, the name of their reference system.
pub fn copy_with_poses<R: Read + Seek, W: Write>(
    mut source: R,
    target: &mut W,
    scans: &Poses,
    images: &Poses,
    coordinates: Option<&str>,
) -> std::result::Result<(), CopyError> {
    let (header, xml, pages) = read_xml(&mut source)?;
    let start = pages.logical(header.xml_offset).unwrap_or(0);
    let end = start + header.xml_length;
    let count = pages.len() / PAYLOAD as u64;
    let document = parse(&xml)?;
    let new_xml = with_poses(&xml, &document, scans, images, coordinates)?;
    // Where nothing follows the XML it is replaced; else the new one goes to the end, and the old one stays
    // behind, unused.
    let last = end.div_ceil(PAYLOAD as u64) == count
        && offsets(&document).all(|offset| offset < header.xml_offset);
    let cut = if last { start } else { count * PAYLOAD as u64 };
    let (whole, within) = (cut / PAYLOAD as u64, (cut % PAYLOAD as u64) as usize);
    let new_header = Header {
        length: (cut + new_xml.len() as u64).div_ceil(PAYLOAD as u64) * PAGE as u64,
        xml_offset: whole * PAGE as u64 + within as u64,
        xml_length: new_xml.len() as u64,
    };
    drop(pages);

    let mut tail = Vec::new();
    let mut page = 0;
    source.seek(SeekFrom::Start(0)).map_err(FormatError::from)?;
    let copied = whole + u64::from(within > 0);
    while page < copied {
        let mut raw = vec![0; (copied - page).min(BATCH as u64) as usize * PAGE];
        source.read_exact(&mut raw).map_err(FormatError::from)?;
        for bytes in raw.chunks_exact_mut(PAGE) {
            if checksum(&bytes[..PAYLOAD]) != bytes[PAYLOAD..] {
                return Err(FormatError::byte(
                    page * PAGE as u64,
                    "the checksum of the page does not match: the file is damaged there",
                )
                .into());
            }
            if page == 0 {
                new_header.put(bytes);
                let sum = checksum(&bytes[..PAYLOAD]);
                bytes[PAYLOAD..].copy_from_slice(&sum);
            }
            if page < whole {
                target.write_all(bytes).map_err(CopyError::Target)?;
            } else {
                tail.extend_from_slice(&bytes[..within]);
            }
            page += 1;
        }
    }
    tail.extend_from_slice(new_xml.as_bytes());
    for content in tail.chunks(PAYLOAD) {
        let mut bytes = [0; PAGE];
        bytes[..content.len()].copy_from_slice(content);
        let sum = checksum(&bytes[..PAYLOAD]);
        bytes[PAYLOAD..].copy_from_slice(&sum);
        target.write_all(&bytes).map_err(CopyError::Target)?;
    }
    target.flush().map_err(CopyError::Target)
}

/// Every physical offset that the XML refers to, in extensions too.
fn offsets<'a>(document: &'a Document) -> impl Iterator<Item = u64> + 'a {
    document
        .descendants()
        .filter_map(|node| node.attribute("fileOffset")?.trim().parse().ok())
}

/// The XML with other poses; the parser says where, the rest of the text is untouched.
fn with_poses(
    xml: &str,
    document: &Document,
    scans: &Poses,
    images: &Poses,
    coordinates: Option<&str>,
) -> Result<String> {
    let root = document.root_element();
    let mut edits: Vec<(Range<usize>, String)> = Vec::new();
    for (vector, poses, before) in [("data3D", scans, "points"), ("images2D", images, "")] {
        let nodes: Vec<Node> = entries(&root, vector).collect();
        for (&index, pose) in poses {
            let node = nodes
                .get(index)
                .ok_or_else(|| FormatError::whole(format!("{vector} has no entry {index}")))?;
            edits.push(edit(xml, node, pose, before)?);
        }
    }
    if let Some(text) = coordinates {
        let text = cdata(text);
        let prefix = prefix(&xml[root.range()]);
        let element = format!(
            "<{prefix}coordinateMetadata type=\"String\"><![CDATA[{text}]]></{prefix}coordinateMetadata>"
        );
        let place = match (child(&root, "coordinateMetadata"), root.first_child()) {
            (Some(old), _) => old.range(),
            (None, Some(first)) => first.range().start..first.range().start,
            (None, None) => fail!(whole, "its root element is empty"),
        };
        edits.push((place, element));
    }
    edits.sort_by_key(|(range, _)| range.start);
    let mut out = String::with_capacity(xml.len() + 1024 * edits.len());
    let mut at = 0;
    for (range, text) in edits {
        out.push_str(&xml[at..range.start]);
        out.push_str(&text);
        at = range.end;
    }
    out.push_str(&xml[at..]);
    Ok(out)
}

/// The prefix of an element's name, colon included; empty where it has none.
fn prefix(element: &str) -> String {
    let name = &element[1..element
        .find(|c: char| c.is_whitespace() || c == '>')
        .unwrap_or(1)];
    name.rsplit_once(':')
        .map_or(String::new(), |(prefix, _)| format!("{prefix}:"))
}

/// Which part of the text becomes what, to give a scan or picture a pose.
fn edit(xml: &str, node: &Node, pose: &Matrix, before: &str) -> Result<(Range<usize>, String)> {
    let prefix = prefix(&xml[node.range()]);
    let motion = motion(&prefix, pose);
    if let Some(old) = child(node, "pose") {
        // What an extension keeps in the pose stays.
        let kept: String = old
            .children()
            .filter(|inner| {
                inner.is_element()
                    && ["rotation", "translation"]
                        .iter()
                        .all(|name| child(&old, name) != Some(*inner))
            })
            .map(|inner| &xml[inner.range()])
            .collect();
        let old_text = &xml[old.range()];
        let open_end = old_text.find('>').unwrap_or(0);
        let open = old_text[..open_end].trim_end_matches('/');
        return Ok((old.range(), format!("{open}>{motion}{kept}</{prefix}pose>")));
    }
    let place = child(node, before)
        .or_else(|| node.first_element_child())
        .ok_or_else(|| FormatError::whole("its XML section has an empty entry"))?;
    let start = place.range().start;
    Ok((
        start..start,
        format!("<{prefix}pose type=\"Structure\">{motion}</{prefix}pose>"),
    ))
}

fn motion(prefix: &str, pose: &Matrix) -> String {
    let motion = transform(pose);
    let part = |group: &str, values: &[(&str, f64)]| {
        let inner: String = values
            .iter()
            .map(|(name, value)| format!("<{prefix}{name} type=\"Float\">{value}</{prefix}{name}>"))
            .collect();
        format!("<{prefix}{group} type=\"Structure\">{inner}</{prefix}{group}>")
    };
    let (turn, shift) = (motion.rotation, motion.translation);
    part(
        "rotation",
        &[("w", turn.w), ("x", turn.x), ("y", turn.y), ("z", turn.z)],
    ) + &part(
        "translation",
        &[("x", shift.x), ("y", shift.y), ("z", shift.z)],
    )
}
