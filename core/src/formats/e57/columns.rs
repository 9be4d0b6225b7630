//! A scan that is written, and its fields.

use ::e57::{RecordDataType, RecordName, RecordValue};

/// Rows of a 4x4 rigid motion.
pub type Matrix = [[f64; 4]; 4];

/// x, y, z of each point, and how to store them.
pub enum Coordinates<'a> {
    /// 32-bit floats.
    Single(&'a [f32]),
    /// 64-bit floats.
    Double(&'a [f64]),
    /// Multiples of a step, metres.
    Scaled(&'a [f64], f64),
}

impl Coordinates<'_> {
    /// Points, of three coordinates each.
    pub fn len(&self) -> usize {
        match self {
            Self::Single(xyz) => xyz.len() / 3,
            Self::Double(xyz) | Self::Scaled(xyz, _) => xyz.len() / 3,
        }
    }

    /// Whether there is no point.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

/// One scan to write; each slice has one entry (colour: three) a point.
pub struct ScanData<'a> {
    /// Shown to people.
    pub name: &'a str,
    /// Tells this scan from every other.
    pub guid: &'a str,
    /// project_from_station.
    pub pose: Option<Matrix>,
    /// Station coordinates, metres.
    pub xyz: Coordinates<'a>,
    /// 0 to 1.
    pub intensity: Option<&'a [f32]>,
    /// Red, green, blue.
    pub color: Option<&'a [u8]>,
    /// Points without a colour.
    pub colorless: Option<&'a [bool]>,
    /// Grid row and column, from 0.
    pub grid: Option<(&'a [i32], &'a [i32])>,
    /// Cells without a return.
    pub invalid: Option<&'a [bool]>,
}

/// What a field holds.
enum Source {
    Axis(usize),
    Intensity,
    Color(usize),
    Colorless,
    Row,
    Column,
    Invalid,
}

/// One field of a scan.
pub struct Column {
    pub name: RecordName,
    pub data_type: RecordDataType,
    source: Source,
}

impl Column {
    /// The value of one point.
    pub fn value(&self, scan: &ScanData, index: usize) -> RecordValue {
        let invalid = scan.invalid.is_some_and(|invalid| invalid[index]);
        match (&self.source, &scan.xyz) {
            (Source::Axis(axis), Coordinates::Single(xyz)) => {
                RecordValue::Single(if invalid { 0.0 } else { xyz[3 * index + axis] })
            }
            (Source::Axis(axis), Coordinates::Double(xyz)) => {
                RecordValue::Double(if invalid { 0.0 } else { xyz[3 * index + axis] })
            }
            (Source::Axis(axis), Coordinates::Scaled(xyz, step)) => {
                let least = match self.data_type {
                    RecordDataType::ScaledInteger { min, .. } => min,
                    _ => 0,
                };
                RecordValue::ScaledInteger(if invalid {
                    least
                } else {
                    steps(xyz[3 * index + axis], *step)
                })
            }
            (Source::Intensity, _) => {
                RecordValue::Single(scan.intensity.map_or(0.0, |values| values[index]))
            }
            (Source::Color(channel), _) => RecordValue::Integer(
                scan.color
                    .map_or(0, |values| i64::from(values[3 * index + channel])),
            ),
            (Source::Colorless, _) => RecordValue::Integer(i64::from(
                scan.colorless.is_some_and(|colorless| colorless[index]),
            )),
            (Source::Row, _) => {
                RecordValue::Integer(scan.grid.map_or(0, |(rows, _)| i64::from(rows[index])))
            }
            (Source::Column, _) => RecordValue::Integer(
                scan.grid
                    .map_or(0, |(_, columns)| i64::from(columns[index])),
            ),
            (Source::Invalid, _) => RecordValue::Integer(if invalid { 2 } else { 0 }),
        }
    }
}

fn steps(value: f64, step: f64) -> i64 {
    (value / step).round() as i64
}

/// The fields of a scan, in the order of its records.
pub struct Columns(pub Vec<Column>);

impl Columns {
    /// Those that the scan has values for.
    pub fn new(scan: &ScanData) -> Self {
        let mut columns = Vec::new();
        let mut add = |name, data_type, source| {
            columns.push(Column {
                name,
                data_type,
                source,
            });
        };
        let axes = [
            RecordName::CartesianX,
            RecordName::CartesianY,
            RecordName::CartesianZ,
        ];
        for (axis, name) in axes.into_iter().enumerate() {
            let data_type = match scan.xyz {
                Coordinates::Single(_) => RecordDataType::Single {
                    min: None,
                    max: None,
                },
                Coordinates::Double(_) => RecordDataType::Double {
                    min: None,
                    max: None,
                },
                Coordinates::Scaled(xyz, step) => scaled(xyz, axis, step, scan.invalid),
            };
            add(name, data_type, Source::Axis(axis));
        }
        if scan.intensity.is_some() {
            let data_type = RecordDataType::Single {
                min: Some(0.0),
                max: Some(1.0),
            };
            add(RecordName::Intensity, data_type, Source::Intensity);
        }
        if scan.color.is_some() {
            let channels = [
                RecordName::ColorRed,
                RecordName::ColorGreen,
                RecordName::ColorBlue,
            ];
            for (channel, name) in channels.into_iter().enumerate() {
                let data_type = RecordDataType::Integer { min: 0, max: 255 };
                add(name, data_type, Source::Color(channel));
            }
            if scan.colorless.is_some() {
                let data_type = RecordDataType::Integer { min: 0, max: 1 };
                add(RecordName::IsColorInvalid, data_type, Source::Colorless);
            }
        }
        if let Some((rows, column)) = scan.grid {
            // A field without a single bit is legal, but not every reader can cope with it.
            let index = |values: &[i32]| RecordDataType::Integer {
                min: 0,
                max: i64::from(values.iter().copied().max().unwrap_or(0).max(1)),
            };
            add(RecordName::RowIndex, index(rows), Source::Row);
            add(RecordName::ColumnIndex, index(column), Source::Column);
        }
        if scan.invalid.is_some() {
            let data_type = RecordDataType::Integer { min: 0, max: 2 };
            add(
                RecordName::CartesianInvalidState,
                data_type,
                Source::Invalid,
            );
        }
        Self(columns)
    }
}

fn scaled(xyz: &[f64], axis: usize, step: f64, invalid: Option<&[bool]>) -> RecordDataType {
    let (mut min, mut max) = (i64::MAX, i64::MIN);
    for (index, point) in xyz.chunks_exact(3).enumerate() {
        if !invalid.is_some_and(|invalid| invalid[index]) {
            let value = steps(point[axis], step);
            (min, max) = (min.min(value), max.max(value));
        }
    }
    if min > max {
        (min, max) = (0, 0);
    }
    RecordDataType::ScaledInteger {
        min,
        max: max.max(min + 1),
        scale: step,
        offset: 0.0,
    }
}
