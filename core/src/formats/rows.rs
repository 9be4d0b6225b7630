//! Points as rows of text, for formats that are text.

use std::io::Write;

/// A direction without a return.
const NO_RETURN: &str = "0 0 0 0.500000";

/// Points to write as PTX rows: x y z intensity, and red green blue where there are colours.
pub struct Rows<'a> {
    /// x, y, z of each point, metres.
    pub xyz: &'a [f64],
    /// 0..1; without, PTX has 0.5 for "none".
    pub intensity: Option<&'a [f32]>,
    pub color: Option<&'a [u8]>,
}

impl Rows<'_> {
    /// The rows of the points named by `order`; a negative index is a direction without a return.
    ///
    /// None where an index or an array does not fit the points.
    pub fn ptx(&self, order: &[i64]) -> Option<Vec<u8>> {
        let mut text = Vec::with_capacity(order.len() * 48);
        for &index in order {
            if index < 0 {
                text.extend_from_slice(NO_RETURN.as_bytes());
                if self.color.is_some() {
                    text.extend_from_slice(b" 0 0 0");
                }
            } else {
                let index = index as usize;
                let [x, y, z] = *self.xyz.get(index * 3..)?.first_chunk()?;
                let intensity = match self.intensity {
                    Some(values) => *values.get(index)?,
                    None => 0.5,
                };
                write!(text, "{x:.6} {y:.6} {z:.6} {intensity:.6}").ok()?;
                if let Some(color) = self.color {
                    let [red, green, blue] = *color.get(index * 3..)?.first_chunk()?;
                    write!(text, " {red} {green} {blue}").ok()?;
                }
            }
            text.push(b'\n');
        }
        Some(text)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_as_the_format_has_them() {
        let rows = Rows {
            xyz: &[1.0, -2.5, 3.0, 4.0, 5.0, 6.0],
            intensity: Some(&[0.25, 1.0]),
            color: Some(&[1, 2, 3, 4, 5, 6]),
        };
        let text = String::from_utf8(rows.ptx(&[1, -1, 0]).unwrap()).unwrap();
        let lines: Vec<&str> = text.lines().collect();
        assert_eq!(lines[0], "4.000000 5.000000 6.000000 1.000000 4 5 6");
        assert_eq!(lines[1], "0 0 0 0.500000 0 0 0");
        assert_eq!(lines[2], "1.000000 -2.500000 3.000000 0.250000 1 2 3");
        assert!(rows.ptx(&[2]).is_none());
    }
}
