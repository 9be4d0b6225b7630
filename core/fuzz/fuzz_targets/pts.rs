//! PTS files: whatever is in them, the points that come out are whole.

#![no_main]

use libfuzzer_sys::fuzz_target;
use trihedral_core::formats::pts;

fuzz_target!(|file: &[u8]| {
    for block in pts::index(file, file.len() as u64).unwrap_or_default() {
        if let Ok(cloud) = pts::read(&file[block.offset as usize..], &block, 1.0) {
            // A first row of another width is left out.
            assert_eq!(cloud.records() + u64::from(block.stray), block.points);
            cloud.check();
        }
    }
});
