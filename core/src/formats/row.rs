//! Rows of numbers as people's programs write them: decimal commas, quotes.

use super::text::{NotANumber, is_separator, numbers};

/// Reads rows of one file.
#[derive(Clone, Debug, Default)]
pub struct RowReader {
    /// Commas are decimal signs, not separators.
    pub decimal_comma: bool,
    scratch: Vec<u8>,
}

impl RowReader {
    pub fn new(decimal_comma: bool) -> Self {
        Self {
            decimal_comma,
            scratch: Vec::new(),
        }
    }

    /// As `text::numbers`; numbers may stand in quotes, where a comma is a decimal sign in any case.
    #[inline]
    pub fn numbers(&mut self, line: &[u8], values: &mut [f64]) -> Result<usize, NotANumber> {
        if !self.decimal_comma {
            let plain = numbers(line, values);
            if plain.is_ok() || !line.contains(&b'"') {
                return plain;
            }
        }
        self.scratch.clear();
        let mut quoted = false;
        for &byte in line {
            quoted ^= byte == b'"';
            self.scratch.push(match byte {
                b'"' => b' ',
                b',' if quoted || self.decimal_comma => b'.',
                byte => byte,
            });
        }
        numbers(&self.scratch, values)
    }

    /// How many numbers a line holds; None where it holds anything else.
    pub fn count(&mut self, line: &[u8]) -> Option<usize> {
        self.numbers(line, &mut []).ok()
    }
}

/// Whether the commas of a row are decimal signs: `1,5;2,0;3,1` or `1,5 2 3,1`. None where it has none.
pub fn has_decimal_commas(line: &[u8]) -> Option<bool> {
    if !line.contains(&b',') {
        return None;
    }
    let mut words = line
        .split(|byte| is_separator(*byte) && *byte != b',')
        .filter(|word| !word.is_empty());
    let decimal = |word: &[u8]| {
        let commas = word.iter().filter(|byte| **byte == b',').count();
        commas == 0
            || commas == 1
                && word.last() != Some(&b',')
                && word.first() != Some(&b',')
                && !word.contains(&b'.')
    };
    Some(words.clone().count() >= 3 && words.all(decimal))
}

/// Whether commas are decimal signs in all those rows of `lines` that have any; other lines count for nothing.
pub fn decimal_commas<'a>(lines: impl IntoIterator<Item = &'a [u8]>) -> bool {
    let mut commas = RowReader::new(true);
    let mut votes = lines
        .into_iter()
        .filter(|line| commas.count(line).is_some())
        .filter_map(has_decimal_commas)
        .peekable();
    votes.peek().is_some() && votes.all(|vote| vote)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(line: &str, decimal_comma: bool) -> Vec<f64> {
        let mut values = [0.0; 8];
        let count = RowReader::new(decimal_comma)
            .numbers(line.as_bytes(), &mut values)
            .unwrap();
        values[..count].to_vec()
    }

    #[test]
    fn commas_are_decimal_signs_where_something_else_separates() {
        for (line, expected) in [
            ("1,5;2,25;-3,0", Some(true)),
            ("1,5\t2\t3", Some(true)),
            ("1,5 2,25 -3,0 -700 12 13 14", Some(true)),
            ("1.5 2 3", None),
            ("1,2,3", Some(false)),
            ("1, 2, 3", Some(false)),
            ("1.5,2.5,3.5", Some(false)),
            ("1.234,5;2;3", Some(false)),
        ] {
            assert_eq!(has_decimal_commas(line.as_bytes()), expected, "{line}");
        }
        assert!(decimal_commas(
            ["X;Y;Z", "1;2;3", "1,5;2;3"].map(str::as_bytes)
        ));
        assert!(!decimal_commas(["X Y Z", "1 2 3"].map(str::as_bytes)));
    }

    #[test]
    fn numbers_in_quotes() {
        assert_eq!(row("\"1.5\",\"-2\",\"3\"", false), [1.5, -2.0, 3.0]);
        assert_eq!(row("\"1,5\",\"-2,25\",3", false), [1.5, -2.25, 3.0]);
        assert_eq!(row("\"1,5\";\"-2,25\";3", true), [1.5, -2.25, 3.0]);
    }
}
