//! The first lines of a text file: what stands before its rows, and which format it has.

use std::io::Read;

use super::error::Result;
use super::heading::names_axes;
use super::row::{RowReader, decimal_commas};
use super::text::{Lines, is_blank, is_comment};

/// Lines before the first row that are no comments, at the most.
pub(super) const LONGEST_HEADING: usize = 100;

/// Lines of a file and where each begins: its byte and the number of the line before.
pub(super) struct Taken {
    pub lines: Vec<Vec<u8>>,
    pub begins: Vec<(u64, u64)>,
}

/// Takes lines that hold something until so many of them are left.
pub(super) fn take<R: Read>(lines: &mut Lines<R>, most: usize) -> Result<Taken> {
    let mut taken = Taken {
        lines: Vec::new(),
        begins: Vec::new(),
    };
    while taken.lines.len() < most {
        let before = (lines.offset(), lines.number());
        let Some(line) = lines.next_line()? else {
            break;
        };
        let line = without_mark(line, before.1);
        if !is_blank(line) {
            taken.lines.push(line.to_vec());
            taken.begins.push(before);
        }
    }
    Ok(taken)
}

/// A first line without the mark that says that a file is UTF-8.
pub(super) fn without_mark(line: &[u8], lines_before: u64) -> &[u8] {
    match lines_before {
        0 => line.strip_prefix(b"\xef\xbb\xbf").unwrap_or(line),
        _ => line,
    }
}

/// Where the rows of a file begin among its first lines, and what stands before.
pub(super) struct Heading {
    /// Of the first row among the lines.
    pub first: usize,
    pub lines: Vec<Vec<u8>>,
    /// Points, by a number alone on the line before the first row.
    pub declared: Option<u64>,
}

/// Finds the first row of at least three numbers; None where the lines before are too many, or there is no row.
pub(super) fn heading(lines: &[Vec<u8>], reader: &mut RowReader) -> Option<Heading> {
    let mut declared = None;
    let rows = lines
        .iter()
        .enumerate()
        .filter(|(_, line)| !is_comment(line));
    for (at, line) in rows.take(LONGEST_HEADING) {
        let mut count = [0.0];
        let numbers = reader.numbers(line, &mut count);
        if numbers.is_ok_and(|numbers| numbers >= 3) {
            return Some(Heading {
                first: at,
                lines: lines[..at].to_vec(),
                declared,
            });
        }
        let counts = numbers == Ok(1) && count[0] >= 0.0 && count[0].fract() == 0.0;
        declared = counts.then_some(count[0] as u64);
    }
    None
}

/// A text format, by the first lines of a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TextKind {
    Ptx,
    Pts,
    Xyz,
}

/// Tells which format rows of numbers have; `head` is the start of a file, or all of it.
pub fn text_kind(head: &[u8]) -> Option<TextKind> {
    let lines = take(&mut Lines::new(head), usize::MAX).ok()?.lines;
    let mut reader = RowReader::new(decimal_commas(lines.iter().map(Vec::as_slice)));
    let rows = || lines.iter().filter(|line| !is_comment(line));
    let widths: Vec<Option<usize>> = rows().take(10).map(|line| reader.count(line)).collect();
    if widths == [1, 1, 3, 3, 3, 3, 4, 4, 4, 4].map(Some) {
        return Some(TextKind::Ptx);
    }
    let found = heading(&lines, &mut reader)?;
    let rows = lines[found.first..].iter().filter(|line| !is_comment(line));
    // Words after one row of numbers; behind a number of points one row will do.
    let few = if found.declared.is_some() { 1 } else { 3 };
    if !rows
        .take(few)
        .all(|line| reader.count(line).is_some_and(|count| count >= 2))
    {
        return None;
    }
    let counted = found.lines.iter().filter(|line| !is_comment(line)).count() == 1;
    let named = found.lines.iter().any(|line| names_axes(line));
    match found.declared {
        Some(_) if counted && !named => Some(TextKind::Pts),
        _ => Some(TextKind::Xyz),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn formats_by_their_first_lines() {
        let ptx =
            "2\n3\n1 2 3\n1 0 0\n0 1 0\n0 0 1\n1 0 0 0\n0 1 0 0\n0 0 1 0\n1 2 3 1\n1 1 1 0.5\n";
        assert_eq!(text_kind(ptx.as_bytes()), Some(TextKind::Ptx));
        let commas = ptx.replace(" 0 0\n", " 0,5 0\n").replace("0.5", "0,5");
        assert_eq!(text_kind(commas.as_bytes()), Some(TextKind::Ptx));
        for (text, kind) in [
            ("2\n1 2 3\n4 5 6\n", Some(TextKind::Pts)),
            ("# made by hand\n2\n1 2 3\n4 5 6\n", Some(TextKind::Pts)),
            ("//X Y Z\n2\n1 2 3\n4 5 6\n", Some(TextKind::Xyz)),
            ("1 2 3\n4 5 6\n", Some(TextKind::Xyz)),
            ("a\nb\nc\n1 2 3\n4 5 6\n", Some(TextKind::Xyz)),
            ("2\n1 2 3 4\n1\n4 5 6 x\n", Some(TextKind::Pts)),
            ("2021\nsite 7\n1 2 3\n4 5 6\n", Some(TextKind::Xyz)),
            ("hello\nthere\n", None),
            ("1 2 3\nmore\n", None),
        ] {
            assert_eq!(text_kind(text.as_bytes()), kind, "{text}");
        }
    }
}
