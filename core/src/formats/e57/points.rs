//! Points of one scan, decoded column by column.
//!
//! A compressed vector section (ASTM E2807) is a header and packets; a data packet carries a piece of
//! one byte stream per field, and values may straddle packets. Each field that matters is unpacked into a short
//! column; points are taken as soon as every column holds them.

use std::io::{Read, Seek};

use super::describe::ScanInfo;
use super::packets::{Fields, Packets};
use super::pages::PageReader;
use super::sink::{Points, Sink};
use crate::formats::error::{Result, fail};
use crate::formats::limits::{BYTES_PER_POINT, allowed_memory};

/// Values of one bit that the last byte of a stream may have room for.
const PADDED: u64 = 8;
/// The most points that fields without a single bit may stand for.
const MOST_CONSTANT_POINTS: u64 = 1 << 20;

/// Reads the points of `scan` from `file`, in metres when `metres_per_unit` is the length of the file's unit.
pub fn read_points<R: Read + Seek>(
    file: R,
    scan: &ScanInfo,
    metres_per_unit: f64,
) -> Result<Points> {
    let mut pages = PageReader::new(file)?;
    let mut fields = Fields::new(scan)?;
    let mut sink = Sink::new(scan, &fields, metres_per_unit);
    if scan.records == 0 {
        return Ok(sink.finish());
    }
    let mut packets = Packets::open(&mut pages, scan)?;
    check_record_count(scan, packets.end - packets.start)?;
    sink.reserve(scan.records)?;
    let mut left = scan.records;
    while left > 0 {
        let complete = fields.complete(left);
        if complete == 0 {
            if !packets.next(&mut fields)? {
                fail!(
                    whole,
                    "it promises {} points but holds {}",
                    scan.records,
                    scan.records - left
                );
            }
            continue;
        }
        fields.fill_constants(complete);
        sink.take(&fields, complete);
        fields.drop_first(complete);
        left -= complete as u64;
    }
    let mut points = sink.finish();
    points.surplus = surplus(&mut packets, &mut fields);
    Ok(points)
}

/// Points behind the last one that is promised; what is damaged there is none.
fn surplus<R: Read + Seek>(packets: &mut Packets<R>, fields: &mut Fields) -> u64 {
    let mut surplus = fields.waiting();
    // The last byte of a stream may have room for more values of a few bits.
    if surplus < PADDED {
        surplus = 0;
    }
    fields.drop_first(usize::MAX);
    while let Ok(true) = packets.next(fields) {
        let more = fields.waiting();
        fields.drop_first(more as usize);
        surplus += more;
    }
    surplus
}

/// A count that the section has no room for is refused before anything is allocated for it.
fn check_record_count(scan: &ScanInfo, section_bytes: u64) -> Result<()> {
    let bits: u64 = scan
        .fields
        .iter()
        .map(|field| u64::from(field.coding.bits()))
        .sum();
    let room = (section_bytes * 8)
        .checked_div(bits)
        .unwrap_or(MOST_CONSTANT_POINTS);
    if scan.records > room {
        fail!(
            whole,
            "it promises {} points, but there is room for {room} at most",
            scan.records
        );
    }
    if scan.records * BYTES_PER_POINT > allowed_memory(section_bytes) {
        fail!(
            whole,
            "it promises {} points in {section_bytes} bytes: no scan is so dense",
            scan.records
        );
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use std::fs::File;
    use std::path::Path;

    use ::e57::{E57Writer, Record, RecordDataType, RecordName, RecordValue};

    use super::*;
    use crate::formats::e57::describe;

    fn write(path: &Path, prototype: Vec<Record>, points: Vec<Vec<RecordValue>>) {
        let mut file = E57Writer::from_file(path, "{file}").unwrap();
        let mut cloud = file.add_pointcloud("{scan}", prototype).unwrap();
        for point in points {
            cloud.add_point(point).unwrap();
        }
        cloud.finalize().unwrap();
        file.finalize().unwrap();
    }

    fn read(path: &Path) -> Result<Points> {
        let found = describe(File::open(path)?)?;
        read_points(File::open(path)?, found.scans[0].as_ref().unwrap(), 1.0)
    }

    fn record(name: RecordName, data_type: RecordDataType) -> Record {
        Record { name, data_type }
    }

    fn scaled(scale: f64) -> RecordDataType {
        RecordDataType::ScaledInteger {
            min: -1_000_000,
            max: 3_000_000,
            scale,
            offset: 0.25,
        }
    }

    #[test]
    fn spherical_scaled_integers_become_x_y_z() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("spherical.e57");
        let state = RecordDataType::Integer { min: 0, max: 2 };
        let prototype = vec![
            record(RecordName::SphericalAzimuth, scaled(1e-6)),
            record(RecordName::SphericalInvalidState, state),
            record(RecordName::SphericalElevation, scaled(4e-7)),
            record(RecordName::SphericalRange, scaled(1e-5)),
        ];
        let raw: Vec<[i64; 4]> = (0..30_000)
            .map(|i| {
                [
                    i * 97 % 4_000_001 - 1_000_000,
                    i % 3,
                    i * 61 % 4_000_001 - 1_000_000,
                    i * 7,
                ]
            })
            .collect();
        let values = raw.iter().map(|&[azimuth, state, elevation, range]| {
            vec![
                RecordValue::ScaledInteger(azimuth),
                RecordValue::Integer(state),
                RecordValue::ScaledInteger(elevation),
                RecordValue::ScaledInteger(range),
            ]
        });
        write(&path, prototype, values.collect());
        let points = read(&path).unwrap();
        assert_eq!((points.xyz.len(), points.invalid), (30_000, 20_000));
        let valid = raw.iter().filter(|values| values[1] == 0);
        for (xyz, &[azimuth, _, elevation, range]) in points.xyz.chunks_exact(3).zip(valid) {
            let azimuth = azimuth as f64 * 1e-6 + 0.25;
            let elevation = elevation as f64 * 4e-7 + 0.25;
            let range = range as f64 * 1e-5 + 0.25;
            let [x, y, z] = [0, 1, 2].map(|axis| f64::from(xyz[axis]));
            assert!((x.hypot(y).hypot(z) - range).abs() < 1e-6);
            assert!((y.atan2(x) - azimuth).abs() < 1e-6);
            assert!((z.atan2(x.hypot(y)) - elevation).abs() < 1e-6);
        }
    }

    #[test]
    fn spherical_coordinates_stand_in_where_cartesian_ones_are_invalid() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("both.e57");
        let double = || RecordDataType::Double {
            min: None,
            max: None,
        };
        let state = || RecordDataType::Integer { min: 0, max: 2 };
        let prototype = [
            (RecordName::CartesianX, double()),
            (RecordName::CartesianY, double()),
            (RecordName::CartesianZ, double()),
            (RecordName::CartesianInvalidState, state()),
            (RecordName::SphericalRange, double()),
            (RecordName::SphericalAzimuth, double()),
            (RecordName::SphericalElevation, double()),
            (RecordName::SphericalInvalidState, state()),
        ]
        .map(|(name, data_type)| record(name, data_type));
        let point = |flat: i64, round: i64| {
            let mut values = [1.0, 2.0, 3.0].map(RecordValue::Double).to_vec();
            values.push(RecordValue::Integer(flat));
            values.extend([5.0, 0.0, 0.0].map(RecordValue::Double));
            values.push(RecordValue::Integer(round));
            values
        };
        let points = vec![
            point(0, 0),
            point(2, 0),
            point(0, 2),
            point(2, 1),
            point(1, 2),
        ];
        write(&path, prototype.to_vec(), points);
        let points = read(&path).unwrap();
        assert_eq!(points.xyz, [1.0, 2.0, 3.0, 5.0, 0.0, 0.0, 1.0, 2.0, 3.0]);
        assert_eq!(points.invalid, 2);
    }

    #[test]
    fn fields_without_a_bit_and_of_64_bits_live_side_by_side() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("widths.e57");
        let prototype = vec![
            record(
                RecordName::CartesianX,
                RecordDataType::Integer { min: 7, max: 7 },
            ),
            record(
                RecordName::CartesianY,
                RecordDataType::Integer {
                    min: i64::MIN,
                    max: i64::MAX,
                },
            ),
            record(
                RecordName::CartesianZ,
                RecordDataType::Integer { min: 0, max: 1 },
            ),
        ];
        let points = (0..20_001).map(|i| {
            vec![7, i - 10_000, i % 2]
                .into_iter()
                .map(RecordValue::Integer)
                .collect()
        });
        write(&path, prototype, points.collect());
        let points = read(&path).unwrap();
        assert_eq!(points.xyz.len(), 3 * 20_001);
        for (i, xyz) in points.xyz.chunks_exact(3).enumerate() {
            assert_eq!(xyz, [7.0, i as f32 - 10_000.0, (i % 2) as f32]);
        }
    }

    #[test]
    fn the_local_origin_is_round_and_near_most_points() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("large.e57");
        let axes = [
            RecordName::CartesianX,
            RecordName::CartesianY,
            RecordName::CartesianZ,
        ];
        let double = RecordDataType::Double {
            min: None,
            max: None,
        };
        let prototype = axes.map(|name| record(name, double.clone())).to_vec();
        // The first point is far off, and must not decide.
        let points: Vec<[f64; 3]> = (0..200)
            .map(|i| {
                let far = if i == 0 { 9e6 } else { 0.0 };
                [500_012.345 + f64::from(i) + far, 5_400_000.678, 310.001]
            })
            .collect();
        write(
            &path,
            prototype,
            points
                .iter()
                .map(|xyz| xyz.map(RecordValue::Double).to_vec())
                .collect(),
        );
        let read = read(&path).unwrap();
        assert_eq!(read.local_origin, [500_100.0, 5_400_000.0, 300.0]);
        for (xyz, point) in read.xyz.chunks_exact(3).zip(points).skip(1) {
            for axis in 0..3 {
                let back = f64::from(xyz[axis]) + read.local_origin[axis];
                assert!((back - point[axis]).abs() < 1e-5);
            }
        }
    }
}
