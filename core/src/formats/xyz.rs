//! Rows of numbers with nothing agreed: separator, decimal sign and columns are told from the first lines.

use std::io::Read;

use super::cloud::{Channels, Cloud};
use super::error::{FormatError, Result, fail};
use super::record::{ColorColumns, Column, Layout, Role, Scalar, role_of};
use super::text::{Lines, is_blank, is_comment, not_a_point, numbers};

/// So many rows tell what the columns are.
const SAMPLE: usize = 1000;
/// Columns beyond this are not looked at.
const MOST_COLUMNS: usize = 256;

/// What the first lines of a file say.
#[derive(Clone, Debug, PartialEq)]
pub struct Table {
    /// The columns' names, if a header line or a comment gives them.
    pub names: Vec<String>,
    /// Numbers in a row.
    pub columns: usize,
    pub layout: Layout,
    pub channels: Channels,
    /// Commas are decimal signs, not separators.
    pub decimal_comma: bool,
    /// Where the rows start, comments before them included.
    pub offset: u64,
    /// The line before.
    pub line: u64,
}

fn role_of_column(name: &str) -> Option<Role> {
    match name {
        "easting" | "east" => Some(Role::Axis(0)),
        "northing" | "north" => Some(Role::Axis(1)),
        "elevation" | "height" | "altitude" => Some(Role::Axis(2)),
        _ => role_of(name).filter(|role| *role != Role::PackedColor),
    }
}

/// The words of a header line or comment, without units and quotes.
fn names_of(line: &[u8]) -> Vec<String> {
    let text = String::from_utf8_lossy(line);
    let text = text.trim_start_matches(['\u{feff}', '#', '/', '%', '!', ' ']);
    let by_comma = text.contains([',', ';']);
    text.split(|c: char| matches!(c, ',' | ';' | '\t' | '\r') || (c == ' ' && !by_comma))
        .map(|word| {
            word.trim_matches(|c: char| c.is_whitespace() || c == '"' || c == '\'')
                .chars()
                .take_while(|c| c.is_alphanumeric() || *c == '_')
                .collect::<String>()
                .to_lowercase()
        })
        .filter(|word| !word.is_empty())
        .collect()
}

fn name_axes(names: &[String]) -> bool {
    (0..3).all(|axis| {
        names
            .iter()
            .any(|name| role_of_column(name) == Some(Role::Axis(axis)))
    })
}

/// Whether the commas of a row are decimal signs: `1,5;2,0;3,1` or `1,5 2,0 3,1`.
fn has_decimal_commas(line: &[u8]) -> bool {
    if !line.contains(&b',') {
        return false;
    }
    if line.contains(&b';') {
        return true;
    }
    let words: Vec<&[u8]> = line
        .split(|byte| matches!(byte, b' ' | b'\t' | b'\r'))
        .filter(|word| !word.is_empty())
        .collect();
    words.len() >= 3
        && words.iter().all(|word| {
            word.iter().filter(|byte| **byte == b',').count() == 1
                && !word.starts_with(b",")
                && !word.ends_with(b",")
        })
}

/// A row's numbers; `scratch` holds the line while decimal commas become points.
fn row(
    line: &[u8],
    decimal_comma: bool,
    scratch: &mut Vec<u8>,
    values: &mut [f64],
) -> Option<usize> {
    if !decimal_comma {
        return numbers(line, values).ok();
    }
    scratch.clear();
    scratch.extend(
        line.iter()
            .map(|byte| if *byte == b',' { b'.' } else { *byte }),
    );
    numbers(scratch, values).ok()
}

/// Reads the first rows and tells the columns.
pub fn sniff<R: Read>(source: R) -> Result<Table> {
    let mut lines = Lines::new(source);
    let mut names = Vec::new();
    let mut start = (0, 0);
    let mut decimal_comma = false;
    let mut sample: Vec<Vec<f64>> = Vec::new();
    let mut scratch = Vec::new();
    let mut values = vec![0.0; MOST_COLUMNS];
    while sample.len() < SAMPLE {
        let before = (lines.offset(), lines.number());
        let Some(line) = lines.next_line()? else {
            break;
        };
        let line = line.strip_prefix(b"\xef\xbb\xbf").unwrap_or(line);
        if is_blank(line) {
            continue;
        }
        if sample.is_empty() {
            decimal_comma = has_decimal_commas(line);
        }
        let found = if is_comment(line) {
            None
        } else {
            row(line, decimal_comma, &mut scratch, &mut values)
        };
        match found {
            Some(count) if count >= 3 => {
                if sample.is_empty() {
                    start = before;
                }
                sample.push(values[..count.min(MOST_COLUMNS)].to_vec());
            }
            _ if sample.is_empty() => {
                let candidate = names_of(line);
                if name_axes(&candidate) {
                    names = candidate;
                } else if !is_comment(line) && before.1 > 0 {
                    return Err(not_a_point(before.1 + 1, line));
                }
            }
            _ if is_comment(line) => {}
            _ => return Err(not_a_point(before.1 + 1, line)),
        }
    }
    let Some(columns) = sample.iter().map(Vec::len).min() else {
        fail!(whole, "it holds no points");
    };
    // A header that names more or fewer columns than there are cannot be relied on.
    if names.len() != columns {
        names.clear();
    }
    let layout = if names.is_empty() {
        guess(&sample, columns)
    } else {
        named(&names, &sample)
    };
    Ok(Table {
        names,
        columns,
        channels: layout.channels(false),
        layout,
        decimal_comma,
        offset: start.0,
        line: start.1,
    })
}

/// Fractions of one where the sample holds nothing beyond it and not only whole numbers.
fn color_scalar(sample: &[Vec<f64>], columns: [usize; 3]) -> Scalar {
    let values = || sample.iter().flat_map(|row| columns.map(|at| row[at]));
    if values().all(|value| value <= 1.0) && values().any(|value| value.fract() != 0.0) {
        Scalar::F32
    } else {
        Scalar::U16
    }
}

fn layout(
    sample: &[Vec<f64>],
    xyz: [usize; 3],
    intensity: Option<usize>,
    color: Option<[usize; 3]>,
) -> Layout {
    let column = |offset, scalar| Column {
        scalar,
        offset,
        stride: 0,
    };
    Layout {
        xyz: xyz.map(|at| column(at, Scalar::F64)),
        intensity: intensity.map(|at| column(at, Scalar::F64)),
        color: match color {
            Some(at) => {
                let scalar = color_scalar(sample, at);
                ColorColumns::Separate(at.map(|at| column(at, scalar)))
            }
            None => ColorColumns::None,
        },
        big_endian: false,
    }
}

fn named(names: &[String], sample: &[Vec<f64>]) -> Layout {
    let find = |wanted| {
        names
            .iter()
            .position(|name| role_of_column(name) == Some(wanted))
    };
    let three = |role: fn(usize) -> Role| Some([find(role(0))?, find(role(1))?, find(role(2))?]);
    layout(
        sample,
        three(Role::Axis).unwrap_or([0, 1, 2]),
        find(Role::Intensity),
        three(Role::Color),
    )
}

/// Columns that nothing names: x y z, then what the numbers look like.
fn guess(sample: &[Vec<f64>], columns: usize) -> Layout {
    let bytes = |from: usize| {
        from + 3 <= columns
            && sample.iter().all(|row| {
                row[from..from + 3]
                    .iter()
                    .all(|value| value.fract() == 0.0 && (0.0..=255.0).contains(value))
            })
    };
    let (intensity, color) = match columns {
        3 => (None, None),
        4 | 5 => (Some(3), None),
        6 => (None, bytes(3).then_some([3, 4, 5])),
        _ if bytes(4) => (Some(3), Some([4, 5, 6])),
        _ if bytes(3) => (Some(6), Some([3, 4, 5])),
        _ => (Some(3), None),
    };
    layout(sample, [0, 1, 2], intensity, color)
}

/// Reads every point; `source` stands at `table.offset`.
pub fn read<R: Read>(source: R, table: &Table, metres_per_unit: f64) -> Result<Cloud> {
    let mut lines = Lines::at(source, table.offset, table.line);
    let mut cloud = Cloud::new(table.channels, metres_per_unit, 0);
    let mut values = vec![0.0; table.columns];
    let mut scratch = Vec::new();
    loop {
        let at = lines.number() + 1;
        let Some(line) = lines.next_line()? else {
            return Ok(cloud);
        };
        let line = if at == 1 {
            line.strip_prefix(b"\xef\xbb\xbf").unwrap_or(line)
        } else {
            line
        };
        match row(line, table.decimal_comma, &mut scratch, &mut values) {
            Some(count) if count >= table.columns => {
                let point = table
                    .layout
                    .point_of_words(&values)
                    .ok_or_else(|| FormatError::line(at, "the row is too short"))?;
                cloud.push(&point);
            }
            _ if is_blank(line) || is_comment(line) => {}
            Some(count) => {
                fail!(line at, "there are {count} numbers, the rows before have {}", table.columns)
            }
            None => return Err(not_a_point(at, line)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn all(text: &str) -> (Table, Cloud) {
        let table = sniff(text.as_bytes()).unwrap();
        let cloud = read(&text.as_bytes()[table.offset as usize..], &table, 1.0).unwrap();
        (table, cloud)
    }

    #[test]
    fn a_header_line_names_the_columns() {
        let (table, cloud) = all("Red,Green,Blue,\"Z [m]\",Y,X,Intensity\n255,0,1,3,2,1,0.5\n");
        assert_eq!(table.names[3], "z");
        assert_eq!(cloud.xyz, vec![1.0, 2.0, 3.0]);
        assert_eq!((cloud.color, cloud.intensity), (vec![255, 0, 1], vec![0.5]));
    }

    #[test]
    fn decimal_commas() {
        for text in [
            "1,5;2,25;-3,0\n4,0;5,0;6,0\n",
            "1,5 2,25 -3,0\n4,0 5,0 6,0\n",
        ] {
            assert_eq!(all(text).1.xyz, vec![1.5, 2.25, -3.0, 4.0, 5.0, 6.0]);
        }
        assert_eq!(all("1,2,3\n").1.xyz, vec![1.0, 2.0, 3.0]);
    }

    #[test]
    fn columns_without_names() {
        assert_eq!(all("1 2 3 40 50 60\n").1.color, vec![40, 50, 60]);
        assert!(!all("1 2 3 0.6 0.8 0.0\n").0.channels.color);
        let (_, cloud) = all("# a survey\n1 2 3 -700 40 50 60\n");
        assert_eq!(
            (cloud.intensity, cloud.color),
            (vec![-700.0], vec![40, 50, 60])
        );
        let (_, cloud) = all("//X Y Z R G B\n1 2 3 0.5 1.0 0\n");
        assert_eq!(cloud.color, vec![128, 255, 0]);
    }

    #[test]
    fn a_row_that_is_none_is_named_by_its_line() {
        let text = "1 2 3\n4 5 6\n7 8\n";
        let table = sniff("1 2 3\n4 5 6\n".as_bytes()).unwrap();
        let error = read(text.as_bytes(), &table, 1.0).unwrap_err();
        assert_eq!(error.place.to_string(), "line 3");
        assert!(sniff("hello\nthere\n".as_bytes()).is_err());
    }
}
