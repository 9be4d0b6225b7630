//! Lines and numbers of text files, without a copy a line.

use std::io::Read;

use super::error::{FormatError, Result, fail};

/// No sensible line of a point file is longer (bytes); binary junk is.
const LONGEST_LINE: usize = 1 << 16;
const BLOCK: usize = 1 << 20;

/// The lines of a stream, without their ends.
pub struct Lines<R> {
    source: R,
    buffer: Vec<u8>,
    start: usize,
    end: usize,
    exhausted: bool,
    number: u64,
    consumed: u64,
    open: bool,
}

impl<R: Read> Lines<R> {
    pub fn new(source: R) -> Self {
        Self::at(source, 0, 0)
    }

    /// Goes on in the middle of a file: `source` stands at byte `offset`, where line `number` ended.
    pub fn at(source: R, offset: u64, number: u64) -> Self {
        Self {
            source,
            buffer: vec![0; BLOCK],
            start: 0,
            end: 0,
            exhausted: false,
            number,
            consumed: offset,
            open: false,
        }
    }

    /// Whether the line that was read last has no end: the file may be cut short within it.
    pub fn open(&self) -> bool {
        self.open
    }

    /// The number of the line that was read last, from 1.
    pub fn number(&self) -> u64 {
        self.number
    }

    /// Where the next line starts, in bytes from the start of the file.
    pub fn offset(&self) -> u64 {
        self.consumed
    }

    /// What is left of the buffered block, and the stream behind it: for binary data after a text header.
    pub fn into_rest(self) -> std::io::Chain<std::io::Cursor<Vec<u8>>, R> {
        let rest = self.buffer[self.start..self.end].to_vec();
        std::io::Cursor::new(rest).chain(self.source)
    }

    fn refill(&mut self) -> Result<()> {
        self.buffer.copy_within(self.start..self.end, 0);
        self.end -= self.start;
        self.start = 0;
        match self.source.read(&mut self.buffer[self.end..]) {
            Ok(0) => self.exhausted = true,
            Ok(count) => self.end += count,
            Err(error) if error.kind() == std::io::ErrorKind::Interrupted => {}
            Err(error) => return Err(error.into()),
        }
        Ok(())
    }

    /// The next line, or None at the end of the stream.
    #[inline]
    pub fn next_line(&mut self) -> Result<Option<&[u8]>> {
        let mut searched = 0;
        loop {
            let pending = &self.buffer[self.start..self.end];
            let found = memchr::memchr(b'\n', &pending[searched..]).map(|at| searched + at);
            let (length, taken) = match found {
                Some(at) => (at, at + 1),
                None if self.exhausted && pending.is_empty() => return Ok(None),
                None if self.exhausted => (pending.len(), pending.len()),
                None => {
                    searched = pending.len();
                    if searched > LONGEST_LINE {
                        fail!(line self.number + 1, "the line does not end: this is not text");
                    }
                    self.refill()?;
                    continue;
                }
            };
            self.open = taken == length;
            let begin = self.start;
            self.start += taken;
            self.consumed += taken as u64;
            self.number += 1;
            return Ok(Some(&self.buffer[begin..begin + length]));
        }
    }

    /// The next line, which the next call of `next_line` returns again.
    pub fn peek_line(&mut self) -> Result<Option<&[u8]>> {
        let (number, consumed) = (self.number, self.consumed);
        let Some(length) = self.next_line()?.map(<[u8]>::len) else {
            return Ok(None);
        };
        self.start -= (self.consumed - consumed) as usize;
        (self.number, self.consumed) = (number, consumed);
        Ok(Some(&self.buffer[self.start..self.start + length]))
    }

    /// The line of the next point and its number; `done` of `points` came before.
    #[inline]
    pub fn point_line(&mut self, done: u64, points: u64) -> Result<(u64, &[u8])> {
        let at = self.number + 1;
        match self.next_line()? {
            Some(line) => Ok((at, line)),
            None => Err(FormatError::line(
                at,
                format!("the file ends after {done} of {points} points"),
            )),
        }
    }

    /// How many lines that hold something are left.
    pub fn rows_left(&mut self) -> Result<u64> {
        let mut rows = 0;
        while let Some(line) = self.next_line()? {
            rows += u64::from(!is_blank(line));
        }
        Ok(rows)
    }

    /// Passes over `count` lines; how many there were.
    pub fn skip(&mut self, count: u64) -> Result<u64> {
        for skipped in 0..count {
            if self.next_line()?.is_none() {
                return Ok(skipped);
            }
        }
        Ok(count)
    }
}

/// Whether a line is a remark, in one of the usual ways to begin one.
pub fn is_comment(line: &[u8]) -> bool {
    let text = line.trim_ascii_start();
    text.starts_with(b"#")
        || text.starts_with(b"//")
        || text.starts_with(b"%")
        || text.starts_with(b"!")
        // An empty first field is none.
        || text.starts_with(b";") && !text.iter().any(u8::is_ascii_digit)
        || text.starts_with(b"; ")
}

/// Whether a byte stands between two numbers.
#[inline]
pub fn is_separator(byte: u8) -> bool {
    matches!(byte, b' ' | b'\t' | b',' | b';' | b'\r')
}

/// Whether a line holds no value.
#[inline]
pub fn is_blank(line: &[u8]) -> bool {
    line.iter().all(|byte| is_separator(*byte))
}

/// The error of a line that holds something else than a point.
pub fn not_a_point(number: u64, line: &[u8]) -> FormatError {
    FormatError::line(number, format!("'{}' is not a point", excerpt(line)))
}

/// A word that is no number to the fast parser: the spellings that C libraries write for "not a number".
fn odd_number(word: &[u8]) -> Option<f64> {
    let lower = word.to_ascii_lowercase();
    let text = std::str::from_utf8(&lower).ok()?;
    let bare = text.trim_start_matches(['-', '+']);
    (bare.starts_with("nan") || bare.starts_with("1.#") || bare == "null").then_some(f64::NAN)
}

/// Powers of ten that a float64 holds exactly.
const TENS: [f64; 16] = [
    1e0, 1e1, 1e2, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8, 1e9, 1e10, 1e11, 1e12, 1e13, 1e14, 1e15,
];

/// A plain decimal number of at most 15 digits. The digits and the power of ten are exact as float64, so one division
/// rounds right (W. Clinger, How to read floating point numbers accurately, 1990); None for anything else.
#[inline]
fn plain_number(text: &[u8]) -> Option<(f64, usize)> {
    let negative = text.first() == Some(&b'-');
    let start = usize::from(negative);
    let mut at = start;
    let mut digits = 0u64;
    let mut point = None;
    while let Some(byte) = text.get(at) {
        let digit = byte.wrapping_sub(b'0');
        if digit < 10 {
            digits = digits.wrapping_mul(10).wrapping_add(u64::from(digit));
        } else if *byte == b'.' && point.is_none() {
            point = Some(at);
        } else if is_separator(*byte) {
            break;
        } else {
            return None;
        }
        at += 1;
    }
    let written = at - start - usize::from(point.is_some());
    if written == 0 || written > 15 {
        return None;
    }
    let decimals = point.map_or(0, |point| at - point - 1);
    let value = digits as f64 / TENS[decimals];
    Some((if negative { -value } else { value }, at))
}

/// The number at the start of `text`, which must end at a separator, and the bytes it took.
#[inline]
pub fn number(text: &[u8]) -> Option<(f64, usize)> {
    if let Some(found) = plain_number(text) {
        return Some(found);
    }
    if let Ok((value, used)) = fast_float2::parse_partial::<f64, _>(text)
        && text.get(used).is_none_or(|byte| is_separator(*byte))
    {
        return Some((value, used));
    }
    let length = text
        .iter()
        .position(|byte| is_separator(*byte))
        .unwrap_or(text.len());
    odd_number(&text[..length]).map(|value| (value, length))
}

/// A line that is not the numbers it should be.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct NotANumber {
    /// Which word, from 0.
    pub word: usize,
}

/// Reads the numbers of `line` into `values`; how many there are, which may be more than fit.
#[inline]
pub fn numbers(line: &[u8], values: &mut [f64]) -> std::result::Result<usize, NotANumber> {
    let mut at = 0;
    let mut count = 0;
    loop {
        while at < line.len() && is_separator(line[at]) {
            at += 1;
        }
        if at == line.len() {
            return Ok(count);
        }
        let (value, used) = number(&line[at..]).ok_or(NotANumber { word: count })?;
        if let Some(slot) = values.get_mut(count) {
            *slot = value;
        }
        count += 1;
        at += used;
    }
}

/// A few characters of a line, for messages.
pub fn excerpt(line: &[u8]) -> String {
    let text: String = String::from_utf8_lossy(line)
        .chars()
        .map(|c| if c.is_control() { '.' } else { c })
        .take(41)
        .collect();
    if text.chars().count() > 40 {
        text.chars().take(40).chain(['…']).collect()
    } else {
        text
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_come_whole_across_blocks() {
        let text: String = (0..300_000).map(|i| format!("{i} {i}\n")).collect();
        let mut lines = Lines::new(text.as_bytes());
        let mut expected = 0u64;
        while let Some(line) = lines.next_line().unwrap() {
            assert_eq!(line, format!("{expected} {expected}").as_bytes());
            expected += 1;
        }
        assert_eq!(expected, 300_000);
        assert_eq!(lines.offset(), text.len() as u64);
    }

    #[test]
    fn a_line_without_end_is_not_text() {
        let junk = vec![7u8; 2 * LONGEST_LINE];
        assert!(Lines::new(junk.as_slice()).next_line().is_err());
    }

    #[test]
    fn plain_numbers_are_those_of_the_standard_library() {
        let mut state = 1u64;
        for round in 0..200_000 {
            state = state
                .wrapping_mul(6364136223846793005)
                .wrapping_add(1442695040888963407);
            let digits = (state >> 20) % 10u64.pow(1 + round % 15);
            let decimals = ((state >> 8) % 16) as usize;
            let mut text = format!("{digits:0width$}", width = decimals + 1);
            text.insert(text.len() - decimals, '.');
            if state & 1 == 0 {
                text.insert(0, '-');
            }
            let (value, used) = number(text.as_bytes()).unwrap();
            assert_eq!((value, used), (text.parse().unwrap(), text.len()), "{text}");
        }
        for text in ["", "-", ".", "-.", "1.2.3", "1-", "--1"] {
            assert!(number(text.as_bytes()).is_none(), "{text}");
        }
    }

    #[test]
    fn numbers_of_every_spelling() {
        let mut values = [0.0; 4];
        assert_eq!(numbers(b" 1.5,-2e-3\t+3;4 5\r", &mut values), Ok(5));
        assert_eq!(values, [1.5, -0.002, 3.0, 4.0]);
        assert_eq!(numbers(b"1 2x 3", &mut values), Err(NotANumber { word: 1 }));
        assert_eq!(numbers(b"-nan(ind) 1.#QNAN nan", &mut values), Ok(3));
        assert!(values[..3].iter().all(|value| value.is_nan()));
    }
}
