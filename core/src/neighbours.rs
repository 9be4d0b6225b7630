//! Nearest neighbours within a fixed radius, by a hashed grid of cells.
//!
//! Queries of a pair are short-ranged, and most of them find nothing: a k-d tree walks far before it knows that. Eight
//! cells answer for sure whether a point lies within half a cell's edge.

use rustc_hash::FxHashMap;

/// Points sorted into cells.
pub struct NeighbourGrid {
    cell: f32,
    cells: FxHashMap<u64, (u32, u32)>,
    /// Point indices and points, cell by cell.
    order: Vec<u32>,
    points: Vec<[f32; 3]>,
}

fn key(index: [i32; 3]) -> u64 {
    index
        .iter()
        .fold(0, |key, &i| key << 21 | u64::from((i as u32) & 0x1f_ffff))
}

impl NeighbourGrid {
    /// A grid for queries up to `radius` (m).
    pub fn new(points: &[[f32; 3]], radius: f32) -> Self {
        let cell = 2.0 * radius;
        let mut keyed: Vec<(u64, u32)> = points
            .iter()
            .enumerate()
            .map(|(index, p)| (key(p.map(|v| (v / cell).floor() as i32)), index as u32))
            .collect();
        keyed.sort_unstable();
        let mut cells = FxHashMap::default();
        let mut start = 0;
        for run in keyed.chunk_by(|a, b| a.0 == b.0) {
            cells.insert(run[0].0, (start, start + run.len() as u32));
            start += run.len() as u32;
        }
        let order: Vec<u32> = keyed.iter().map(|k| k.1).collect();
        let points = order.iter().map(|&index| points[index as usize]).collect();
        Self {
            cell,
            cells,
            order,
            points,
        }
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
        let home = scaled.map(|v| v.floor() as i32);
        // The half of the cell that the point lies in says which neighbours its radius can touch.
        let side: [i32; 3] = std::array::from_fn(|axis| {
            if scaled[axis] - scaled[axis].floor() < 0.5 {
                -1
            } else {
                1
            }
        });
        let mut best = (radius * radius, u32::MAX);
        for corner in 0..8 {
            let index = std::array::from_fn(|axis| {
                home[axis]
                    + if corner >> axis & 1 == 1 {
                        side[axis]
                    } else {
                        0
                    }
            });
            let Some(&(start, end)) = self.cells.get(&key(index)) else {
                continue;
            };
            for slot in start as usize..end as usize {
                let other = self.points[slot];
                let d = [
                    other[0] - point[0],
                    other[1] - point[1],
                    other[2] - point[2],
                ];
                let squared = d[0] * d[0] + d[1] * d[1] + d[2] * d[2];
                if squared < best.0 || (squared == best.0 && self.order[slot] < best.1) {
                    best = (squared, self.order[slot]);
                }
            }
        }
        (best.1 != u32::MAX).then_some(best.1 as usize)
    }
}

/// Indices of points at least about `spacing` apart: of each voxel of that edge, the point nearest to the mean.
pub fn thinned(points: &[[f32; 3]], spacing: f32) -> Vec<u32> {
    let mut keyed: Vec<(u64, u32)> = points
        .iter()
        .enumerate()
        .map(|(index, p)| (key(p.map(|v| (v / spacing).floor() as i32)), index as u32))
        .collect();
    keyed.sort_unstable();
    let mut kept: Vec<u32> = keyed
        .chunk_by(|a, b| a.0 == b.0)
        .map(|run| {
            let mean: [f32; 3] = std::array::from_fn(|axis| {
                run.iter().map(|r| points[r.1 as usize][axis]).sum::<f32>() / run.len() as f32
            });
            let off = |index: u32| {
                points[index as usize]
                    .iter()
                    .zip(mean)
                    .map(|(v, m)| (v - m) * (v - m))
                    .sum::<f32>()
            };
            run.iter()
                .map(|r| r.1)
                .min_by(|&a, &b| off(a).total_cmp(&off(b)))
                .expect("a run has a point")
        })
        .collect();
    kept.sort_unstable();
    kept
}

#[cfg(test)]
mod tests {
    use super::*;

    fn scattered(count: usize, mut seed: u64) -> Vec<[f32; 3]> {
        let mut next = || {
            seed = seed
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            (seed >> 33) as f32 / (1_u64 << 31) as f32 * 10.0 - 5.0
        };
        (0..count).map(|_| [next(), next(), next()]).collect()
    }

    #[test]
    fn nearest_agrees_with_trying_every_point() {
        let points = scattered(2000, 1);
        let grid = NeighbourGrid::new(&points, 0.5);
        let mut found = 0;
        for query in scattered(1000, 2) {
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
        let points = scattered(5000, 3);
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
