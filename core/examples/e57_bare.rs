//! The crate `e57` alone, iterating over every point of files: what reading cannot be faster than with it.
//! `benchmarks/stages.py` runs and times it.

use std::error::Error;
use std::fs::File;
use std::hint::black_box;
use std::io::BufReader;

fn main() -> Result<(), Box<dyn Error>> {
    let mut points = 0_u64;
    for path in std::env::args().skip(1) {
        let mut reader = e57::E57Reader::new(BufReader::new(File::open(path)?))?;
        for cloud in reader.pointclouds() {
            for point in reader.pointcloud_raw(&cloud)? {
                black_box(point?);
                points += 1;
            }
        }
    }
    println!("{points}");
    Ok(())
}
