//! Rows of numbers: whatever is in them, the points that come out are whole.

#![no_main]

use libfuzzer_sys::fuzz_target;
use trihedral_core::formats::xyz;

fuzz_target!(|file: &[u8]| {
    if let Ok(table) = xyz::sniff(file) {
        if let Ok(cloud) = xyz::read(&file[table.offset as usize..], &table, 0.001) {
            assert!(cloud.records() > 0);
            cloud.check();
        }
    }
});
