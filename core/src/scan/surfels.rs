//! Surfels: an even sampling of what a station saw, one surfel a voxel, each with its local plane.

use nalgebra::Vector3;
use rayon::prelude::*;
use rustc_hash::{FxHashMap, FxHashSet};

use crate::scan::range_image::median;
use crate::spatial::moments::{Axes, Moments};

/// Edge of the finest voxels (m); every coarser level doubles it.
const FINEST_VOXEL: f64 = 0.0125;
/// Bits an axis: voxels reach 13 km to either side of the scanner.
const BITS: u32 = 21;
/// A plane is fitted to at least this many points.
const SUPPORT: f64 = 8.0;
/// Standard deviation across a surfel over that along it, beyond which it is no plane.
const PLANE_RATIO: f64 = 0.2;
/// The same for surfels of wider voxels, where leaves could pass for a plane.
const SPARSE_PLANE_RATIO: f64 = 0.05;
/// Standard deviation along the shorter side of a plane, in edges of a voxel, below which it is one row of beams: on far
/// ground, where ranges scatter along the beams.
const LEAST_WIDTH: f64 = 0.15;
/// How often voxels are doubled for what has no plane.
const WIDER_LEVELS: u32 = 4;
/// Edge of the widest voxels (m).
const WIDEST_VOXEL: f64 = 0.5;
/// Of the points that lie on planes on any wider voxels, so many lie on planes on voxels that are wide enough.
const ON_PLANES: f64 = 0.85;
/// The planes of voxels that are wide enough are this much thinner than planes may be, by their median: on finer ones
/// only what is flat by chance is left of a noisy surface.
const THINNER: f64 = 2.0;
/// Standard deviation along a side of a voxel and its neighbours, in edges of one (a block of three is filled evenly).
const EXTENT: f64 = 0.866;

/// Points that are worked on together.
const CHUNK: usize = 1 << 16;

/// What a surfel is sampled from, in scanner-centred coordinates.
pub struct Samples<'a> {
    pub xyz: &'a [[f32; 3]],
    /// Points to leave out: those of no surface.
    pub skip: &'a [bool],
    pub intensity: Option<&'a [f32]>,
    pub color: Option<&'a [[u8; 3]]>,
    /// Points whose colour is known; all of them where this is absent.
    pub colored: Option<&'a [bool]>,
}

/// One surfel.
#[derive(Clone, Copy, Debug)]
pub struct Surfel {
    /// Centroid of the voxel's points, moved onto the local plane if there is one.
    pub point: Vector3<f64>,
    /// Unit normal of the local plane, towards the scanner; zero where the surface is no plane.
    pub normal: Vector3<f64>,
    /// Standard deviation of the points across the plane, of one row of beams that of its ranges (m).
    pub thickness: f64,
    /// Points that the plane rests on.
    pub support: f64,
    /// Points in the voxel.
    pub count: f64,
    /// Mean intensity and colour of the voxel's points, 0..1; NaN where none of them has any.
    pub intensity: f32,
    pub color: [f32; 3],
    /// Sums of the voxel's points about `point - offset`, for larger planes.
    pub moments: Moments,
    /// Centre that `moments` refer to.
    pub centre: Vector3<f64>,
}

impl Surfel {
    pub fn is_planar(&self) -> bool {
        self.normal != Vector3::zeros()
    }
}

/// The even sampling of one scan.
pub struct SurfelGrid {
    /// Edge of the voxels (m).
    pub size: f64,
    pub surfels: Vec<Surfel>,
    cells: FxHashMap<[i32; 3], u32>,
    keys: Vec<[i32; 3]>,
}

impl SurfelGrid {
    /// The surfel in the voxel at `offset` voxels from that of `index`.
    pub fn beside(&self, index: usize, offset: [i32; 3]) -> Option<usize> {
        let key = self.keys[index];
        let key = [key[0] + offset[0], key[1] + offset[1], key[2] + offset[2]];
        self.cells.get(&key).map(|&found| found as usize)
    }
}

/// The 26 voxels around one.
pub fn neighbours() -> impl Iterator<Item = [i32; 3]> {
    (-1..=1)
        .flat_map(|x| (-1..=1).flat_map(move |y| (-1..=1).map(move |z| [x, y, z])))
        .filter(|&offset| offset != [0, 0, 0])
}

/// Samples a scan with at most `target` surfels, on the finest voxels that allow it, that hold 1.1 points or more on
/// average and that are wide enough, where sound normals are asked for, for the scan's noise and spacing; and again, what
/// has no plane there, on voxels of twice the size and so on.
///
/// Far walls and floors that are seen at a grazing angle have few points: wider voxels find their planes. The second part
/// holds only surfels with a plane, from all the wider voxels.
pub fn sample(samples: &Samples, target: usize, sound_normals: bool) -> Vec<SurfelGrid> {
    let mut points: Vec<u32> = (0..samples.xyz.len() as u32)
        .into_par_iter()
        .filter(|&point| !samples.skip[point as usize] && in_range(samples.xyz[point as usize]))
        .collect();
    let mut codes = codes_of(samples, &points);
    let (finest, mut runs, base) =
        finest_with_planes(samples, &points, &codes, target, sound_normals);
    let mut grids = vec![base];
    for level in (finest + 1..=finest + WIDER_LEVELS).filter(|&level| edge(level) <= WIDEST_VOXEL) {
        points = without_plane(&runs, &grids[grids.len() - 1].surfels);
        codes = codes_of(samples, &points);
        runs = Runs::new(&points, codes, level);
        grids.push(sample_at(samples, &runs, level, SPARSE_PLANE_RATIO));
    }
    grids
}

/// Edge of the voxels of a level (m).
fn edge(level: u32) -> f64 {
    FINEST_VOXEL * f64::from(1_u32 << level)
}

/// The finest voxels on which enough of the points lie on planes, of those that `target` allows.
fn finest_with_planes(
    samples: &Samples,
    points: &[u32],
    codes: &[u64],
    target: usize,
    sound_normals: bool,
) -> (u32, Runs, SurfelGrid) {
    let allowed = choose_level(codes, target);
    let levels = allowed..BITS;
    let mut tried = Vec::new();
    for level in levels.take_while(|&level| level == allowed || edge(level) <= WIDEST_VOXEL) {
        let runs = Runs::new(points, codes.to_vec(), level);
        let grid = sample_at(samples, &runs, level, PLANE_RATIO);
        let (share, sound) = planarity(&grid, points.len());
        tried.push((share, sound, (level, runs, grid)));
        if !sound_normals || sound && share >= ON_PLANES {
            break;
        }
    }
    let most = tried.iter().map(|one| one.0).fold(0.0, f64::max);
    let enough = (tried.iter()).position(|&(share, sound, _)| sound && share >= ON_PLANES * most);
    // Where no voxels are wide enough, those with the most on planes.
    let best = enough.or_else(|| tried.iter().position(|one| one.0 == most));
    tried
        .swap_remove(best.expect("one level at least was tried"))
        .2
}

/// The share of the points that lie on planes, and whether those are thin enough to be made of surface.
fn planarity(grid: &SurfelGrid, points: usize) -> (f64, bool) {
    let planar = || grid.surfels.iter().filter(|surfel| surfel.is_planar());
    let on_planes: f64 = planar().map(|surfel| surfel.count).sum();
    let mut thickness: Vec<f64> = planar().map(|surfel| surfel.thickness).collect();
    let thickest = PLANE_RATIO * EXTENT * grid.size;
    (
        on_planes / points.max(1) as f64,
        THINNER * median(&mut thickness) <= thickest,
    )
}

/// The points of the surfels that have no plane; surfels are in the order of their runs.
fn without_plane(runs: &Runs, surfels: &[Surfel]) -> Vec<u32> {
    (runs.iter().zip(surfels))
        .filter(|(_, surfel)| !surfel.is_planar())
        .flat_map(|(run, _)| run.iter().copied())
        .collect()
}

fn sample_at(samples: &Samples, runs: &Runs, level: u32, plane_ratio: f64) -> SurfelGrid {
    let size = edge(level);
    let sampled: Vec<([i32; 3], Surfel)> = (0..runs.len())
        .into_par_iter()
        .map(|voxel| voxel_surfel(samples, runs.of(voxel), level, size))
        .collect();
    let keys: Vec<[i32; 3]> = sampled.iter().map(|e| e.0).collect();
    let cells = keys
        .iter()
        .enumerate()
        .map(|(index, &key)| (key, index as u32))
        .collect();
    let mut grid = SurfelGrid {
        size,
        surfels: sampled.into_iter().map(|e| e.1).collect(),
        cells,
        keys,
    };

    let planes: Vec<Result<LocalPlane, f64>> = (0..grid.surfels.len())
        .into_par_iter()
        .map(|index| {
            local_plane(&grid, index, plane_ratio)
                .ok_or_else(|| grid.surfels[index].moments.axes().variances[0].sqrt())
        })
        .collect();
    for (surfel, plane) in grid.surfels.iter_mut().zip(planes) {
        let plane = match plane {
            Ok(plane) => plane,
            Err(thickness) => {
                surfel.thickness = thickness;
                continue;
            }
        };
        surfel.point -= plane.normal * plane.normal.dot(&(surfel.point - plane.mean));
        surfel.normal = plane.normal;
        surfel.thickness = plane.thickness;
        surfel.support = plane.support;
    }
    grid
}

/// Interleaves the bits of the voxel's indices, so that a parent voxel is a run of its children.
fn morton(index: [u32; 3]) -> u64 {
    let spread = |v: u32| {
        let mut x = u64::from(v) & 0x1f_ffff;
        x = (x | x << 32) & 0x1f_0000_0000_ffff;
        x = (x | x << 16) & 0x1f_0000_ff00_00ff;
        x = (x | x << 8) & 0x100f_00f0_0f00_f00f;
        x = (x | x << 4) & 0x10c3_0c30_c30c_30c3;
        (x | x << 2) & 0x1249_2492_4924_9249
    };
    spread(index[0]) | spread(index[1]) << 1 | spread(index[2]) << 2
}

fn voxel_index(p: [f32; 3]) -> [i32; 3] {
    p.map(|v| (f64::from(v) / FINEST_VOXEL).floor() as i32)
}

fn in_range(p: [f32; 3]) -> bool {
    let half = FINEST_VOXEL * f64::from(1 << (BITS - 1));
    p.iter().all(|&v| f64::from(v).abs() < half - FINEST_VOXEL)
}

/// Code of the finest voxel that each point lies in.
fn codes_of(samples: &Samples, points: &[u32]) -> Vec<u64> {
    let code = |&point: &u32| {
        let voxel = voxel_index(samples.xyz[point as usize]);
        morton(voxel.map(|v| (v + (1 << (BITS - 1))) as u32))
    };
    points.par_iter().map(code).collect()
}

/// Finest level whose voxels are at most `target` and hold 1.1 points or more on average.
fn choose_level(codes: &[u64], target: usize) -> u32 {
    let most = target.min(codes.len() * 10 / 11);
    let (mut coarsest, mut finest) = (BITS - 1, 0);
    while finest < coarsest {
        let level = (finest + coarsest) / 2;
        if distinct(codes, level, most).is_some() {
            coarsest = level;
        } else {
            finest = level + 1;
        }
    }
    finest
}

/// The voxels of a level that have points; `None` if there are more than `most`.
fn distinct(codes: &[u64], level: u32, most: usize) -> Option<FxHashSet<u64>> {
    let in_chunk = |codes: &[u64]| {
        let mut voxels = FxHashSet::default();
        let mut last = None;
        for code in codes {
            let voxel = code >> (3 * level);
            // Neighbours in a file are neighbours in space.
            if last.replace(voxel) != Some(voxel) && voxels.insert(voxel) && voxels.len() > most {
                return None;
            }
        }
        Some(voxels)
    };
    codes
        .par_chunks(CHUNK)
        .map(in_chunk)
        .try_reduce(FxHashSet::default, |mut a, b| {
            a.extend(b);
            (a.len() <= most).then_some(a)
        })
}

/// Points by voxel, in the order of the voxels' codes.
struct Runs {
    points: Vec<u32>,
    /// Where the points of each voxel begin, and their number at the end.
    starts: Vec<usize>,
}

impl Runs {
    fn new(points: &[u32], codes: Vec<u64>, level: u32) -> Self {
        let found = distinct(&codes, level, usize::MAX).unwrap_or_default();
        let mut voxels: Vec<u64> = found.into_iter().collect();
        voxels.par_sort_unstable();
        let place: FxHashMap<u64, u32> = voxels.iter().copied().zip(0..).collect();
        let mut places = vec![0_u32; points.len()];
        let chunks = places.par_chunks_mut(CHUNK).zip(codes.par_chunks(CHUNK));
        chunks.for_each(|(places, codes)| {
            let mut last = (u64::MAX, 0);
            for (found, code) in places.iter_mut().zip(codes) {
                let voxel = code >> (3 * level);
                if voxel != last.0 {
                    last = (voxel, place[&voxel]);
                }
                *found = last.1;
            }
        });
        drop(codes);
        let mut starts = vec![0; voxels.len() + 1];
        for &place in &places {
            starts[place as usize + 1] += 1;
        }
        for voxel in 1..starts.len() {
            starts[voxel] += starts[voxel - 1];
        }
        let mut next = starts.clone();
        let mut sorted = vec![0; points.len()];
        for (&point, place) in points.iter().zip(places) {
            let at = &mut next[place as usize];
            sorted[*at] = point;
            *at += 1;
        }
        Self {
            points: sorted,
            starts,
        }
    }

    fn len(&self) -> usize {
        self.starts.len() - 1
    }

    fn of(&self, voxel: usize) -> &[u32] {
        &self.points[self.starts[voxel]..self.starts[voxel + 1]]
    }

    fn iter(&self) -> impl Iterator<Item = &[u32]> {
        (0..self.len()).map(|voxel| self.of(voxel))
    }
}

fn voxel_surfel(samples: &Samples, run: &[u32], level: u32, size: f64) -> ([i32; 3], Surfel) {
    let key = voxel_index(samples.xyz[run[0] as usize]).map(|v| v >> level);
    let centre = Vector3::from(key.map(|v| (f64::from(v) + 0.5) * size));
    let mut moments = Moments::default();
    let mut intensity = 0.0_f64;
    let (mut color, mut shown) = ([0.0_f64; 3], 0.0);
    for &index in run {
        let index = index as usize;
        moments.add(Vector3::from(samples.xyz[index].map(f64::from)) - centre);
        intensity += samples
            .intensity
            .map_or(f64::NAN, |values| f64::from(values[index]));
        if let Some(values) = samples.color
            && samples.colored.is_none_or(|colored| colored[index])
        {
            shown += 1.0;
            for (sum, channel) in color.iter_mut().zip(values[index]) {
                *sum += f64::from(channel) / 255.0;
            }
        }
    }
    let count = moments.count;
    let surfel = Surfel {
        point: centre + moments.mean(),
        normal: Vector3::zeros(),
        thickness: f64::NAN,
        support: count,
        count,
        intensity: (intensity / count) as f32,
        color: color.map(|sum| (sum / shown) as f32),
        moments,
        centre,
    };
    (key, surfel)
}

struct LocalPlane {
    mean: Vector3<f64>,
    normal: Vector3<f64>,
    thickness: f64,
    support: f64,
}

/// The plane through a surfel and those of its neighbours that lie on it.
///
/// A first plane comes from the voxel alone where its points allow it, else from all 27 voxels; neighbours that stray
/// from it by more than its own thickness allows belong to another surface and are left out of the second.
fn local_plane(grid: &SurfelGrid, index: usize, plane_ratio: f64) -> Option<LocalPlane> {
    let own = &grid.surfels[index];
    let around: Vec<usize> = neighbours()
        .filter_map(|offset| grid.beside(index, offset))
        .collect();
    let gather = |chosen: &dyn Fn(&Surfel) -> bool| {
        let mut moments = own.moments;
        for &other in &around {
            let other = &grid.surfels[other];
            if chosen(other) {
                moments.merge(&other.moments.shifted(other.centre - own.centre));
            }
        }
        moments
    };
    let mut moments = own.moments;
    let mut axes = moments.axes();
    let wide_enough = |axes: &Axes| axes.variances[1].sqrt() > LEAST_WIDTH * grid.size;
    if moments.count < SUPPORT || !wide_enough(&axes) || !is_plane(&axes, plane_ratio) {
        moments = gather(&|_| true);
        if moments.count < SUPPORT {
            return None;
        }
        axes = moments.axes();
    }
    for _ in 0..2 {
        let (mean, normal) = (own.centre + moments.mean(), axes.directions[0]);
        let most = (3.0 * axes.variances[0].sqrt()).max(0.05 * grid.size);
        moments = gather(&|other: &Surfel| {
            normal
                .dot(&(other.centre + other.moments.mean() - mean))
                .abs()
                < most
        });
        axes = moments.axes();
    }
    if moments.count < SUPPORT || !is_plane(&axes, plane_ratio) || !axes.variances[0].is_finite() {
        return None;
    }
    let mean = own.centre + moments.mean();
    let normal = axes.directions[0];
    let normal = if normal.dot(&mean) > 0.0 {
        -normal
    } else {
        normal
    };
    // A row leans as its ranges scatter, so its height is known no better than they are.
    let variance = axes.variances[usize::from(!wide_enough(&axes))];
    // Three parameters of the plane were taken from the same points.
    let thickness = (variance * moments.count / (moments.count - 3.0)).sqrt();
    Some(LocalPlane {
        mean,
        normal,
        thickness,
        support: moments.count,
    })
}

fn is_plane(axes: &Axes, ratio: f64) -> bool {
    axes.variances[1] > 0.0 && axes.variances[0] < ratio * ratio * axes.variances[1]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn noise(seed: &mut u64) -> f64 {
        // Sum of uniforms from a 64-bit LCG: near enough to normal for a test of averages.
        (0..12)
            .map(|_| {
                *seed = seed
                    .wrapping_mul(6_364_136_223_846_793_005)
                    .wrapping_add(1_442_695_040_888_963_407);
                (*seed >> 33) as f64 / (1_u64 << 31) as f64
            })
            .sum::<f64>()
            - 6.0
    }

    fn wall(points: usize, sigma: f64) -> Vec<[f32; 3]> {
        let mut seed = 7;
        let side = (points as f64).sqrt() as usize;
        (0..side * side)
            .map(|i| {
                let (u, v) = (
                    (i / side) as f64 / side as f64,
                    (i % side) as f64 / side as f64,
                );
                [
                    4.0 * u - 2.0,
                    (3.0 + sigma * noise(&mut seed)),
                    3.0 * v - 1.5,
                ]
                .map(|x| x as f32)
            })
            .collect()
    }

    /// The finest surfels, and those of wider voxels.
    fn sampled(xyz: &[[f32; 3]], target: usize) -> (SurfelGrid, Vec<Surfel>) {
        let mut grids = sample(
            &Samples {
                xyz,
                skip: &vec![false; xyz.len()],
                intensity: None,
                color: None,
                colored: None,
            },
            target,
            true,
        );
        let wider = grids[1..].iter().flat_map(|grid| &grid.surfels);
        let sparse = wider.filter(|s| s.is_planar()).copied().collect();
        (grids.swap_remove(0), sparse)
    }

    #[test]
    fn a_noisy_wall_becomes_surfels_on_the_wall_that_face_the_scanner() {
        let xyz = wall(200_000, 0.002);
        let (grid, _) = sampled(&xyz, 5_000);
        assert!(grid.surfels.len() <= 5_000 && grid.surfels.len() > 500);
        let planar: Vec<&Surfel> = grid.surfels.iter().filter(|e| e.is_planar()).collect();
        assert!(planar.len() as f64 > 0.95 * grid.surfels.len() as f64);
        let offset = planar.iter().map(|e| e.point.y - 3.0).sum::<f64>() / planar.len() as f64;
        assert!(
            offset.abs() < 3e-5,
            "the mean of 200,000 points of 2 mm noise: {offset}"
        );
        for surfel in &planar {
            assert!((surfel.point.y - 3.0).abs() < 0.001);
            assert!(
                surfel.normal.y < -0.999,
                "towards the scanner at the origin"
            );
        }
        let mut thickness: Vec<f64> = planar.iter().map(|e| e.thickness).collect();
        assert!((crate::scan::range_image::median(&mut thickness) - 0.002).abs() < 2e-4);
    }

    #[test]
    fn every_point_is_in_one_surfel_and_the_order_of_points_does_not_matter() {
        let xyz = wall(20_000, 0.01);
        let (forward, _) = sampled(&xyz, 3_000);
        let reversed: Vec<[f32; 3]> = xyz.iter().rev().copied().collect();
        let (backward, _) = sampled(&reversed, 3_000);
        assert_eq!(
            forward.surfels.iter().map(|e| e.count).sum::<f64>(),
            xyz.len() as f64
        );
        assert_eq!(forward.surfels.len(), backward.surfels.len());
        for (a, b) in forward.surfels.iter().zip(&backward.surfels) {
            assert!((a.point - b.point).norm() < 1e-9);
        }
    }

    #[test]
    fn thinly_seen_surface_gets_wider_surfels() {
        // A floor seen at a grazing angle: dense near the scanner, a point every 30 cm far away.
        let mut xyz = vec![];
        for i in 0..400 {
            for j in 0..100 {
                xyz.push([1.0 + 0.01 * i as f32, 0.02 * j as f32, -1.7]);
            }
        }
        for i in 0..40 {
            for j in 0..10 {
                xyz.push([6.0 + 0.3 * i as f32, 0.2 * j as f32, -1.7]);
            }
        }
        let (base, sparse) = sampled(&xyz, 20_000);
        assert!(
            base.surfels
                .iter()
                .filter(|e| e.is_planar())
                .all(|e| e.point.x < 5.2)
        );
        let far: Vec<&Surfel> = sparse.iter().filter(|e| e.point.x > 6.0).collect();
        assert!(far.len() > 40, "{}", far.len());
        assert!(
            far.iter()
                .all(|e| e.normal.z > 0.9999 && (e.point.z + 1.7).abs() < 1e-4)
        );
    }

    #[test]
    fn one_row_of_beams_tells_heights_no_better_than_its_ranges() {
        // Rows of beams are farther apart than the voxels there; ranges scatter along the beams, nearly along the ground.
        let (step, mut seed) = (0.25_f64.to_radians(), 3);
        let mut xyz = vec![];
        for row in 16..120 {
            for column in 0..240 {
                let (down, around) = (step * f64::from(row), step * f64::from(column));
                let range = 1.7 / down.sin() + 0.002 * noise(&mut seed);
                let across = range * down.cos();
                let point = [
                    across * around.cos(),
                    across * around.sin(),
                    -range * down.sin(),
                ];
                xyz.push(point.map(|x| x as f32));
            }
        }
        let samples = Samples {
            xyz: &xyz,
            skip: &vec![false; xyz.len()],
            intensity: None,
            color: None,
            colored: None,
        };
        let points: Vec<u32> = (0..xyz.len() as u32).collect();
        let runs = Runs::new(&points, codes_of(&samples, &points), 3);
        let grid = sample_at(&samples, &runs, 3, PLANE_RATIO);
        let leaning: Vec<&Surfel> = grid
            .surfels
            .iter()
            .filter(|e| e.is_planar() && e.normal.z < 0.999)
            .collect();
        assert!(leaning.len() > 100, "{}", leaning.len());
        for surfel in leaning {
            assert!(surfel.thickness > 0.0005, "{}", surfel.thickness);
        }
    }

    #[test]
    fn normals_are_made_of_surface_however_noisy_the_scanner() {
        // Points 1 cm apart: on voxels of that size a scanner of 15 mm has no planes but by chance.
        for (sigma, widest) in [(0.001, 0.05), (0.015, 0.4)] {
            let xyz = wall(100_000, sigma);
            let (base, _) = sampled(&xyz, 120_000);
            assert!(base.size <= widest, "{sigma}: {} m", base.size);
            let planar: Vec<&Surfel> = base.surfels.iter().filter(|e| e.is_planar()).collect();
            let on_planes: f64 = planar.iter().map(|e| e.count).sum();
            assert!(
                on_planes > 0.8 * xyz.len() as f64,
                "{sigma}: {on_planes} on planes"
            );
            let mut off: Vec<f64> = (planar.iter())
                .map(|e| e.normal.y.abs().min(1.0).acos().to_degrees())
                .collect();
            assert!(median(&mut off) < 3.0, "{sigma}: {} deg", median(&mut off));
            let mut thickness: Vec<f64> = planar.iter().map(|e| e.thickness).collect();
            let told = median(&mut thickness) / sigma;
            assert!(
                (0.8..1.2).contains(&told),
                "{sigma}: noise {told} of the true one"
            );
        }
    }

    #[test]
    fn no_points_no_surfels() {
        assert!(sampled(&[], 100).0.surfels.is_empty());
        assert_eq!(sampled(&[[1.0, 2.0, 3.0]], 100).0.surfels.len(), 1);
    }
}
