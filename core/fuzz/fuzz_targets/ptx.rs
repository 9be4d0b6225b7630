//! PTX files: whatever is in them, the points that come out are whole and lie on their grid.

#![no_main]

use libfuzzer_sys::fuzz_target;
use trihedral_core::formats::ptx;

fuzz_target!(|file: &[u8]| {
    for scan in ptx::index(file, file.len() as u64).unwrap_or_default() {
        if let Ok(cloud) = ptx::read(&file[scan.offset as usize..], &scan, 1.0) {
            assert_eq!(cloud.records(), scan.columns * scan.rows);
            assert!(cloud.row.iter().all(|row| (*row as u64) < scan.rows));
            assert!(
                cloud
                    .column
                    .iter()
                    .all(|column| (*column as u64) < scan.columns)
            );
            cloud.check();
        }
    }
});
