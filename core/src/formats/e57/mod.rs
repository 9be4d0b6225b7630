//! ASTM E2807 ("E57") files.
//!
//! The crate `e57` writes files. Reading is ours: points are decoded column by column, several times as fast as by
//! the crate's iterators (`benches/e57.rs`), and within the bounds that each section states, so that a record count that promises
//! more points than there are is an error instead of a walk into whatever follows; and a fault in one scan or
//! picture does not cost the others.

mod columns;
mod copy;
mod describe;
mod packets;
mod pages;
mod points;
mod sink;
mod streams;
mod write;
mod xml;

pub use columns::{Coordinates, Matrix, ScanData};
pub use copy::{CopyError, Poses, copy_with_poses};
pub use describe::{Coding, Description, Field, ImageInfo, Pose, ScanInfo, describe, read_image};
pub use points::read_points;
pub use sink::Points;
pub use write::{Photo, PhotoModel, Writer};
pub use xml::Entry;
