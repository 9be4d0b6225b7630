//! Hot kernels and file parsers of trihedral: pure Rust, no Python, no policy.
//!
//! One concept a file, its tests beside it.

pub mod agreement;
pub mod camera;
pub mod correlation;
pub mod drawing;
pub mod formats;
pub mod icp;
pub mod moments;
pub mod neighbours;
pub mod patches;
pub mod range_image;
pub mod refinement;
pub mod segmentation;
pub mod station;
pub mod surf;
pub mod surface;
pub mod surfels;
pub mod texture;
pub mod tree;
pub mod visibility;
