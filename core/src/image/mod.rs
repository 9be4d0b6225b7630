//! Pictures, the cameras that took them, and what shows in them.

pub mod camera;
pub mod rasterizer;
pub mod scan_mesh;
pub mod surf;
pub mod texture;
