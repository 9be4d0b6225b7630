//! PLY files: whatever is in them, the points that come out are whole.

#![no_main]

use libfuzzer_sys::fuzz_target;
use trihedral_core::formats::ply;

fuzz_target!(|file: &[u8]| {
    if let Ok((header, cloud)) = ply::read(file, file.len() as u64, 1.0) {
        assert_eq!(cloud.records(), header.vertex().count);
        cloud.check();
    }
});
