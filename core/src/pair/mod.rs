//! Two scans: where one may lie on the other, what bears that out, and the pose to the limit of the data.

pub mod agreement;
pub mod plan_correlation;
pub mod point_to_plane;
pub mod point_to_point;
pub mod ransac_planes;
