//! E57 files: the header, the XML section, points, pictures and copies.
//!
//! The input is the binary part and the XML section, told apart by a length in front; page checksums are put on
//! here, so that the fuzzer gets behind them. The input as it is also goes to the reader of headers.

#![no_main]

use std::collections::BTreeMap;
use std::io::Cursor;

use libfuzzer_sys::fuzz_target;
use trihedral_core::formats::e57::{
    Description, ScanInfo, copy_with_poses, describe, read_image, read_points,
};

const PAGE: usize = 1024;
const PAYLOAD: usize = PAGE - 4;
const HEADER: usize = 48;

/// A file whose header is right and whose checksums hold, whatever is in it.
fn file(binary: &[u8], xml: &[u8]) -> Vec<u8> {
    let start = HEADER + binary.len();
    let pages = (start + xml.len()).div_ceil(PAYLOAD);
    let mut content = b"ASTM-E57".to_vec();
    content.extend(1_u32.to_le_bytes());
    content.extend(0_u32.to_le_bytes());
    for number in [
        pages * PAGE,
        start / PAYLOAD * PAGE + start % PAYLOAD,
        xml.len(),
        PAGE,
    ] {
        content.extend((number as u64).to_le_bytes());
    }
    content.extend(binary);
    content.extend(xml);
    content.resize(pages * PAYLOAD, 0);
    content
        .chunks(PAYLOAD)
        .flat_map(|part| [part, &crc32c::crc32c(part).to_be_bytes()].concat())
        .collect()
}

fn check_points(file: &[u8], scan: &ScanInfo) {
    let Ok(points) = read_points(Cursor::new(file), scan, 1.0) else {
        return;
    };
    let count = points.xyz.len() / 3;
    let left_out = points.invalid + points.not_finite + points.no_return;
    assert_eq!(points.xyz.len() % 3, 0);
    assert_eq!(count as u64 + left_out, scan.records);
    assert!(points.xyz.iter().all(|value| value.is_finite()));
    if let Some(values) = &points.intensity {
        assert_eq!(values.len(), count);
        assert!(values.iter().all(|value| (0.0..=1.0).contains(value)));
    }
    assert!(points.color.is_none_or(|values| values.len() == 3 * count));
    for values in [points.row, points.column].into_iter().flatten() {
        assert_eq!(values.len(), count);
    }
}

fn check_copy(file: &[u8], found: &Description) {
    let mut pose = [[0.0; 4]; 4];
    for (axis, row) in pose.iter_mut().enumerate() {
        row[axis] = 1.0;
    }
    let readable = |ok: bool, index: usize| ok.then_some((index, pose));
    let scans: BTreeMap<_, _> = (0..found.scans.len())
        .filter_map(|index| readable(found.scans[index].is_ok(), index))
        .collect();
    let images: BTreeMap<_, _> = (0..found.images.len())
        .filter_map(|index| readable(found.images[index].is_ok(), index))
        .collect();
    let mut copy = Vec::new();
    if copy_with_poses(Cursor::new(file), &mut copy, &scans, &images, None).is_err() {
        return;
    }
    let mut copied = describe(Cursor::new(copy)).unwrap();
    let mut original = found.clone();
    for both in [&mut copied, &mut original] {
        both.scans
            .iter_mut()
            .flatten()
            .for_each(|scan| scan.pose = None);
        both.images
            .iter_mut()
            .flatten()
            .for_each(|image| image.pose = None);
    }
    assert!(same(&copied, &original));
}

/// Equal, where NaN equals itself.
fn same(one: &Description, other: &Description) -> bool {
    format!("{one:?}") == format!("{other:?}")
}

fuzz_target!(|data: &[u8]| {
    let _ = describe(Cursor::new(data));
    let Some((length, rest)) = data.split_first_chunk::<3>() else {
        return;
    };
    let length = u32::from_le_bytes([length[0], length[1], length[2], 0]) as usize;
    let (binary, xml) = rest.split_at(length.min(rest.len()));
    let file = file(binary, xml);
    let Ok(found) = describe(Cursor::new(&file)) else {
        return;
    };
    for scan in found.scans.iter().flatten() {
        check_points(&file, scan);
    }
    for image in found.images.iter().flatten() {
        let _ = read_image(Cursor::new(&file), image);
    }
    check_copy(&file, &found);
});
