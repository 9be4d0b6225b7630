//! Hot kernels and file parsers of trihedral: pure Rust, no Python, no policy.
//!
//! One concept a file, its tests beside it. Rooms from the bottom to the top: `spatial`, `scan`, `image`, `pair`; `formats`
//! stands by itself.

pub mod formats;
pub mod image;
pub mod pair;
pub mod scan;
pub mod spatial;
#[cfg(test)]
mod testing;
