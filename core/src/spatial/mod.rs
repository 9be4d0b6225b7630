//! Searching and summing points in space.

pub mod hash_grid;
pub mod kd_tree;
pub mod moments;
