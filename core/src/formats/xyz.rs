//! Rows of numbers with nothing agreed: heading, separator, decimal sign and columns are told from the file's first
//! lines and from rows all over it.

use std::io::{Read, Seek, SeekFrom};

use super::cloud::{Channels, Cloud};
use super::columns::{guess, named};
use super::error::{FormatError, Result, fail};
use super::first_lines::{LONGEST_HEADING, heading, take, without_mark};
use super::heading::names_of;
use super::record::{Layout, Scalar};
use super::row::{RowReader, decimal_commas};
use super::text::{Lines, is_blank, is_comment, not_a_point};

/// So many rows at the start, and so many at each of so many places of the rest, tell what the columns are.
const FIRST_ROWS: usize = 1000;
const ROWS_A_PLACE: usize = 50;
const PLACES: u64 = 40;
/// Columns beyond this are not looked at.
pub(super) const MOST_COLUMNS: usize = 1024;
/// Share of rows that are shorter than the others from which they are no damage.
const OFTEN: f64 = 0.02;

/// What a file says of its columns.
#[derive(Clone, Debug, PartialEq)]
pub struct Table {
    /// The columns' names, if a heading gives them; those of the first columns where it has fewer.
    pub names: Vec<String>,
    /// Numbers in a row.
    pub columns: usize,
    pub layout: Layout,
    pub channels: Channels,
    /// Commas are decimal signs, not separators.
    pub decimal_comma: bool,
    /// Points, by a line that holds nothing but their number.
    pub declared: Option<u64>,
    /// Line of a first row that is left out, as it is of another width than the rest.
    pub stray: Option<u64>,
    /// Where the rows start, comments before them included.
    pub offset: u64,
    /// The line before.
    pub line: u64,
}

/// Reads rows of all parts of the file and tells the columns; `size` is that of the file.
pub fn sniff<R: Read + Seek>(mut source: R, size: u64) -> Result<Table> {
    let mut lines = Lines::new(&mut source);
    let first = take(&mut lines, LONGEST_HEADING + FIRST_ROWS)?;
    let read = lines.offset();
    let mut rest = Vec::new();
    for place in 0..PLACES {
        let at = read + (size.saturating_sub(read)) / PLACES * place;
        if at >= size {
            break;
        }
        source.seek(SeekFrom::Start(at))?;
        let mut lines = Lines::at(&mut source, at, 1);
        lines.next_line()?;
        rest.extend(take(&mut lines, ROWS_A_PLACE)?.lines);
    }
    let all = || first.lines.iter().chain(&rest).map(Vec::as_slice);
    let mut reader = RowReader::new(decimal_commas(all()));
    let Some(mut heading) = heading(&first.lines, &mut reader) else {
        match first
            .lines
            .iter()
            .enumerate()
            .find(|(_, line)| !is_comment(line))
        {
            Some((at, line)) => return Err(not_a_point(first.begins[at].1 + 1, line)),
            None => fail!(whole, "it holds no points"),
        }
    };
    let mut sample = sample(
        first.lines[heading.first..].iter().chain(&rest),
        &mut reader,
    );
    let mut stray = None;
    if is_stray(&sample) {
        stray = Some(first.begins[heading.first].1 + 1);
        sample.remove(0);
        heading.first += 1;
        while first
            .lines
            .get(heading.first)
            .is_some_and(|line| is_comment(line))
        {
            heading.first += 1;
        }
    }
    let columns = width(&sample);
    sample.retain(|row| row.len() >= columns);
    let names = names_of(&heading.lines, columns)?;
    let two_signs = !reader.decimal_comma && 2 * names.len() == columns;
    if two_signs && sample.iter().flatten().all(|value| value.fract() == 0.0) {
        fail!(
            whole,
            "its heading names {} columns and its rows hold {columns} whole numbers: commas seem to be decimal signs \
             and separators at once",
            names.len()
        );
    }
    let layout = match names.as_slice() {
        [] => guess(&sample, columns),
        names => named(names, &sample),
    };
    let (offset, line) = first
        .begins
        .get(heading.first)
        .copied()
        .unwrap_or((read, 0));
    Ok(Table {
        channels: layout.channels(false),
        names,
        columns,
        layout,
        decimal_comma: reader.decimal_comma,
        declared: heading.declared,
        stray,
        offset,
        line,
    })
}

/// Whether the first of several rows is an odd record: no other is as wide.
pub(super) fn is_stray(sample: &[Vec<f64>]) -> bool {
    match sample {
        [one, others @ ..] => others.len() > 1 && others.iter().all(|row| row.len() != one.len()),
        [] => false,
    }
}

/// Numbers in a row: in the most of them, or in the shortest where many are shorter.
pub(super) fn width(sample: &[Vec<f64>]) -> usize {
    let count = |width: usize| sample.iter().filter(|row| row.len() == width).count();
    let widths = || sample.iter().map(Vec::len);
    // Of widths that are as common as each other the first.
    let common = widths()
        .rev()
        .max_by_key(|width| count(*width))
        .unwrap_or(0);
    let shorter = widths().filter(|width| *width < common).count();
    if (shorter as f64) < OFTEN * sample.len() as f64 {
        common
    } else {
        widths().min().unwrap_or(0)
    }
}

/// The numbers of those lines that are rows.
fn sample<'a>(lines: impl Iterator<Item = &'a Vec<u8>>, reader: &mut RowReader) -> Vec<Vec<f64>> {
    let mut values = vec![0.0; MOST_COLUMNS];
    lines
        .filter(|line| !is_comment(line))
        .filter_map(|line| {
            let count = reader.numbers(line, &mut values).ok()?;
            (count >= 3).then(|| values[..count.min(MOST_COLUMNS)].to_vec())
        })
        .collect()
}

/// Reads every point.
pub fn read<R: Read + Seek>(mut source: R, table: &Table, metres_per_unit: f64) -> Result<Cloud> {
    match read_as(&mut source, table, &table.layout, metres_per_unit)? {
        Some(cloud) => Ok(cloud),
        // The sample held no colour above one.
        None => {
            let whole = table.layout.with_colors(Scalar::U16);
            let cloud = read_as(&mut source, table, &whole, metres_per_unit)?;
            cloud.ok_or_else(|| FormatError::whole("its colours are fractions and whole numbers"))
        }
    }
}

/// Reads every point by a layout; None where colours are no fractions though the layout says so.
fn read_as<R: Read + Seek>(
    source: &mut R,
    table: &Table,
    layout: &Layout,
    metres_per_unit: f64,
) -> Result<Option<Cloud>> {
    source.seek(SeekFrom::Start(table.offset))?;
    let mut lines = Lines::at(source, table.offset, table.line);
    let mut cloud = Cloud::new(table.channels, metres_per_unit, 0);
    let mut values = vec![0.0; table.columns];
    let mut reader = RowReader::new(table.decimal_comma);
    let fractions = layout.fractions();
    loop {
        let at = lines.number() + 1;
        let Some(line) = lines.next_line()? else {
            let read = cloud.records();
            if let Some(declared) = table.declared.filter(|declared| *declared > read) {
                fail!(line at, "the file ends after {read} of {declared} points");
            }
            cloud.open_end = lines.open();
            return Ok(Some(cloud.finished()));
        };
        let line = without_mark(line, at - 1);
        match reader.numbers(line, &mut values) {
            Ok(count) if count >= table.columns => {
                if fractions.iter().any(|&column| values[column] > 1.0) {
                    return Ok(None);
                }
                let point = layout
                    .point_of_words(&values)
                    .ok_or_else(|| FormatError::line(at, "the row is too short"))?;
                cloud.push(&point);
            }
            _ if is_blank(line) || is_comment(line) => {}
            Ok(count) => {
                fail!(line at, "there are {count} numbers, the rows before have {}", table.columns)
            }
            Err(_) => return Err(not_a_point(at, line)),
        }
    }
}

#[cfg(test)]
mod tests {
    use std::io::Cursor;

    use super::*;

    fn table(text: &str) -> Table {
        sniff(Cursor::new(text), text.len() as u64).unwrap()
    }

    fn all(text: &str) -> (Table, Cloud) {
        let table = table(text);
        let cloud = read(Cursor::new(text), &table, 1.0).unwrap();
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
    fn a_heading_of_several_lines_and_a_count() {
        let text = "Project: site 7\nDate: 2021-03-04\n//X Y Z R G B Intensity\n2\n1 2 3 4 5 6 0.5\n7 8 9 1 2 3 0.25\n";
        let (table, cloud) = all(text);
        assert_eq!((table.declared, cloud.len()), (Some(2), 2));
        assert_eq!(
            (cloud.color, cloud.intensity),
            (vec![4, 5, 6, 1, 2, 3], vec![0.5, 0.25])
        );
        let cut = &text[..text.len() - 17];
        assert!(read(Cursor::new(cut), &table, 1.0).is_err());
    }

    #[test]
    fn decimal_commas() {
        for text in [
            "1,5;2,25;-3,0\n4,0;5,0;6,0\n",
            "1,5 2,25 -3,0\n4,0 5,0 6,0\n",
            "X\tY\tZ\n1,5\t2,25\t-3\n4\t5\t6\n",
            "\"X\",\"Y\",\"Z\"\n\"1,5\",\"2,25\",\"-3\"\n\"4\",\"5\",\"6\"\n",
        ] {
            assert_eq!(all(text).1.xyz, vec![1.5, 2.25, -3.0, 4.0, 5.0, 6.0]);
        }
        assert_eq!(all("1,2,3\n").1.xyz, vec![1.0, 2.0, 3.0]);
        let text = "X,Y,Z\n1,25,2,50,3,75\n";
        let error = sniff(Cursor::new(text), text.len() as u64).unwrap_err();
        assert!(
            error.reason.contains("decimal signs and separators"),
            "{}",
            error.reason
        );
    }

    #[test]
    fn columns_without_names() {
        let (_, cloud) = all("# a survey\n1 2 3 -700 40 50 60\n");
        assert_eq!(
            (cloud.intensity, cloud.color),
            (vec![-700.0], vec![40, 50, 60])
        );
        let (_, cloud) = all("//X Y Z R G B\n1 2 3 0.5 1.0 0\n");
        assert_eq!(cloud.color, vec![128, 255, 0]);
    }

    #[test]
    fn rows_all_over_the_file_tell_the_columns() {
        // Columns 4 to 6 look like a colour for a long while.
        let text = "1 2 3 40 50 60\n".repeat(20_000) + &"1 2 3 0.6 0.8 0.0\n".repeat(20_000);
        assert!(!table(&text).channels.color);
        // Black for a long while, then no fractions.
        let text = "x y z r g b\n".to_string() + &"1 2 3 0 0 1\n".repeat(5000) + "1 2 3 0 0 200\n";
        assert_eq!(all(&text).1.color[3 * 5000..], [0, 0, 200]);
    }

    #[test]
    fn a_stray_first_record_costs_nothing_else() {
        for first in ["0 0 0", "0 0 0 0 0 0 0 0 0", "0,0,0"] {
            let (table, cloud) = all(&(format!("{first}\n") + &"1 2 3 40 50 60\n".repeat(9)));
            assert_eq!((table.stray, cloud.len()), (Some(1), 9));
            assert_eq!(cloud.color[..3], [40, 50, 60]);
        }
    }

    #[test]
    fn a_row_that_is_none_is_named_by_its_line() {
        let text = "1 2 3\n4 5 6\n7 8\n";
        let error = read(Cursor::new(text), &table("1 2 3\n4 5 6\n"), 1.0).unwrap_err();
        assert_eq!(error.place.to_string(), "line 3");
        assert!(sniff(Cursor::new("hello\nthere\n"), 12).is_err());
    }
}
