//! PTS, Leica's plain text format: a count line, then so many points; a file may hold several such blocks.
//!
//! A point is x y z, with an intensity, with a colour, with both, and with a normal behind them. What the numbers are
//! is told from rows all over the block.

use std::io::Read;

use super::cloud::{Channels, Cloud};
use super::columns::guess;
use super::error::{FormatError, Result, fail};
use super::record::Layout;
use super::row::{RowReader, has_decimal_commas};
use super::text::{Lines, excerpt, is_blank, is_comment};
use super::xyz::{MOST_COLUMNS, is_stray};

/// "0 0 0" and a line end: no point takes less.
const LEAST_LINE: u64 = 6;
/// So many rows of a block, evenly spaced, tell what the columns are.
const SAMPLE: u64 = 2000;

#[derive(Clone, Debug, PartialEq)]
pub struct Header {
    /// As the count line says.
    pub declared: u64,
    /// Rows there are: some writers count one too few.
    pub points: u64,
    pub channels: Channels,
    /// Numbers in a row.
    pub values: usize,
    pub layout: Layout,
    /// Commas are decimal signs.
    pub decimal_comma: bool,
    /// The first row is of another width than the rest, and is left out.
    pub stray: bool,
    /// Where the points start.
    pub offset: u64,
    /// The line before the first point.
    pub line: u64,
}

/// Finds every block of a file. Of most points only the lines are counted.
pub fn index<R: Read>(source: R, file_size: u64) -> Result<Vec<Header>> {
    let mut lines = Lines::new(source);
    let mut blocks = Vec::new();
    loop {
        let at = lines.number() + 1;
        let Some(line) = lines.next_line()? else {
            return Ok(blocks);
        };
        if is_blank(line) || is_comment(line) {
            continue;
        }
        let Some(declared) = count_of(line) else {
            fail!(line at, "'{}' stands where the number of points should be", excerpt(line));
        };
        let (offset, line) = (lines.offset(), lines.number());
        let room = file_size.saturating_sub(offset) + 1;
        if declared > room / LEAST_LINE {
            fail!(line at, "{declared} points do not fit into the {} bytes that follow", room - 1);
        }
        let sampled = sample(&mut lines, declared)?;
        let mut reader = RowReader::new(sampled.decimal_comma);
        let mut points = declared;
        while lines
            .peek_line()?
            .is_some_and(|line| reader.count(line).is_some_and(|count| count >= 3))
        {
            lines.next_line()?;
            points += 1;
        }
        let layout = guess(&sampled.rows, sampled.values);
        blocks.push(Header {
            declared,
            points,
            channels: layout.channels(false),
            values: sampled.values,
            layout,
            decimal_comma: sampled.decimal_comma,
            stray: sampled.stray,
            offset,
            line,
        });
    }
}

/// The number of points, if a line holds nothing else.
fn count_of(line: &[u8]) -> Option<u64> {
    let mut value = [0.0];
    let counted = RowReader::default().numbers(line, &mut value) == Ok(1)
        && value[0] >= 0.0
        && value[0].fract() == 0.0
        && value[0] < 1e15;
    counted.then_some(value[0] as u64)
}

struct Sampled {
    rows: Vec<Vec<f64>>,
    values: usize,
    decimal_comma: bool,
    stray: bool,
}

/// Passes over the rows of a block and takes some of them.
fn sample<R: Read>(lines: &mut Lines<R>, points: u64) -> Result<Sampled> {
    let step = points.div_ceil(SAMPLE).max(1);
    let mut rows: Vec<Vec<f64>> = Vec::new();
    let mut values = vec![0.0; MOST_COLUMNS];
    let mut reader = RowReader::default();
    for done in 0..points {
        let at = lines.number() + 1;
        let Some(line) = lines.next_line()? else {
            fail!(line at - 1, "the file ends after {done} of {points} points");
        };
        if done % step != 0 && done != 1 {
            continue;
        }
        if !reader.decimal_comma && has_decimal_commas(line) == Some(true) {
            reader.decimal_comma = true;
            // Those before were whole numbers, or read as more numbers than they were.
            rows.retain(|row| row.iter().all(|value| value.fract() == 0.0));
        }
        match reader.numbers(line, &mut values) {
            Ok(count) if count >= 3 => rows.push(values[..count.min(MOST_COLUMNS)].to_vec()),
            _ => fail!(line at, "'{}' is not a point of three numbers or more", excerpt(line)),
        }
    }
    let stray = is_stray(&rows);
    if stray {
        rows.remove(0);
    }
    let values = rows.first().map_or(3, Vec::len);
    rows.retain(|row| row.len() == values);
    Ok(Sampled {
        rows,
        values,
        decimal_comma: reader.decimal_comma,
        stray,
    })
}

/// Reads the points of one block; `source` stands at `header.offset`.
pub fn read<R: Read>(source: R, header: &Header, metres_per_unit: f64) -> Result<Cloud> {
    let mut lines = Lines::at(source, header.offset, header.line);
    let mut cloud = Cloud::new(header.channels, metres_per_unit, header.points as usize);
    let mut reader = RowReader::new(header.decimal_comma);
    let mut values = vec![0.0; header.values];
    for done in 0..header.points {
        let (at, line) = lines.point_line(done, header.points)?;
        if done == 0 && header.stray {
            continue;
        }
        if reader.numbers(line, &mut values) != Ok(header.values) {
            fail!(line at, "'{}' is not a point of {} numbers", excerpt(line), header.values);
        }
        let point = header.layout.point_of_words(&values);
        cloud.push(&point.ok_or_else(|| FormatError::line(at, "the row is too short"))?);
    }
    cloud.open_end = lines.open();
    Ok(cloud.finished())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blocks_with_their_own_columns() {
        let text = "2\r\n1 2 3 -2048\r\n4 5 6 2047\r\n1\n7 8 9 10 20 30\n";
        let blocks = index(text.as_bytes(), text.len() as u64).unwrap();
        let clouds: Vec<Cloud> = blocks
            .iter()
            .map(|block| read(&text.as_bytes()[block.offset as usize..], block, 1.0).unwrap())
            .collect();
        assert_eq!(clouds[0].intensity, vec![-2048.0, 2047.0]);
        assert_eq!(clouds[1].xyz, vec![7.0, 8.0, 9.0]);
        assert_eq!(clouds[1].color, vec![10, 20, 30]);
    }

    #[test]
    fn normals_decimal_commas_and_a_stray_record() {
        let text = "3\n0 0 0\n1,5 2 3,25 -700 10 20 30 0,0 0,6 -0,8\n4 5 6 9 40 50 60 0,0 1 0\n";
        let [block] = index(text.as_bytes(), text.len() as u64)
            .unwrap()
            .try_into()
            .unwrap();
        let cloud = read(&text.as_bytes()[block.offset as usize..], &block, 1.0).unwrap();
        assert_eq!(cloud.xyz, vec![1.5, 2.0, 3.25, 4.0, 5.0, 6.0]);
        assert_eq!(cloud.intensity, vec![-700.0, 9.0]);
        assert_eq!(cloud.color, vec![10, 20, 30, 40, 50, 60]);
        assert!(block.stray && block.values == 10);
    }

    #[test]
    fn rows_beyond_the_count_are_kept() {
        let text = "1\n1 2 3\n4 5 6\n1\n7 8 9\n";
        let blocks = index(text.as_bytes(), text.len() as u64).unwrap();
        let counts: Vec<_> = blocks.iter().map(|b| (b.declared, b.points)).collect();
        assert_eq!(counts, vec![(1, 2), (1, 1)]);
    }

    #[test]
    fn wrong_counts_are_found() {
        for text in [
            "3\n1 2 3\n4 5 6\n",
            "1\n1 2 3\n4 5\n",
            "99999999999\n1 2 3\n",
            "2\n1 2 3\n5\n1 2 3\n",
        ] {
            let found = index(text.as_bytes(), text.len() as u64).and_then(|blocks| {
                read(
                    &text.as_bytes()[blocks[0].offset as usize..],
                    &blocks[0],
                    1.0,
                )
            });
            assert!(found.is_err(), "{text:?}");
        }
    }
}
