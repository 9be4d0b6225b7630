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
    /// The values of the records of `buffer` that begin with record `from`; None where the buffer is too short.
    fn fill(&self, buffer: &[u8], from: usize, big_endian: bool, values: &mut [f64]) -> Option<()> {
        macro_rules! fill {
            ($type:ty) => {
                if big_endian {
                    self.convert(buffer, from, values, |raw| {
                        <$type>::from_be_bytes(raw) as f64
                    })
                } else {
                    self.convert(buffer, from, values, |raw| {
                        <$type>::from_le_bytes(raw) as f64
                    })
                }
            };
        }
        match self.scalar {
            Scalar::I8 => fill!(i8),
            Scalar::U8 => fill!(u8),
            Scalar::I16 => fill!(i16),
            Scalar::U16 => fill!(u16),
            Scalar::I32 => fill!(i32),
            Scalar::U32 => fill!(u32),
            Scalar::I64 => fill!(i64),
            Scalar::U64 => fill!(u64),
            Scalar::F32 => fill!(f32),
            Scalar::F64 => fill!(f64),
        }
    }

    #[inline]
    fn convert<const SIZE: usize, T>(
        &self,
        buffer: &[u8],
        from: usize,
        values: &mut [T],
        number: impl Fn([u8; SIZE]) -> T,
    ) -> Option<()> {
        let mut at = self.offset + from * self.stride;
        for value in values {
            *value = number(*buffer.get(at..)?.first_chunk()?);
            at += self.stride;
        }
        Some(())
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

/// Values of some records, column by column; kept between calls.
#[derive(Debug, Default)]
pub struct Room {
    xyz: [Vec<f64>; 3],
    intensity: Vec<f64>,
    color: Vec<[u16; 3]>,
    component: Vec<f64>,
}

impl Room {
    fn resize(&mut self, count: usize) {
        self.xyz
            .iter_mut()
            .for_each(|values| values.resize(count, 0.0));
        self.intensity.resize(count, 0.0);
        self.color.resize(count, [0; 3]);
        self.component.resize(count, 0.0);
    }
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
            fractions: !self.fractions().is_empty(),
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

    /// Columns of colours that are fractions of one.
    pub fn fractions(&self) -> Vec<usize> {
        match &self.color {
            ColorColumns::Separate(columns) => {
                let fractions = columns.iter().filter(|column| column.scalar.is_float());
                fractions.map(|column| column.offset).collect()
            }
            _ => Vec::new(),
        }
    }

    /// The same for columns that begin later by so many words.
    pub fn moved(mut self, by: usize) -> Self {
        let colors: &mut [Column] = match &mut self.color {
            ColorColumns::None => &mut [],
            ColorColumns::Packed(column) => std::slice::from_mut(column),
            ColorColumns::Separate(columns) => columns,
        };
        let others = self.xyz.iter_mut().chain(&mut self.intensity);
        others.chain(colors).for_each(|column| column.offset += by);
        self
    }

    /// The same with colours of another type.
    pub fn with_colors(&self, scalar: Scalar) -> Self {
        let mut layout = *self;
        if let ColorColumns::Separate(columns) = &mut layout.color {
            columns.iter_mut().for_each(|column| column.scalar = scalar);
        }
        layout
    }

    /// Hands on the points of `count` records of `buffer`, from record `from`; None where it is too short.
    pub fn points(
        &self,
        buffer: &[u8],
        from: usize,
        count: usize,
        room: &mut Room,
        mut take: impl FnMut(Point),
    ) -> Option<()> {
        room.resize(count);
        let big = self.big_endian;
        for (column, values) in self.xyz.iter().zip(&mut room.xyz) {
            column.fill(buffer, from, big, values)?;
        }
        if let Some(column) = &self.intensity {
            column.fill(buffer, from, big, &mut room.intensity)?;
        }
        match &self.color {
            ColorColumns::None => {}
            ColorColumns::Packed(column) if big => {
                column.convert(buffer, from, &mut room.color, |raw| {
                    unpack(u32::from_be_bytes(raw))
                })?;
            }
            ColorColumns::Packed(column) => {
                column.convert(buffer, from, &mut room.color, |raw| {
                    unpack(u32::from_le_bytes(raw))
                })?;
            }
            ColorColumns::Separate(columns) => {
                for (component, column) in columns.iter().enumerate() {
                    let fraction = column.scalar.is_float();
                    column.fill(buffer, from, big, &mut room.component)?;
                    for (color, value) in room.color.iter_mut().zip(&room.component) {
                        color[component] = component_of(*value, fraction);
                    }
                }
            }
        }
        let [x, y, z] = &room.xyz;
        let coordinates = x.iter().zip(y).zip(z);
        for (((x, y), z), (intensity, color)) in
            coordinates.zip(room.intensity.iter().zip(&room.color))
        {
            take(Point {
                xyz: [*x, *y, *z],
                intensity: *intensity,
                color: *color,
                cell: [0; 2],
            });
        }
        Some(())
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
