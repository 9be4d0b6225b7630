//! What an E57 file says of its scans and pictures.
//!
//! A fault in one scan or picture is kept beside it, so that it does not cost the others.

use std::io::{Read, Seek};

use roxmltree::Node;

use super::pages::PageReader;
use super::xml::{
    Entry, attribute, child, entries, float, parse, parse_float, qualified, read_xml, required,
    shown, string, text,
};
use crate::formats::error::{FormatError, Result, fail};

/// A file's scans and pictures.
#[derive(Clone, Debug, PartialEq)]
pub struct Description {
    pub scans: Vec<Entry<ScanInfo>>,
    pub images: Vec<Entry<ImageInfo>>,
}

/// How values of a field are stored.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Coding {
    Single {
        min: Option<f64>,
        max: Option<f64>,
    },
    Double {
        min: Option<f64>,
        max: Option<f64>,
    },
    /// `scale` is 1 and `offset` 0 for plain integers.
    Integer {
        min: i64,
        max: i64,
        scale: f64,
        offset: f64,
    },
}

impl Coding {
    /// Bits of one value.
    pub fn bits(self) -> u32 {
        match self {
            Self::Single { .. } => 32,
            Self::Double { .. } => 64,
            Self::Integer { min, max, .. } => {
                64 - max.wrapping_sub(min).cast_unsigned().leading_zeros()
            }
        }
    }

    /// The least and the largest value, where the type says.
    pub fn range(self) -> Option<(f64, f64)> {
        match self {
            Self::Single { min, max } | Self::Double { min, max } => min.zip(max),
            Self::Integer {
                min,
                max,
                scale,
                offset,
            } => (min != i64::MIN && max != i64::MAX)
                .then_some((min as f64 * scale + offset, max as f64 * scale + offset)),
        }
    }
}

/// One field of the points.
#[derive(Clone, Debug, PartialEq)]
pub struct Field {
    /// The name in the standard, or prefix and name of an extension's field.
    pub name: String,
    pub coding: Coding,
}

/// One scan.
#[derive(Clone, Debug, PartialEq)]
pub struct ScanInfo {
    pub guid: String,
    pub name: String,
    /// Points that the file promises.
    pub records: u64,
    /// Physical offset of the points.
    pub offset: u64,
    pub fields: Vec<Field>,
    pub pose: Option<Pose>,
    /// Least and largest row, least and largest column.
    pub index_bounds: Option<[i64; 4]>,
    pub intensity_limits: Option<(f64, f64)>,
    /// Largest red, green, blue.
    pub color_limits: Option<[f64; 3]>,
    /// Elements of extensions, with their prefix.
    pub extras: Vec<String>,
}

impl ScanInfo {
    /// The place of a field among the fields.
    pub fn place(&self, name: &str) -> Option<usize> {
        self.fields.iter().position(|field| field.name == name)
    }
}

/// A rigid motion as stored: nothing is checked.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    /// w, x, y, z.
    pub quaternion: [f64; 4],
    pub translation: [f64; 3],
}

/// One picture.
#[derive(Clone, Debug, PartialEq)]
pub struct ImageInfo {
    pub guid: String,
    pub name: String,
    /// The scan that it belongs to; empty where the file does not say.
    pub scan_guid: String,
    pub pose: Option<Pose>,
    /// `pinhole`, `spherical`, `cylindrical` or `visual-reference`.
    pub kind: &'static str,
    pub png: bool,
    /// Physical offset and logical length of the encoded picture.
    pub blob: (u64, u64),
    pub width: u32,
    pub height: u32,
    /// Names and values of the camera model, as in the standard.
    pub model: Vec<(String, f64)>,
}

/// What the file holds, without its points and pictures.
pub fn describe<R: Read + Seek>(file: R) -> Result<Description> {
    let (_, xml, pages) = read_xml(file)?;
    let document = parse(&xml)?;
    let root = document.root_element();
    if root.tag_name().name() != "e57Root" {
        fail!(whole, "its XML section does not begin with e57Root");
    }
    let mut scans: Vec<Entry<ScanInfo>> =
        entries(&root, "data3D").map(|node| scan(&node)).collect();
    let mut images: Vec<Entry<ImageInfo>> = entries(&root, "images2D")
        .map(|node| image(&node))
        .collect();
    refuse_shared(&mut scans, pages.len(), |scan| {
        let bits: u64 = scan
            .fields
            .iter()
            .map(|field| u64::from(field.coding.bits()))
            .sum();
        u128::from(scan.records) * u128::from(bits.max(1)) / 8
    });
    refuse_shared(&mut images, pages.len(), |image| u128::from(image.blob.1));
    Ok(Description { scans, images })
}

/// Refuses entries that need more bytes than the ones before leave of the file: several would share them. One that alone
/// needs more is refused when it is read.
fn refuse_shared<T>(entries: &mut [Entry<T>], file: u64, bytes: impl Fn(&T) -> u128) {
    let mut left = u128::from(file);
    for entry in entries {
        let Ok(found) = entry else { continue };
        let needed = bytes(found);
        match left.checked_sub(needed) {
            Some(rest) => left = rest,
            None if needed > u128::from(file) => {}
            None => {
                *entry = Err("it promises more than the others leave room for in the file".into())
            }
        }
    }
}

/// The encoded bytes of a picture.
pub fn read_image<R: Read + Seek>(file: R, image: &ImageInfo) -> Result<Vec<u8>> {
    let mut pages = PageReader::new(file)?;
    let (offset, length) = image.blob;
    let cut = || {
        FormatError::whole(format!(
            "it is cut short: the picture '{}' lies beyond its end",
            image.name
        ))
    };
    let start = pages.logical(offset).ok_or_else(cut)?;
    // A section of binary data has a header of 16 bytes (ASTM E2807).
    if pages.len() - start < 16 || length > pages.len() - start - 16 {
        return Err(cut());
    }
    pages.seek(start);
    let mut header = [0; 16];
    pages.read_exact(&mut header)?;
    if header[0] != 0 {
        let reason = format!("the picture '{}' does not begin there", image.name);
        return Err(FormatError::byte(offset, reason));
    }
    let mut data = vec![0; length as usize];
    pages.read_exact(&mut data)?;
    Ok(data)
}

fn scan(node: &Node) -> Entry<ScanInfo> {
    let points = child(node, "points").ok_or("it has no points element")?;
    let prototype = child(&points, "prototype").ok_or("its points have no prototype")?;
    let fields = prototype
        .children()
        .filter(Node::is_element)
        .map(|inner| {
            Ok(Field {
                name: qualified(&inner),
                coding: coding(&inner)?,
            })
        })
        .collect::<Entry<Vec<Field>>>()?;
    let place = |name: &str| fields.iter().find(|field| field.name == name);
    let limits = |group: &str, low: &str, high: &str, field: &str| {
        let group = child(node, group)?;
        let value = |name| limit(&child(&group, name)?, place(field)?.coding);
        Some((value(low)?, value(high)?))
    };
    let color = |name: &str| {
        limits(
            "colorLimits",
            &format!("color{name}Minimum"),
            &format!("color{name}Maximum"),
            &format!("color{name}"),
        )
    };
    let colors = || Some([color("Red")?.1, color("Green")?.1, color("Blue")?.1]);
    Ok(ScanInfo {
        guid: string(node, "guid"),
        name: string(node, "name"),
        records: required(&points, "recordCount")?,
        offset: required(&points, "fileOffset")?,
        pose: pose(node)?,
        index_bounds: child(node, "indexBounds").and_then(|bounds| {
            // A grid of more rows or columns than 32 bits count is none.
            let value = |name| {
                let value = parse_float(text(&child(&bounds, name)?)).ok()?;
                (value.abs() <= f64::from(i32::MAX)).then_some(value as i64)
            };
            Some([
                value("rowMinimum")?,
                value("rowMaximum")?,
                value("columnMinimum")?,
                value("columnMaximum")?,
            ])
        }),
        intensity_limits: limits(
            "intensityLimits",
            "intensityMinimum",
            "intensityMaximum",
            "intensity",
        ),
        color_limits: colors(),
        extras: node
            .children()
            .filter(|inner| {
                inner.is_element()
                    && inner.tag_name().namespace()
                        != node.document().root_element().tag_name().namespace()
            })
            .map(|inner| qualified(&inner))
            .collect(),
        fields,
    })
}

fn coding(node: &Node) -> Entry<Coding> {
    let name = node.tag_name().name();
    match node.attribute("type") {
        Some("Float") => {
            let (min, max) = (attribute(node, "minimum")?, attribute(node, "maximum")?);
            match node.attribute("precision").unwrap_or("double") {
                "single" => Ok(Coding::Single { min, max }),
                "double" => Ok(Coding::Double { min, max }),
                other => Err(format!(
                    "{name} has the unknown precision '{}'",
                    shown(other)
                )),
            }
        }
        Some(kind @ ("Integer" | "ScaledInteger")) => {
            let min = attribute(node, "minimum")?.unwrap_or(i64::MIN);
            let max = attribute(node, "maximum")?.unwrap_or(i64::MAX);
            if min > max {
                return Err(format!("{name} has a minimum above its maximum"));
            }
            let scaled = kind == "ScaledInteger";
            let number = |what| attribute(node, what).map(|value| value.filter(|_| scaled));
            Ok(Coding::Integer {
                min,
                max,
                scale: number("scale")?.unwrap_or(1.0),
                offset: number("offset")?.unwrap_or(0.0),
            })
        }
        other => Err(format!(
            "{name} is of the unknown type '{}'",
            shown(other.unwrap_or(""))
        )),
    }
}

/// A limit's value in the unit of its field; none where it is no number.
fn limit(node: &Node, field: Coding) -> Option<f64> {
    let stored = parse_float(text(node)).ok()?;
    if node.attribute("type") != Some("ScaledInteger") {
        return Some(stored);
    }
    // A scaled limit is stored as the integer it scales, by its own factors or those of the field.
    let (scale, offset) = match field {
        Coding::Integer { scale, offset, .. } => (scale, offset),
        Coding::Single { .. } | Coding::Double { .. } => (1.0, 0.0),
    };
    let own = |name| attribute(node, name).ok().flatten();
    Some(stored * own("scale").unwrap_or(scale) + own("offset").unwrap_or(offset))
}

fn pose(node: &Node) -> Entry<Option<Pose>> {
    let Some(pose) = child(node, "pose") else {
        return Ok(None);
    };
    let part = |group: &str, name: &str, default: f64| match child(&pose, group) {
        Some(group) => Ok(float(&group, name)?.unwrap_or(0.0)),
        None => Entry::Ok(default),
    };
    Ok(Some(Pose {
        quaternion: [
            part("rotation", "w", 1.0)?,
            part("rotation", "x", 0.0)?,
            part("rotation", "y", 0.0)?,
            part("rotation", "z", 0.0)?,
        ],
        translation: [
            part("translation", "x", 0.0)?,
            part("translation", "y", 0.0)?,
            part("translation", "z", 0.0)?,
        ],
    }))
}

/// Representations, the ones with a camera model first.
const REPRESENTATIONS: [(&str, &str); 4] = [
    ("pinholeRepresentation", "pinhole"),
    ("sphericalRepresentation", "spherical"),
    ("cylindricalRepresentation", "cylindrical"),
    ("visualReferenceRepresentation", "visual-reference"),
];

fn image(node: &Node) -> Entry<ImageInfo> {
    let (representation, kind) = REPRESENTATIONS
        .iter()
        .find_map(|(tag, kind)| Some((child(node, tag)?, *kind)))
        .ok_or("it has no representation")?;
    let (blob, png) = match (
        child(&representation, "jpegImage"),
        child(&representation, "pngImage"),
    ) {
        (Some(blob), _) => (blob, false),
        (None, Some(blob)) => (blob, true),
        (None, None) => return Err("it is neither JPEG nor PNG".into()),
    };
    let size = |name| {
        let value = float(&representation, name)?.unwrap_or(0.0);
        if (1.0..=f64::from(u32::MAX)).contains(&value) {
            Ok(value as u32)
        } else {
            Err(format!("its {name} is {value}"))
        }
    };
    let numbers = representation
        .children()
        .filter(|inner| inner.is_element() && inner.attribute("type") == Some("Float"));
    // Leica's extension: the lens distortion, in OpenCV's terms.
    let distortion = node.descendants().filter(|inner| {
        inner.is_element()
            && inner.tag_name().name().starts_with("CV_")
            && inner.attribute("type") == Some("Float")
    });
    let model = numbers
        .chain(distortion)
        .map(|inner| {
            Ok((
                inner.tag_name().name().to_owned(),
                parse_float(text(&inner))?,
            ))
        })
        .collect::<Entry<Vec<_>>>()?;
    Ok(ImageInfo {
        guid: string(node, "guid"),
        name: string(node, "name"),
        scan_guid: string(node, "associatedData3DGuid"),
        pose: pose(node)?,
        kind,
        png,
        blob: (required(&blob, "fileOffset")?, required(&blob, "length")?),
        width: size("imageWidth")?,
        height: size("imageHeight")?,
        model,
    })
}
