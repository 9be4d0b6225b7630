//! PTS, Leica's plain text format: a count line, then so many points; a file may hold several such blocks.
//!
//! A point is x y z, with an intensity, with a colour, or with both: 3, 4, 6 or 7 numbers.

use std::io::Read;

use super::cloud::{Channels, Cloud, Point};
use super::error::{Result, fail};
use super::text::{Lines, excerpt, is_blank, is_comment, numbers};

/// "0 0 0" and a line end: no point takes less.
const LEAST_LINE: u64 = 6;

#[derive(Clone, Debug, PartialEq)]
pub struct Header {
    /// As the count line says.
    pub declared: u64,
    /// Rows there are: some writers count one too few.
    pub points: u64,
    pub channels: Channels,
    /// Numbers in a row.
    pub values: usize,
    /// Where the points start.
    pub offset: u64,
    /// The line before the first point.
    pub line: u64,
}

/// Finds every block of a file. Points are passed over, not parsed.
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
        let mut value = [0.0];
        let counted = numbers(line, &mut value) == Ok(1)
            && value[0] >= 0.0
            && value[0].fract() == 0.0
            && value[0] < 1e15;
        if !counted {
            fail!(line at, "'{}' stands where the number of points should be", excerpt(line));
        }
        let points = value[0] as u64;
        let mut header = Header {
            declared: points,
            points,
            channels: Channels::default(),
            values: 3,
            offset: lines.offset(),
            line: lines.number(),
        };
        let room = file_size.saturating_sub(header.offset) + 1;
        if points > room / LEAST_LINE {
            fail!(line at, "{points} points do not fit into the {} bytes that follow", room - 1);
        }
        if let Some(line) = lines.peek_line()? {
            header.values = numbers(line, &mut []).unwrap_or(0);
            header.channels.intensity = header.values == 4 || header.values == 7;
            header.channels.color = header.values == 6 || header.values == 7;
            if points > 0 && !matches!(header.values, 3 | 4 | 6 | 7) {
                fail!(line at + 1, "'{}' is not a point of 3, 4, 6 or 7 numbers", excerpt(line));
            }
        }
        let skipped = lines.skip(points)?;
        if skipped < points {
            fail!(line lines.number(), "the file ends after {skipped} of {points} points");
        }
        while lines
            .peek_line()?
            .is_some_and(|line| numbers(line, &mut []).is_ok_and(|count| count >= 3))
        {
            lines.next_line()?;
            header.points += 1;
        }
        blocks.push(header);
    }
}

/// Reads the points of one block; `source` stands at `header.offset`.
pub fn read<R: Read>(source: R, header: &Header, metres_per_unit: f64) -> Result<Cloud> {
    let mut lines = Lines::at(source, header.offset, header.line);
    let mut cloud = Cloud::new(header.channels, metres_per_unit, header.points as usize);
    let color_at = if header.values == 6 { 3 } else { 4 };
    for done in 0..header.points {
        let (at, line) = lines.point_line(done, header.points)?;
        let mut values = [0.0; 7];
        if numbers(line, &mut values) != Ok(header.values) {
            fail!(line at, "'{}' is not a point of {} numbers", excerpt(line), header.values);
        }
        cloud.push(&Point {
            xyz: [values[0], values[1], values[2]],
            intensity: values[3],
            color: [0, 1, 2]
                .map(|component| values.get(color_at + component).map_or(0, |v| *v as u16)),
            cell: [0; 2],
        });
    }
    Ok(cloud)
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
