//! Hot kernels and file parsers of trihedral: pure Rust, no Python, no policy.
//!
//! One concept a file, its tests beside it.

pub mod formats;
