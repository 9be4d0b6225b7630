//! PTX, Leica's text format: one or more scans, each a header and a grid of points in the scanner's own frame.
//!
//! The header is the number of columns, the number of rows, the scanner's position and axes (four lines of three
//! numbers) and a 4x4 matrix for row vectors: its transpose takes scanner coordinates to those of the project.
//! Points follow column by column; a direction without a return is `0 0 0`.
//! Described at <http://paulbourke.net/dataformats/ptx/>.

use std::io::Read;

use super::cloud::{Channels, Cloud, Point};
use super::error::{FormatError, Result, fail};
use super::row::{RowReader, has_decimal_commas};
use super::text::{Lines, excerpt, is_blank, not_a_point};

/// "0 0 0" and a line end: no point takes less.
const LEAST_LINE: u64 = 6;
/// So many lines tell which values a scan stores: points without a return may lack some.
const SAMPLE: u64 = 1000;

#[derive(Clone, Debug, PartialEq)]
pub struct Header {
    pub columns: u64,
    pub rows: u64,
    /// As stored, for row vectors: the last row is the translation.
    pub matrix: [[f64; 4]; 4],
    pub channels: Channels,
    /// Commas are decimal signs.
    pub decimal_comma: bool,
    /// Where the points start.
    pub offset: u64,
    /// The line before the first point.
    pub line: u64,
}

impl Header {
    /// Whether the points lie on a grid: a list of points is written as a single row or column.
    pub fn structured(&self) -> bool {
        self.columns > 1 && self.rows > 1
    }
}

fn header_line<R: Read>(
    lines: &mut Lines<R>,
    reader: &mut RowReader,
    values: &mut [f64],
    what: &str,
) -> Result<()> {
    let at = lines.number() + 1;
    let Some(line) = lines.next_line()? else {
        fail!(line at, "the file ends where {what} should be");
    };
    let wanted = values.len();
    reader.decimal_comma |= has_decimal_commas(line) == Some(true);
    match reader.numbers(line, values) {
        Ok(count) if count == wanted => Ok(()),
        _ => Err(FormatError::line(
            at,
            format!("'{}' is not {what}", excerpt(line)),
        )),
    }
}

fn count_line<R: Read>(lines: &mut Lines<R>, what: &str) -> Result<u64> {
    let mut value = [0.0];
    header_line(lines, &mut RowReader::default(), &mut value, what)?;
    if value[0] >= 0.0 && value[0].fract() == 0.0 && value[0] < 1e15 {
        Ok(value[0] as u64)
    } else {
        Err(FormatError::line(
            lines.number(),
            format!("{} is not {what}", value[0]),
        ))
    }
}

/// Finds every scan of a file. Points are passed over, not parsed.
pub fn index<R: Read>(source: R, file_size: u64) -> Result<Vec<Header>> {
    let mut lines = Lines::new(source);
    let mut scans = Vec::new();
    while !lines.only_blank_left()? {
        check_no_rows_left(&mut lines, &scans)?;
        let columns = count_line(&mut lines, "a number of columns")?;
        let rows = count_line(&mut lines, "a number of rows")?;
        let mut reader = RowReader::default();
        header_line(&mut lines, &mut reader, &mut [0.0; 3], "a scanner position")?;
        for _ in 0..3 {
            header_line(&mut lines, &mut reader, &mut [0.0; 3], "a scanner axis")?;
        }
        let mut matrix = [[0.0; 4]; 4];
        for row in &mut matrix {
            header_line(&mut lines, &mut reader, row, "a row of the 4x4 matrix")?;
        }
        let mut header = Header {
            columns,
            rows,
            matrix,
            channels: Channels::default(),
            decimal_comma: reader.decimal_comma,
            offset: lines.offset(),
            line: lines.number(),
        };
        let cells = columns.checked_mul(rows);
        let room = file_size.saturating_sub(header.offset) + 1;
        let Some(cells) = cells.filter(|cells| *cells <= room / LEAST_LINE) else {
            fail!(line header.line,
                "the header says {columns} columns of {rows} points, more than fit into the {} bytes that follow",
                room - 1
            );
        };
        let sampled = cells.min(SAMPLE);
        for _ in 0..sampled {
            let Some(line) = lines.next_line()? else {
                break;
            };
            header.decimal_comma |= has_decimal_commas(line) == Some(true);
            reader.decimal_comma = header.decimal_comma;
            let count = reader.count(line).unwrap_or(0);
            header.channels.intensity |= count == 4 || count >= 7;
            header.channels.color |= count >= 6;
        }
        header.channels.grid = header.structured();
        lines.skip(cells - sampled)?;
        if lines.number() - header.line < cells {
            fail!(line lines.number(),
                "the file ends after {} of {cells} points of scan {}", lines.number() - header.line, scans.len() + 1
            );
        }
        scans.push(header);
    }
    Ok(scans)
}

/// Refuses a file whose header promises fewer points than follow it.
fn check_no_rows_left<R: Read>(lines: &mut Lines<R>, scans: &[Header]) -> Result<()> {
    let Some(scan) = scans.last() else {
        return Ok(());
    };
    let at = lines.number() + 1;
    let mut reader = RowReader::new(scan.decimal_comma);
    if let Some(line) = lines.peek_line()?
        && reader.count(line).is_some_and(|count| count >= 3)
    {
        fail!(line at,
            "there are more points than the {} columns of {} that the header of scan {} says",
            scan.columns, scan.rows, scans.len()
        );
    }
    Ok(())
}

/// Reads the points of one scan; `source` stands at `header.offset`.
pub fn read<R: Read>(source: R, header: &Header, metres_per_unit: f64) -> Result<Cloud> {
    let mut lines = Lines::at(source, header.offset, header.line);
    let cells = header.columns * header.rows;
    let mut cloud = Cloud::new(header.channels, metres_per_unit, cells as usize);
    let mut reader = RowReader::new(header.decimal_comma);
    for cell in 0..cells {
        let (at, line) = lines.point_line(cell, cells)?;
        let mut values = [0.0; 7];
        let count = match reader.numbers(line, &mut values) {
            Ok(count) if count >= 3 => count,
            _ => return Err(not_a_point(at, line)),
        };
        let color_at = if count == 6 { 3 } else { 4 };
        cloud.push(&Point {
            xyz: [values[0], values[1], values[2]],
            intensity: if count == 6 { 0.0 } else { values[3] },
            color: [0, 1, 2]
                .map(|component| values.get(color_at + component).map_or(0, |v| *v as u16)),
            cell: [(cell % header.rows) as i32, (cell / header.rows) as i32],
        });
    }
    cloud.open_end = lines.open();
    Ok(cloud.finished())
}

impl<R: Read> Lines<R> {
    /// Whether nothing but white space follows; blank lines are consumed.
    fn only_blank_left(&mut self) -> Result<bool> {
        loop {
            let Some(line) = self.peek_line()? else {
                return Ok(true);
            };
            if !is_blank(line) {
                return Ok(false);
            }
            self.next_line()?;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TWO: &str = "2\n3\n1 2 3\n1 0 0\n0 1 0\n0 0 1\n1 0 0 0\n0 1 0 0\n0 0 1 0\n1 2 3 1\n\
        1 1 1 0.5\n0 0 0 0.5\n3 3 3 0.25\n4 4 4 1\n5 5 5 0\n6 6 6 0\n\
        1\n2\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n\
        0 0 0 0\n7 8 9 0.1 255 0 3\n\n";

    #[test]
    fn scans_of_one_file_column_by_column() {
        let scans = index(TWO.as_bytes(), TWO.len() as u64).unwrap();
        assert_eq!(scans.len(), 2);
        assert_eq!(scans[0].matrix[3], [1.0, 2.0, 3.0, 1.0]);
        let cloud = read(&TWO.as_bytes()[scans[0].offset as usize..], &scans[0], 1.0).unwrap();
        assert_eq!(cloud.no_return, 1);
        assert_eq!(cloud.row, vec![0, 2, 0, 1, 2]);
        assert_eq!(cloud.column, vec![0, 0, 1, 1, 1]);
        assert_eq!(cloud.intensity, vec![0.5, 0.25, 1.0, 0.0, 0.0]);
        assert!(!scans[1].structured() && scans[1].channels.color);
        let cloud = read(&TWO.as_bytes()[scans[1].offset as usize..], &scans[1], 1.0).unwrap();
        assert_eq!(
            (cloud.xyz, cloud.color),
            (vec![7.0, 8.0, 9.0], vec![255, 0, 3])
        );
    }

    #[test]
    fn decimal_commas() {
        let text = TWO
            .replace("0.25", "0.250")
            .replace('.', ",")
            .replace("\n1 2 3\n", "\n1,5 2,5 3,5\n");
        let scans = index(text.as_bytes(), text.len() as u64).unwrap();
        let cloud = read(&text.as_bytes()[scans[0].offset as usize..], &scans[0], 1.0).unwrap();
        assert_eq!(cloud.intensity, vec![0.5, 0.25, 1.0, 0.0, 0.0]);
    }

    #[test]
    fn more_points_than_the_header_says() {
        let text = TWO.replacen("2\n3\n", "2\n2\n", 1);
        let error = index(text.as_bytes(), text.len() as u64).unwrap_err();
        assert!(
            error.reason.contains("more points than"),
            "{}",
            error.reason
        );
        assert_eq!(error.place.to_string(), "line 15");
    }

    #[test]
    fn headers_that_promise_too_much() {
        let huge = TWO.replacen("2\n3\n", "900000000\n900000000\n", 1);
        let error = index(huge.as_bytes(), huge.len() as u64).unwrap_err();
        assert!(error.reason.contains("900000000"), "{}", error.reason);
        let cut = &TWO[..TWO.len() - 40];
        assert!(index(cut.as_bytes(), cut.len() as u64).is_err());
    }
}
