//! One scan, prepared: what it saw, as surfels, patches and free space.

pub mod directions;
pub mod free_space;
pub mod mixed_points;
pub mod patches;
pub mod prepare;
pub mod range_image;
pub mod surfel_map;
pub mod surfels;
