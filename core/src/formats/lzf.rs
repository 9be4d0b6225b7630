//! LZF, the compression of PCD files.

/// The `size` bytes in `input`: runs of literals, and references to at most 8 KiB before.
pub fn unpack(input: &[u8], size: usize) -> Option<Vec<u8>> {
    let mut output = Vec::with_capacity(size);
    let mut at = 0;
    while at < input.len() {
        let control = input[at] as usize;
        at += 1;
        if control < 32 {
            output.extend_from_slice(input.get(at..at + control + 1)?);
            at += control + 1;
        } else {
            let mut length = control >> 5;
            if length == 7 {
                length += *input.get(at)? as usize;
                at += 1;
            }
            let distance = ((control & 31) << 8) + *input.get(at)? as usize + 1;
            at += 1;
            let start = output.len().checked_sub(distance)?;
            for from in start..start + length + 2 {
                output.push(output[from]);
            }
        }
        if output.len() > size {
            return None;
        }
    }
    (output.len() == size).then_some(output)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lzf_repeats_what_went_before() {
        // Two literals, then seven bytes from two before: an overlapping reference.
        assert_eq!(
            unpack(&[1, b'a', b'b', 5 << 5, 1], 9).unwrap(),
            b"ababababa"
        );
        assert!(unpack(&[1, b'a', b'b', 5 << 5, 2], 9).is_none());
        assert!(unpack(&[5, b'a'], 6).is_none());
    }
}
