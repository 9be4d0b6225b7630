//! Reading a million points with colour and intensity from each text and record format.
//! `cargo bench -p trihedral-core --bench formats`.

use std::fmt::Write;
use std::hint::black_box;
use std::io::Cursor;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use trihedral_core::formats::cloud::Cloud;
use trihedral_core::formats::{pcd, ply, pts, ptx, xyz};

const POINTS: usize = 1_000_000;

struct Sample {
    xyz: [f32; 3],
    intensity: f32,
    color: [u8; 3],
}

/// Values that do not repeat.
fn samples() -> impl Iterator<Item = Sample> {
    (0..POINTS).map(|index| {
        let part = |factor: f64| ((index as f64 * factor).fract() * 40.0 - 20.0) as f32;
        Sample {
            xyz: [part(0.618), part(0.414), part(0.732)],
            intensity: (index as f64 * 0.236).fract() as f32,
            color: [0, 7, 13].map(|shift| (index >> shift) as u8),
        }
    })
}

fn rows() -> String {
    let mut text = String::new();
    for Sample {
        xyz: [x, y, z],
        intensity,
        color: [r, g, b],
    } in samples()
    {
        writeln!(text, "{x:.6} {y:.6} {z:.6} {intensity:.6} {r} {g} {b}").unwrap();
    }
    text
}

fn records(color_first: bool) -> Vec<u8> {
    let mut bytes = Vec::new();
    for Sample {
        xyz,
        intensity,
        color: [r, g, b],
    } in samples()
    {
        xyz.iter()
            .chain([&intensity])
            .for_each(|value| bytes.extend(value.to_le_bytes()));
        if color_first {
            bytes.extend([r, g, b]);
        } else {
            bytes.extend([b, g, r, 0]);
        }
    }
    bytes
}

fn bench(c: &mut Criterion) {
    let rows = rows();
    let unit = "0 0 0\n1 0 0\n0 1 0\n0 0 1\n1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n";
    let ptx_file = format!("1000\n{}\n{unit}{rows}", POINTS / 1000);
    let pts_file = format!("{POINTS}\n{rows}");
    let mut pcd_file = format!(
        "VERSION .7\nFIELDS x y z intensity rgb\nSIZE 4 4 4 4 4\nTYPE F F F F F\nCOUNT 1 1 1 1 1\nWIDTH {POINTS}\nHEIGHT 1\nPOINTS {POINTS}\nDATA binary\n"
    )
    .into_bytes();
    pcd_file.extend(records(false));
    let mut ply_file = format!(
        "ply\nformat binary_little_endian 1.0\nelement vertex {POINTS}\nproperty float x\nproperty float y\nproperty float z\nproperty float intensity\nproperty uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n"
    )
    .into_bytes();
    ply_file.extend(records(true));

    let mut group = c.benchmark_group("formats");
    group
        .throughput(Throughput::Elements(POINTS as u64))
        .sample_size(10);
    let mut time = |name: &str, read: &dyn Fn() -> Cloud| {
        group.bench_function(name, |bencher| {
            bencher.iter(|| assert_eq!(black_box(read()).len(), POINTS));
        });
    };
    time("ptx", &|| {
        let file = ptx_file.as_bytes();
        let scan = ptx::index(file, file.len() as u64).unwrap().remove(0);
        ptx::read(&file[scan.offset as usize..], &scan, 1.0).unwrap()
    });
    time("pts", &|| {
        let file = pts_file.as_bytes();
        let block = pts::index(file, file.len() as u64).unwrap().remove(0);
        pts::read(&file[block.offset as usize..], &block, 1.0).unwrap()
    });
    time("xyz", &|| {
        let table = xyz::sniff(Cursor::new(&rows), rows.len() as u64).unwrap();
        xyz::read(Cursor::new(&rows), &table, 1.0).unwrap()
    });
    time("pcd binary", &|| {
        pcd::read(pcd_file.as_slice(), pcd_file.len() as u64, 1.0)
            .unwrap()
            .1
    });
    time("ply binary", &|| {
        ply::read(ply_file.as_slice(), ply_file.len() as u64, 1.0)
            .unwrap()
            .1
    });
    group.finish();
}

criterion_group!(benches, bench);
criterion_main!(benches);
