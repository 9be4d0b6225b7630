//! Parsers of point files: bytes in, clouds out. Every size in a header is checked before it is believed.

pub mod cloud;
mod columns;
pub mod e57;
pub mod error;
pub mod first_lines;
mod heading;
mod limits;
mod lzf;
pub mod pcd;
pub mod ply;
pub mod pts;
pub mod ptx;
pub mod record;
mod row;
pub mod rows;
pub mod text;
pub mod xyz;
