//! Rows of numbers: whatever is in them, the points that come out are whole.

#![no_main]

use std::io::Cursor;

use libfuzzer_sys::fuzz_target;
use trihedral_core::formats::{first_lines, xyz};

fuzz_target!(|file: &[u8]| {
    let _ = first_lines::text_kind(file);
    if let Ok(table) = xyz::sniff(Cursor::new(file), file.len() as u64) {
        if let Ok(cloud) = xyz::read(Cursor::new(file), &table, 0.001) {
            assert!(cloud.records() > 0);
            cloud.check();
        }
    }
});
