//! Nearest neighbours within a fixed radius, by a hashed grid of cells.
//!
//! Queries of a pair are short-ranged, and most of them find nothing: a k-d tree walks far before it knows that. Eight
//! cells answer for sure whether a point lies within half a cell's edge.

use std::cmp::Ordering;

use nalgebra::{RealField, convert, convert_unchecked};

/// Points sorted into cells, and cells into buckets.
///
/// Cells that follow each other along x lie in buckets that follow each other: two of them are one run of points. Cells
/// that share a bucket by chance cost some distances and change nothing.
pub struct NeighbourGrid {
    cell: f32,
    /// Where each bucket's points begin, and where the last one's end.
    starts: Vec<u32>,
    /// Point indices and points, bucket by bucket.
    order: Vec<u32>,
    points: Vec<[f32; 3]>,
}

/// The cell of a point in units of cells: `floor`, which baseline x86-64 has no instruction for.
fn cell_of(scaled: [f32; 3]) -> [i32; 3] {
    scaled.map(|v| {
        let towards_zero = v.clamp(-1e9, 1e9) as i32;
        towards_zero - i32::from(towards_zero as f32 > v)
    })
}

impl NeighbourGrid {
    /// A grid for queries up to `radius` (m).
    pub fn new(points: &[[f32; 3]], radius: f32) -> Self {
        let cell = 2.0 * radius;
        let mut grid = Self {
            cell,
            starts: vec![0; (2 * points.len()).next_power_of_two().max(64) + 1],
            order: vec![0; points.len()],
            points: vec![[0.0; 3]; points.len()],
        };
        let buckets: Vec<usize> = points
            .iter()
            .map(|p| grid.bucket(cell_of(p.map(|v| v / cell))))
            .collect();
        for &bucket in &buckets {
            grid.starts[bucket + 1] += 1;
        }
        let mut sum = 0;
        for start in &mut grid.starts {
            sum += *start;
            *start = sum;
        }
        let mut next = grid.starts.clone();
        for (index, &bucket) in buckets.iter().enumerate() {
            let slot = next[bucket] as usize;
            next[bucket] += 1;
            grid.order[slot] = index as u32;
            grid.points[slot] = points[index];
        }
        grid
    }

    fn bucket(&self, [x, y, z]: [i32; 3]) -> usize {
        let mixed = (y as u32)
            .wrapping_mul(0x9e37_79b1)
            .wrapping_add((z as u32).wrapping_mul(0x85eb_ca77));
        // The upper bits are mixed best.
        let row = mixed ^ (mixed >> 15);
        row.wrapping_add(x as u32) as usize & (self.starts.len() - 2)
    }

    /// The largest radius that queries may ask for (m).
    pub fn radius(&self) -> f32 {
        self.cell / 2.0
    }

    /// The nearest point within the radius (m), which is cut to that of the grid; the lowest index of equals.
    pub fn nearest(&self, point: [f32; 3], radius: f32) -> Option<usize> {
        if !point.iter().all(|v| v.is_finite()) {
            return None;
        }
        let radius = radius.min(self.radius());
        let scaled = point.map(|v| v / self.cell);
        let home = cell_of(scaled);
        let within: [f32; 3] = std::array::from_fn(|axis| scaled[axis] - home[axis] as f32);
        // The half of the cell that the point lies in says which neighbours its radius can touch.
        let side = within.map(|w| if w < 0.5 { -1 } else { 1 });
        // Squared distances to those neighbours, a little less for what rounding does.
        let beyond = within.map(|w| {
            let gap = 0.999 * w.min(1.0 - w) * self.cell;
            gap * gap
        });
        let mut best = (radius * radius, u32::MAX);
        for (across_y, across_z) in [(false, false), (true, false), (false, true), (true, true)] {
            let mut least = 0.0;
            let mut index = home;
            if across_y {
                least += beyond[1];
                index[1] += side[1];
            }
            if across_z {
                least += beyond[2];
                index[2] += side[2];
            }
            if least > best.0 {
                continue;
            }
            let bucket = self.bucket(index);
            if least + beyond[0] > best.0 {
                self.nearer_in(bucket, bucket + 1, point, &mut best);
                continue;
            }
            index[0] += side[0];
            let other = self.bucket(index);
            if bucket.abs_diff(other) == 1 {
                self.nearer_in(bucket.min(other), bucket.max(other) + 1, point, &mut best);
            } else {
                self.nearer_in(bucket, bucket + 1, point, &mut best);
                self.nearer_in(other, other + 1, point, &mut best);
            }
        }
        (best.1 != u32::MAX).then_some(best.1 as usize)
    }

    /// Improve the best squared distance and index by the points of buckets `from` up to `to`.
    fn nearer_in(&self, from: usize, to: usize, point: [f32; 3], best: &mut (f32, u32)) {
        let slots = self.starts[from] as usize..self.starts[to] as usize;
        for (other, &index) in self.points[slots.clone()].iter().zip(&self.order[slots]) {
            let d = [
                other[0] - point[0],
                other[1] - point[1],
                other[2] - point[2],
            ];
            let squared = d[0] * d[0] + d[1] * d[1] + d[2] * d[2];
            if squared < best.0 || (squared == best.0 && index < best.1) {
                *best = (squared, index);
            }
        }
    }
}

fn key(index: [i32; 3]) -> u64 {
    index
        .iter()
        .fold(0, |key, &i| key << 21 | u64::from((i as u32) & 0x1f_ffff))
}

/// Indices of points at least about `spacing` apart: of each voxel of that edge, the point nearest to the mean.
///
/// Worked out in the precision of the points.
pub fn thinned<T: RealField + Copy>(points: &[[T; 3]], spacing: T) -> Vec<u32> {
    let voxel = |v: T| convert_unchecked::<T, f64>((v / spacing).floor()) as i32;
    let mut keyed: Vec<(u64, u32)> = points
        .iter()
        .enumerate()
        .map(|(index, p)| (key(p.map(voxel)), index as u32))
        .collect();
    keyed.sort_unstable();
    let mut kept: Vec<u32> = keyed
        .chunk_by(|a, b| a.0 == b.0)
        .map(|run| {
            let count: T = convert(run.len() as f64);
            let mean: [T; 3] = std::array::from_fn(|axis| {
                let values = run.iter().map(|r| points[r.1 as usize][axis]);
                values.fold(T::zero(), |sum, value| sum + value) / count
            });
            let off = |&index: &u32| {
                let apart = points[index as usize].iter().zip(mean);
                let squares = apart.map(|(&v, m)| (v - m) * (v - m));
                squares.fold(T::zero(), |sum, square| sum + square)
            };
            run.iter()
                .map(|r| r.1)
                .min_by(|a, b| off(a).partial_cmp(&off(b)).unwrap_or(Ordering::Equal))
                .expect("a run has a point")
        })
        .collect();
    kept.sort_unstable();
    kept
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::scattered;

    const STEPS: f32 = 1e6;

    #[test]
    fn nearest_agrees_with_trying_every_point() {
        let points = scattered(2000, 1, STEPS);
        let grid = NeighbourGrid::new(&points, 0.5);
        let mut found = 0;
        for query in scattered(1000, 2, STEPS) {
            for radius in [0.1_f32, 0.3, 0.5, 0.9] {
                let within = radius.min(0.5);
                let expected = points
                    .iter()
                    .enumerate()
                    .map(|(i, p)| ((0..3).map(|a| (p[a] - query[a]).powi(2)).sum::<f32>(), i))
                    .filter(|(d, _)| *d < within * within)
                    .min_by(|a, b| a.0.total_cmp(&b.0));
                assert_eq!(grid.nearest(query, radius), expected.map(|e| e.1));
                found += usize::from(expected.is_some());
            }
        }
        assert!(found > 500);
        assert_eq!(grid.nearest([f32::NAN, 0.0, 0.0], 0.5), None);
        assert_eq!(NeighbourGrid::new(&[], 0.5).nearest([0.0; 3], 0.5), None);
    }

    #[test]
    fn thinning_keeps_one_point_a_voxel() {
        let points = scattered(5000, 3, STEPS);
        let kept = thinned(&points, 1.0);
        let voxels: std::collections::BTreeSet<_> =
            points.iter().map(|p| p.map(|v| v.floor() as i32)).collect();
        assert_eq!(kept.len(), voxels.len());
        let covered: std::collections::BTreeSet<_> = kept
            .iter()
            .map(|&i| points[i as usize].map(|v| v.floor() as i32))
            .collect();
        assert_eq!(covered, voxels);
    }
}
