//! The header of an E57 file, its XML section, and what elements hold.

use std::io::{Read, Seek};

use roxmltree::{Document, Node};

use super::pages::{PAGE, PageReader};
use crate::formats::error::{FormatError, Result, fail};

/// Bytes of XML that no real file exceeds; parsing takes several times as much memory.
const MOST_XML: u64 = 256 << 20;
/// Elements of the standard have five attributes; text with equals signs, which is not told from them, is short.
const MOST_ATTRIBUTES: usize = 2000;
/// Files of a thousand scans whose extension is declared anew for each have as many.
const MOST_NAMESPACES: usize = 4096;
const HEADER: usize = 48;

/// Something described in the file, or what is wrong with its description.
pub type Entry<T> = std::result::Result<T, String>;

/// The file header (ASTM E2807).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Header {
    /// Physical bytes of the file.
    pub length: u64,
    /// Physical offset of the XML section.
    pub xml_offset: u64,
    /// Logical bytes of the XML section.
    pub xml_length: u64,
}

impl Header {
    /// Puts the three numbers where they belong in the first page.
    pub fn put(&self, page: &mut [u8]) {
        page[16..24].copy_from_slice(&self.length.to_le_bytes());
        page[24..32].copy_from_slice(&self.xml_offset.to_le_bytes());
        page[32..40].copy_from_slice(&self.xml_length.to_le_bytes());
    }
}

/// Reads the header and the XML section.
pub fn read_xml<R: Read + Seek>(file: R) -> Result<(Header, String, PageReader<R>)> {
    let mut pages = PageReader::new(file)?;
    let mut raw = [0; HEADER];
    if pages.len() == 0 {
        fail!(whole, "it is empty");
    }
    pages.read_exact(&mut raw)?;
    let word = |at: usize| {
        let mut bytes = [0; 8];
        bytes.copy_from_slice(&raw[at..at + 8]);
        u64::from_le_bytes(bytes)
    };
    if &raw[..8] != b"ASTM-E57" {
        fail!(whole, "it is no E57 file");
    }
    if raw[8..12] != [1, 0, 0, 0] {
        fail!(whole, "its E57 version is unknown: only version 1 is");
    }
    if word(40) != PAGE as u64 {
        fail!(whole, "its pages have {} bytes, not {PAGE}", word(40));
    }
    let header = Header {
        length: word(16),
        xml_offset: word(24),
        xml_length: word(32),
    };
    let cut = || {
        FormatError::whole(format!(
            "it is cut short: the header promises {} bytes and an index at byte {}, the file has {} bytes",
            header.length,
            header.xml_offset,
            pages.physical_len()
        ))
    };
    if header.length > pages.physical_len() {
        return Err(cut());
    }
    let start = pages.logical(header.xml_offset).ok_or_else(cut)?;
    if header.xml_length > pages.len() - start {
        return Err(cut());
    }
    if header.xml_length > MOST_XML {
        fail!(
            whole,
            "its XML section of {} bytes is implausible",
            header.xml_length
        );
    }
    let mut xml = vec![0; header.xml_length as usize];
    pages.seek(start);
    pages.read_exact(&mut xml)?;
    let xml = String::from_utf8(xml)
        .map_err(|_| FormatError::byte(header.xml_offset, "the XML section is no UTF-8 text"))?;
    Ok((header, xml, pages))
}

/// Parses the XML section; some writers pad it with zero bytes.
pub fn parse(xml: &str) -> Result<Document<'_>> {
    check_attributes(xml.as_bytes())?;
    Document::parse(xml.trim_end_matches('\0'))
        .map_err(|error| FormatError::whole(format!("its XML section is damaged: {error}")))
}

/// Refuses more attributes of an element, or more namespaces, than the parser can take: it compares each with the others.
fn check_attributes(xml: &[u8]) -> Result<()> {
    if memchr::memmem::find_iter(xml, b"xmlns").count() > MOST_NAMESPACES {
        fail!(
            whole,
            "its XML section declares more than {MOST_NAMESPACES} namespaces"
        );
    }
    // Whatever stands between two tags, text with such signs included.
    let tags = xml.split(|byte| *byte == b'<');
    if tags
        .map(|tag| memchr::memchr_iter(b'=', tag).count())
        .any(|attributes| attributes > MOST_ATTRIBUTES)
    {
        fail!(
            whole,
            "an element of its XML section has more than {MOST_ATTRIBUTES} attributes"
        );
    }
    Ok(())
}

/// A value for a message.
pub fn shown(value: &str) -> String {
    crate::formats::text::excerpt(value.as_bytes())
}

/// The children of a vector of structures.
pub fn entries<'a, 'i>(root: &Node<'a, 'i>, vector: &str) -> impl Iterator<Item = Node<'a, 'i>> {
    child(root, vector)
        .into_iter()
        .flat_map(|vector| vector.children())
        .filter(|node| node.is_element() && node.tag_name().name() == "vectorChild")
}

/// The child of that name that belongs to the standard, not to an extension.
pub fn child<'a, 'i>(node: &Node<'a, 'i>, name: &str) -> Option<Node<'a, 'i>> {
    let namespace = node.document().root_element().tag_name().namespace();
    node.children().find(|inner| {
        inner.is_element()
            && inner.tag_name().name() == name
            && inner.tag_name().namespace() == namespace
    })
}

/// The text of an element.
pub fn text<'a>(node: &Node<'a, '_>) -> &'a str {
    node.text().unwrap_or("").trim()
}

/// The text of a child; empty where there is none.
pub fn string(node: &Node, name: &str) -> String {
    child(node, name).map_or_else(String::new, |inner| text(&inner).to_owned())
}

/// A number as XML has it.
pub fn parse_float(text: &str) -> Entry<f64> {
    // An empty element is zero.
    if text.is_empty() {
        return Ok(0.0);
    }
    text.parse()
        .map_err(|_| format!("'{}' is no number", shown(text)))
}

/// The number in a child, if there is one.
pub fn float(node: &Node, name: &str) -> Entry<Option<f64>> {
    child(node, name)
        .map(|inner| parse_float(text(&inner)).map_err(|reason| format!("{name}: {reason}")))
        .transpose()
}

/// The number in an attribute, if there is one.
pub fn attribute<T: std::str::FromStr>(node: &Node, name: &str) -> Entry<Option<T>> {
    node.attribute(name)
        .map(|value| {
            value.trim().parse().map_err(|_| {
                format!(
                    "{} of {}: '{}' is no such number",
                    name,
                    shown(node.tag_name().name()),
                    shown(value)
                )
            })
        })
        .transpose()
}

/// The number in an attribute that must be there.
pub fn required<T: std::str::FromStr>(node: &Node, name: &str) -> Entry<T> {
    attribute(node, name)?.ok_or_else(|| format!("{} has no {name}", node.tag_name().name()))
}

/// Name with the prefix of its extension, if it has one.
pub fn qualified(node: &Node) -> String {
    let name = node.tag_name().name();
    let standard = node.document().root_element().tag_name().namespace();
    match node.tag_name().namespace() {
        space if space == standard => name.to_owned(),
        space => {
            let prefix = space.and_then(|uri| node.lookup_prefix(uri)).unwrap_or("?");
            format!("{prefix}:{name}")
        }
    }
}
