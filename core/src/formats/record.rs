//! Binary point records: which bytes are which value.

use super::cloud::{Channels, Point};

/// A number as stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Scalar {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    I64,
    U64,
    F32,
    F64,
}

impl Scalar {
    pub fn size(self) -> usize {
        match self {
            Scalar::I8 | Scalar::U8 => 1,
            Scalar::I16 | Scalar::U16 => 2,
            Scalar::I32 | Scalar::U32 | Scalar::F32 => 4,
            Scalar::I64 | Scalar::U64 | Scalar::F64 => 8,
        }
    }

    pub fn is_float(self) -> bool {
        matches!(self, Scalar::F32 | Scalar::F64)
    }

    /// The value at the start of `bytes`; None where they are too few.
    #[inline]
    pub fn read(self, bytes: &[u8], big_endian: bool) -> Option<f64> {
        macro_rules! number {
            ($type:ty) => {{
                let raw = *bytes.first_chunk()?;
                (if big_endian {
                    <$type>::from_be_bytes(raw)
                } else {
                    <$type>::from_le_bytes(raw)
                }) as f64
            }};
        }
        Some(match self {
            Scalar::I8 => number!(i8),
            Scalar::U8 => number!(u8),
            Scalar::I16 => number!(i16),
            Scalar::U16 => number!(u16),
            Scalar::I32 => number!(i32),
            Scalar::U32 => number!(u32),
            Scalar::I64 => number!(i64),
            Scalar::U64 => number!(u64),
            Scalar::F32 => number!(f32),
            Scalar::F64 => number!(f64),
        })
    }
}

/// One value of every record: that of record i starts at `offset + i * stride`. In a text line it is word `offset`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Column {
    pub scalar: Scalar,
    pub offset: usize,
    pub stride: usize,
}

impl Column {
    #[inline]
    fn bytes<'a>(&self, buffer: &'a [u8], index: usize) -> Option<&'a [u8]> {
        buffer.get(self.offset + index * self.stride..)
    }

    #[inline]
    fn value(&self, buffer: &[u8], index: usize, big_endian: bool) -> Option<f64> {
        self.scalar.read(self.bytes(buffer, index)?, big_endian)
    }

    /// The low four bytes as they are, for colours packed into a float.
    #[inline]
    fn bits(&self, buffer: &[u8], index: usize, big_endian: bool) -> Option<u32> {
        let raw = *self.bytes(buffer, index)?.first_chunk()?;
        Some(if big_endian {
            u32::from_be_bytes(raw)
        } else {
            u32::from_le_bytes(raw)
        })
    }
}

/// How colour is stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ColorColumns {
    None,
    Separate([Column; 3]),
    /// 0x..RRGGBB in four bytes, whatever their type.
    Packed(Column),
}

/// Where a record's values are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Layout {
    pub xyz: [Column; 3],
    pub intensity: Option<Column>,
    pub color: ColorColumns,
    pub big_endian: bool,
}

impl Layout {
    pub fn channels(&self, grid: bool) -> Channels {
        Channels {
            intensity: self.intensity.is_some(),
            color: self.color != ColorColumns::None,
            grid,
        }
    }

    /// Where the values in use are: of x, y, z, then of intensity and of colour where there are.
    pub fn offsets(&self) -> Vec<usize> {
        let color: &[Column] = match &self.color {
            ColorColumns::None => &[],
            ColorColumns::Packed(column) => std::slice::from_ref(column),
            ColorColumns::Separate(columns) => columns,
        };
        self.xyz
            .iter()
            .chain(&self.intensity)
            .chain(color)
            .map(|column| column.offset)
            .collect()
    }

    /// Record `index` of `buffer`; None where the buffer is too short.
    #[inline]
    pub fn point(&self, buffer: &[u8], index: usize) -> Option<Point> {
        let value = |column: &Column| column.value(buffer, index, self.big_endian);
        let color = match &self.color {
            ColorColumns::None => [0; 3],
            ColorColumns::Packed(column) => unpack(column.bits(buffer, index, self.big_endian)?),
            ColorColumns::Separate(columns) => {
                let mut color = [0; 3];
                for (component, column) in color.iter_mut().zip(columns) {
                    *component = component_of(value(column)?, column.scalar.is_float());
                }
                color
            }
        };
        Some(Point {
            xyz: [
                value(&self.xyz[0])?,
                value(&self.xyz[1])?,
                value(&self.xyz[2])?,
            ],
            intensity: match &self.intensity {
                Some(column) => value(column)?,
                None => 0.0,
            },
            color,
            cell: [0; 2],
        })
    }

    /// The point in the numbers of a text line; None where they are too few.
    #[inline]
    pub fn point_of_words(&self, words: &[f64]) -> Option<Point> {
        let word = |column: &Column| words.get(column.offset).copied();
        let color = match &self.color {
            ColorColumns::None => [0; 3],
            ColorColumns::Packed(column) if column.scalar.is_float() => {
                unpack((word(column)? as f32).to_bits())
            }
            ColorColumns::Packed(column) => unpack(word(column)? as i64 as u32),
            ColorColumns::Separate(columns) => {
                let mut color = [0; 3];
                for (component, column) in color.iter_mut().zip(columns) {
                    *component = component_of(word(column)?, column.scalar.is_float());
                }
                color
            }
        };
        Some(Point {
            xyz: [
                word(&self.xyz[0])?,
                word(&self.xyz[1])?,
                word(&self.xyz[2])?,
            ],
            intensity: match &self.intensity {
                Some(column) => word(column)?,
                None => 0.0,
            },
            color,
            cell: [0; 2],
        })
    }
}

/// Red, green, blue of 0x..RRGGBB.
#[inline]
fn unpack(bits: u32) -> [u16; 3] {
    [16, 8, 0].map(|shift| (bits >> shift & 0xff) as u16)
}

/// A colour component as 8 or 16 bits; fractions are of one.
#[inline]
fn component_of(value: f64, fraction: bool) -> u16 {
    if fraction {
        (value * 255.0).round() as u16
    } else {
        value as u16
    }
}

/// What a field's name says that it holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Role {
    Axis(usize),
    Intensity,
    Color(usize),
    PackedColor,
}

/// Names in use for coordinates, intensity and colour, in any case.
pub fn role_of(name: &str) -> Option<Role> {
    let lower = name.to_ascii_lowercase();
    let bare = lower.strip_prefix("scalar_").unwrap_or(&lower);
    let bare = bare.strip_prefix("diffuse_").unwrap_or(bare);
    Some(match bare {
        "x" => Role::Axis(0),
        "y" => Role::Axis(1),
        "z" => Role::Axis(2),
        "intensity" | "i" | "reflectance" | "remission" => Role::Intensity,
        "red" | "r" => Role::Color(0),
        "green" | "g" => Role::Color(1),
        "blue" | "b" => Role::Color(2),
        "rgb" | "rgba" => Role::PackedColor,
        _ => return None,
    })
}

/// The layout of named columns, or what is missing.
pub fn layout_of(fields: &[(String, Column)], big_endian: bool) -> Result<Layout, String> {
    let find = |wanted: Role| {
        fields
            .iter()
            .find(|(name, _)| role_of(name) == Some(wanted))
            .map(|(_, column)| *column)
    };
    let three = |role: fn(usize) -> Role| Some([find(role(0))?, find(role(1))?, find(role(2))?]);
    let xyz = three(Role::Axis).ok_or_else(|| {
        let names: Vec<&str> = fields.iter().map(|(name, _)| name.as_str()).collect();
        format!("it has no x, y and z, only: {}", names.join(" "))
    })?;
    let color = match (three(Role::Color), find(Role::PackedColor)) {
        (Some(columns), _) => ColorColumns::Separate(columns),
        (None, Some(column)) if column.scalar.size() == 4 => ColorColumns::Packed(column),
        _ => ColorColumns::None,
    };
    Ok(Layout {
        xyz,
        intensity: find(Role::Intensity),
        color,
        big_endian,
    })
}
