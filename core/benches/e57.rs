//! Reading 5 million points with colour, intensity and grid indices: ours beside the bare iteration of the crate
//! `e57` over the same file. `cargo bench -p trihedral-core --bench e57`.

use std::fs::File;
use std::hint::black_box;
use std::io::BufReader;
use std::path::Path;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use trihedral_core::formats::e57::{Coordinates, ScanData, Writer, describe, read_points};

const ROWS: usize = 2_000;
const COLUMNS: usize = 2_500;
const POINTS: usize = ROWS * COLUMNS;

/// Points on a sphere, with values that do not repeat.
fn write(path: &Path) {
    let (mut xyz, mut intensity, mut color) = (Vec::new(), Vec::new(), Vec::new());
    let (mut rows, mut columns) = (Vec::new(), Vec::new());
    for index in 0..POINTS {
        let (row, column) = (index % ROWS, index / ROWS);
        let azimuth = column as f64 * std::f64::consts::TAU / COLUMNS as f64;
        let elevation = (row as f64 / ROWS as f64 - 0.5) * 3.0;
        let range = 10.0 + (index as f64 * 0.618).fract();
        xyz.push((range * elevation.cos() * azimuth.cos()) as f32);
        xyz.push((range * elevation.cos() * azimuth.sin()) as f32);
        xyz.push((range * elevation.sin()) as f32);
        intensity.push((index as f64 * 0.414).fract() as f32);
        color.extend([0, 7, 13].map(|shift| (index >> shift) as u8));
        rows.push(row as i32);
        columns.push(column as i32);
    }
    let mut writer = Writer::create(path).unwrap();
    writer
        .add_scan(&ScanData {
            name: "sphere",
            guid: "{sphere}",
            pose: None,
            xyz: Coordinates::Single(&xyz),
            intensity: Some(&intensity),
            color: Some(&color),
            colorless: None,
            grid: Some((&rows, &columns)),
            invalid: None,
        })
        .unwrap();
    writer.finish("{file}").unwrap();
}

fn ours(path: &Path) -> usize {
    let found = describe(File::open(path).unwrap()).unwrap();
    let scan = found.scans[0].as_ref().unwrap();
    let points = read_points(File::open(path).unwrap(), scan, 1.0).unwrap();
    black_box(&points).xyz.len() / 3
}

fn bare(path: &Path) -> usize {
    let mut reader = e57::E57Reader::new(BufReader::new(File::open(path).unwrap())).unwrap();
    let cloud = reader.pointclouds().remove(0);
    let points = reader.pointcloud_raw(&cloud).unwrap();
    points
        .map(|point| black_box(point.unwrap()).len().min(1))
        .sum()
}

fn simple(path: &Path) -> usize {
    let mut reader = e57::E57Reader::new(BufReader::new(File::open(path).unwrap())).unwrap();
    let cloud = reader.pointclouds().remove(0);
    let points = reader.pointcloud_simple(&cloud).unwrap();
    points
        .map(|point| usize::from(black_box(point.unwrap()).row >= 0))
        .sum()
}

fn read(criterion: &mut Criterion) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("sphere.e57");
    write(&path);
    let mut group = criterion.benchmark_group("e57/read");
    group
        .sample_size(10)
        .throughput(Throughput::Elements(POINTS as u64));
    for (name, run) in [
        ("ours", ours as fn(&Path) -> usize),
        ("crate, raw", bare),
        ("crate, simple", simple),
    ] {
        group.bench_function(name, |bencher| {
            bencher.iter(|| assert_eq!(run(&path), POINTS));
        });
    }
    group.finish();
}

criterion_group!(benches, read);
criterion_main!(benches);
