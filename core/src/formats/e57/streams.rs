//! From the bytes of a field to its numbers.

use super::describe::Coding;

/// The little-endian number at `at`, which must lie within.
pub fn u16_at(bytes: &[u8], at: usize) -> u16 {
    u16::from_le_bytes([bytes[at], bytes[at + 1]])
}

/// The little-endian number at `at`, which must lie within.
pub fn u64_at(bytes: &[u8], at: usize) -> u64 {
    let mut word = [0; 8];
    word.copy_from_slice(&bytes[at..at + 8]);
    u64::from_le_bytes(word)
}

/// How bits become numbers.
#[derive(Clone, Copy)]
pub enum Decoding {
    /// A field that nothing is wanted of.
    Ignored,
    Single,
    Double,
    /// Always the same value, in no bits.
    Constant(f64),
    Packed {
        bits: u32,
        min: i64,
        scale: f64,
        offset: f64,
    },
}

impl From<Coding> for Decoding {
    fn from(stored: Coding) -> Self {
        match stored {
            Coding::Single { .. } => Self::Single,
            Coding::Double { .. } => Self::Double,
            Coding::Integer {
                min, scale, offset, ..
            } => match stored.bits() {
                0 => Self::Constant(min as f64 * scale + offset),
                bits => Self::Packed {
                    bits,
                    min,
                    scale,
                    offset,
                },
            },
        }
    }
}

/// One field's bytes that are not yet values, and its values that are not yet points.
pub struct Stream {
    pub decoding: Decoding,
    bytes: Vec<u8>,
    /// Bits of `bytes` that are used up.
    bit: usize,
    values: Vec<f64>,
    /// Values at the beginning that are used up.
    used: usize,
}

/// Bytes after the last one that unpacking may look at.
const PADDING: usize = 16;

impl Stream {
    pub fn new(decoding: Decoding) -> Self {
        Self {
            decoding,
            bytes: Vec::new(),
            bit: 0,
            values: Vec::new(),
            used: 0,
        }
    }

    /// The values that are not yet points.
    pub fn waiting(&self) -> &[f64] {
        &self.values[self.used..]
    }

    /// Forgets the first `count` of them. They are moved when as many are used up as wait: in linear time altogether.
    pub fn drop_first(&mut self, count: usize) {
        self.used += count.min(self.values.len() - self.used);
        if 2 * self.used >= self.values.len() {
            self.values.drain(..self.used);
            self.used = 0;
        }
    }

    /// Gives a field without bits its values.
    pub fn fill_constant(&mut self, count: usize) {
        if let Decoding::Constant(value) = self.decoding {
            self.values.resize(self.used + count, value);
        }
    }

    pub fn push(&mut self, bytes: &[u8]) {
        let bits = match self.decoding {
            Decoding::Ignored | Decoding::Constant(_) => return,
            Decoding::Single => 32,
            Decoding::Double => 64,
            Decoding::Packed { bits, .. } => bits as usize,
        };
        self.bytes.drain(..self.bit / 8);
        self.bit %= 8;
        self.bytes.extend_from_slice(bytes);
        let count = (self.bytes.len() * 8 - self.bit) / bits;
        match self.decoding {
            Decoding::Single => self.values.extend(
                self.bytes
                    .chunks_exact(4)
                    .map(|b| f64::from(f32::from_le_bytes([b[0], b[1], b[2], b[3]]))),
            ),
            Decoding::Double => self.values.extend(
                self.bytes
                    .chunks_exact(8)
                    .map(|b| f64::from_bits(u64_at(b, 0))),
            ),
            Decoding::Packed {
                bits,
                min,
                scale,
                offset,
            } => {
                let whole = self.bytes.len();
                self.bytes.resize(whole + PADDING, 0);
                let value = |raw: u64| raw.cast_signed().wrapping_add(min) as f64 * scale + offset;
                self.values.extend(
                    (0..count).map(|index| value(bits_at(&self.bytes, self.bit, bits, index))),
                );
                self.bytes.truncate(whole);
            }
            Decoding::Ignored | Decoding::Constant(_) => {}
        }
        self.bit += count * bits;
    }
}

/// The unsigned integer number `index` of `bits` bits each, the least significant bit first.
fn bits_at(bytes: &[u8], first_bit: usize, bits: u32, index: usize) -> u64 {
    let at = first_bit + index * bits as usize;
    let low = u64_at(bytes, at / 8) >> (at % 8);
    let value = if bits <= 57 {
        low
    } else {
        // Such a value may reach into a ninth byte.
        low | u64::from(bytes[at / 8 + 8]).unbounded_shl(64 - (at % 8) as u32)
    };
    value & (u64::MAX >> (64 - bits))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Bits of a number, one at a time, as the standard lays them out.
    fn slow_bits(bytes: &[u8], first_bit: usize, bits: u32, index: usize) -> u64 {
        (0..bits as usize).fold(0, |value, bit| {
            let at = first_bit + index * bits as usize + bit;
            value | u64::from(bytes[at / 8] >> (at % 8) & 1) << bit
        })
    }

    #[test]
    fn numbers_of_any_width_unpack() {
        let bytes: Vec<u8> = (0..200_u32).map(|i| (i * 167 + 13) as u8).collect();
        for bits in 1..=64 {
            for first_bit in 0..8 {
                for index in 0..20 {
                    assert_eq!(
                        bits_at(&bytes, first_bit, bits, index),
                        slow_bits(&bytes, first_bit, bits, index),
                        "{bits} bits, number {index} after {first_bit} bits"
                    );
                }
            }
        }
    }
}
