//! How much memory reading a file may take.

/// Bytes beside the program itself, and bytes for each byte of the file.
const MEMORY: u64 = 200_000_000;
const MEMORY_PER_BYTE: u64 = 20;

/// Bytes of memory that reading a file of so many bytes may take.
pub fn allowed_memory(file_size: u64) -> u64 {
    MEMORY.saturating_add(file_size.saturating_mul(MEMORY_PER_BYTE))
}

/// What a point takes at the most: coordinates, intensity, colour, row and column.
pub const BYTES_PER_POINT: u64 = 30;
