//! Planes of a point cloud by random sample consensus, largest first, the inliers of each removed before the next.

use nalgebra::Vector3;
use rayon::prelude::*;

use crate::spatial::moments::Moments;

/// Edges (m) of the cells that the three points of a candidate are drawn from: nearby points share a plane far more
/// often than any three, and walls and floors differ in size.
const CELLS: [f32; 3] = [1.0, 4.0, 16.0];
/// Points on which every candidate is counted first.
const SCREENED: usize = 4096;
/// Candidates, best on those points, that are fitted and counted on all.
const FITTED: usize = 16;
/// Fits of a candidate to its own inliers.
const FITS: usize = 4;
/// Points a block: sums are taken block by block in order, whatever the number of threads.
const BLOCK: usize = 8192;

/// How planes are looked for.
#[derive(Clone, Copy, Debug)]
pub struct Search {
    /// Inliers lie within this of the plane (m).
    pub tolerance: f64,
    /// Candidates drawn for each plane.
    pub candidates: usize,
    /// Planes with fewer inliers end the search.
    pub least: usize,
    /// Planes looked for at the most.
    pub most: usize,
    pub seed: u64,
}

/// A plane `normal . x = distance`; the normal's sign is the one that makes the distance positive or zero.
#[derive(Clone, Debug)]
pub struct Plane {
    pub normal: [f64; 3],
    pub distance: f64,
    /// Standard deviation of the inliers across the plane (m).
    pub thickness: f64,
    /// Indices of the inliers, rising.
    pub inliers: Vec<u32>,
}

/// The planes, in the order in which they were found.
pub fn planes(points: &[[f32; 3]], search: &Search) -> Vec<Plane> {
    let mut left: Vec<u32> = (0..points.len() as u32)
        .filter(|&index| points[index as usize].iter().all(|v| v.is_finite()))
        .collect();
    let mut found = Vec::new();
    let least = search.least.max(3);
    while found.len() < search.most && left.len() >= least {
        let cloud: Vec<[f32; 3]> = left.iter().map(|&i| points[i as usize]).collect();
        let seed = search.seed ^ (found.len() as u64 + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        let Some(fit) = largest(&cloud, search, seed) else {
            break;
        };
        let (on, off): (Vec<usize>, Vec<usize>) =
            (0..cloud.len()).partition(|&i| fit.offset(&cloud[i]).abs() <= search.tolerance);
        if on.len() < least {
            break;
        }
        found.push(Plane {
            normal: fit.normal.into(),
            distance: fit.distance,
            thickness: fit.thickness,
            inliers: on.iter().map(|&i| left[i]).collect(),
        });
        left = off.iter().map(|&i| left[i]).collect();
    }
    found
}

#[derive(Clone, Copy)]
struct Fitted {
    normal: Vector3<f64>,
    distance: f64,
    thickness: f64,
}

impl Fitted {
    fn through(points: [[f32; 3]; 3]) -> Option<Self> {
        let [a, b, c] = points.map(|p| Vector3::from(p.map(f64::from)));
        let (u, v) = (b - a, c - a);
        let cross = u.cross(&v);
        // Points nearly on a line say nothing of a plane.
        if cross.norm() < 0.05 * u.norm() * v.norm() || cross.norm() == 0.0 {
            return None;
        }
        Some(Self::new(
            cross.normalize(),
            cross.normalize().dot(&a),
            f64::NAN,
        ))
    }

    fn new(normal: Vector3<f64>, distance: f64, thickness: f64) -> Self {
        let sign = if distance < 0.0 { -1.0 } else { 1.0 };
        Self {
            normal: normal * sign,
            distance: distance * sign,
            thickness,
        }
    }

    fn offset(&self, point: &[f32; 3]) -> f64 {
        self.normal.x * f64::from(point[0])
            + self.normal.y * f64::from(point[1])
            + self.normal.z * f64::from(point[2])
            - self.distance
    }

    fn count(&self, points: &[[f32; 3]], tolerance: f64) -> usize {
        points
            .iter()
            .filter(|p| self.offset(p).abs() <= tolerance)
            .count()
    }

    /// The plane of least squares through the inliers.
    fn fitted(&self, points: &[[f32; 3]], tolerance: f64) -> Option<Self> {
        let mut sums = Moments::default();
        for block in points.chunks(BLOCK) {
            let mut part = Moments::default();
            for point in block.iter().filter(|p| self.offset(p).abs() <= tolerance) {
                part.add(Vector3::from(point.map(f64::from)));
            }
            sums.merge(&part);
        }
        if sums.count < 3.0 {
            return None;
        }
        let axes = sums.axes();
        let normal = axes.directions[0];
        Some(Self::new(
            normal,
            normal.dot(&sums.mean()),
            axes.variances[0].sqrt(),
        ))
    }
}

/// The plane with most inliers among the candidates, each fitted to its own inliers.
fn largest(points: &[[f32; 3]], search: &Search, seed: u64) -> Option<Fitted> {
    let cells: Vec<Cells> = CELLS.iter().map(|&edge| Cells::new(points, edge)).collect();
    // Drawn, not every n-th: points come in an order that a stride could keep step with.
    let mut random = Random(seed);
    let screen: Vec<[f32; 3]> = if points.len() <= SCREENED {
        points.to_vec()
    } else {
        (0..SCREENED)
            .map(|_| points[random.below(points.len())])
            .collect()
    };
    let mut screened: Vec<(usize, usize, Fitted)> = (0..search.candidates)
        .into_par_iter()
        .filter_map(|number| {
            let mut random = Random(seed ^ (number as u64 + 1).wrapping_mul(0xd1b5_4a32_d192_ed03));
            let triple = cells[number % CELLS.len()].draw(points, &mut random)?;
            let plane = Fitted::through(triple)?;
            Some((plane.count(&screen, search.tolerance), number, plane))
        })
        .collect();
    screened.sort_unstable_by_key(|&(count, number, _)| (usize::MAX - count, number));
    screened.truncate(FITTED);
    let fitted: Vec<(usize, Fitted)> = screened
        .into_par_iter()
        .map(|(_, _, plane)| {
            let mut best = (plane.count(points, search.tolerance), plane);
            for _ in 0..FITS {
                let Some(plane) = best.1.fitted(points, search.tolerance) else {
                    break;
                };
                let count = plane.count(points, search.tolerance);
                // A fit replaces the three points that it began from even where it loses an inlier to them.
                if count < best.0 && !best.1.thickness.is_nan() {
                    break;
                }
                best = (count, plane);
            }
            best
        })
        .collect();
    fitted
        .into_iter()
        .reduce(|best, next| if next.0 > best.0 { next } else { best })
        .map(|best| best.1)
}

/// Points sorted into cells of one edge.
struct Cells {
    order: Vec<u32>,
    /// Of each place in `order`, where its cell begins and ends.
    bounds: Vec<(u32, u32)>,
}

impl Cells {
    fn new(points: &[[f32; 3]], edge: f32) -> Self {
        let mut keyed: Vec<([i32; 3], u32)> = points
            .iter()
            .enumerate()
            .map(|(index, p)| (p.map(|v| (v / edge).floor() as i32), index as u32))
            .collect();
        keyed.sort_unstable();
        let mut bounds = Vec::with_capacity(keyed.len());
        for run in keyed.chunk_by(|a, b| a.0 == b.0) {
            let start = bounds.len() as u32;
            bounds.extend(std::iter::repeat_n(
                (start, start + run.len() as u32),
                run.len(),
            ));
        }
        Self {
            order: keyed.iter().map(|k| k.1).collect(),
            bounds,
        }
    }

    /// Three different points of one cell; cells are drawn by their points.
    fn draw(&self, points: &[[f32; 3]], random: &mut Random) -> Option<[[f32; 3]; 3]> {
        let first = random.below(self.order.len());
        let (start, end) = self.bounds[first];
        let size = (end - start) as usize;
        if size < 3 {
            return None;
        }
        let mut places = [first, 0, 0];
        for k in 1..3 {
            places[k] = start as usize + random.below(size);
            if places[..k].contains(&places[k]) {
                return None;
            }
        }
        Some(places.map(|place| points[self.order[place] as usize]))
    }
}

/// `SplitMix64` (Steele, Lea, Flood 2014).
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// Below `bound`, which is far below 2^64, so that the remainder's bias is nothing.
    fn below(&mut self, bound: usize) -> usize {
        (self.next() % bound as u64) as usize
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SEARCH: Search = Search {
        tolerance: 0.03,
        candidates: 600,
        least: 100,
        most: 8,
        seed: 5,
    };

    /// A room corner: floor 8 x 6 m, walls 6 x 3 and 8 x 3 m, points on a grid of 0.1 m with 5 mm of noise, and clutter.
    fn corner() -> Vec<[f32; 3]> {
        let mut random = Random(1);
        let mut noise = || (random.below(10_001) as f32 / 10_000.0 - 0.5) * 0.017;
        let mut points = Vec::new();
        for i in 0..80 {
            for j in 0..60 {
                points.push([i as f32 * 0.1, j as f32 * 0.1, -1.5 + noise()]);
            }
        }
        for i in 0..80 {
            for k in 0..30 {
                points.push([i as f32 * 0.1, 6.0 + noise(), k as f32 * 0.1 - 1.5]);
            }
        }
        for j in 0..60 {
            for k in 0..30 {
                points.push([8.0 + noise(), j as f32 * 0.1, k as f32 * 0.1 - 1.5]);
            }
        }
        let mut random = Random(2);
        for _ in 0..1500 {
            points.push(std::array::from_fn(|_| random.below(6000) as f32 / 1000.0));
        }
        points
    }

    #[test]
    fn finds_the_planes_of_a_corner_largest_first() {
        let found = planes(&corner(), &SEARCH);
        assert!(found.len() >= 3);
        for (plane, (normal, distance, size)) in found.iter().zip([
            ([0.0, 0.0, -1.0], 1.5, 4800),
            ([0.0, 1.0, 0.0], 6.0, 2400),
            ([1.0, 0.0, 0.0], 8.0, 1800),
        ]) {
            let cosine: f64 = (0..3).map(|a| plane.normal[a] * normal[a]).sum();
            assert!(cosine > 0.99999, "{plane:?}");
            assert!((plane.distance - distance).abs() < 0.002);
            assert!(plane.inliers.len() * 100 > size * 95 && plane.inliers.len() < size + 200);
            assert!(plane.thickness < 0.01);
        }
        // No point is given twice.
        let mut all: Vec<u32> = found.iter().flat_map(|p| p.inliers.clone()).collect();
        let total = all.len();
        all.sort_unstable();
        all.dedup();
        assert_eq!(all.len(), total);
    }

    #[test]
    fn the_number_of_threads_does_not_show() {
        let points = corner();
        let run = |threads| {
            rayon::ThreadPoolBuilder::new()
                .num_threads(threads)
                .build()
                .expect("a pool")
                .install(|| planes(&points, &SEARCH))
        };
        let (one, three) = (run(1), run(3));
        assert_eq!(one.len(), three.len());
        for (a, b) in one.iter().zip(&three) {
            assert_eq!(a.normal, b.normal);
            assert_eq!(a.distance.to_bits(), b.distance.to_bits());
            assert_eq!(a.inliers, b.inliers);
        }
    }

    #[test]
    fn a_line_an_empty_cloud_and_numbers_that_are_none_give_no_plane() {
        let line: Vec<[f32; 3]> = (0..500).map(|i| [i as f32 * 0.01, 0.0, 0.0]).collect();
        assert!(planes(&line, &SEARCH).is_empty());
        assert!(planes(&[], &SEARCH).is_empty());
        assert!(planes(&[[f32::NAN; 3]; 200], &SEARCH).is_empty());
        assert!(planes(&[[1.0; 3]; 200], &SEARCH).is_empty());
    }
}
