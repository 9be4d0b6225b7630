//! Planar patches: connected surfels that lie on one plane.

use std::collections::VecDeque;

use nalgebra::Vector3;

use crate::scan::surfels::{SurfelGrid, neighbours};
use crate::spatial::moments::Moments;

/// Cosine of the largest angle between a surfel's normal and its patch's (15 degrees).
const SAME_NORMAL: f64 = 0.966;
/// Fewest surfels of a patch.
const FEWEST: usize = 6;

/// A planar patch, in scanner-centred coordinates.
#[derive(Clone, Copy)]
pub struct Patch {
    /// Unit normal, towards the scanner.
    pub normal: Vector3<f64>,
    /// Surface covered by surfels (m^2).
    pub area: f64,
}

/// Patches, largest first, and the patch of each surfel.
pub struct Patches {
    pub patches: Vec<Patch>,
    pub of_surfel: Vec<Option<u32>>,
}

/// Grows patches over neighbouring surfels, from the flattest surfel outwards.
///
/// A surfel joins while its normal is that of the patch and it lies within `3` times the thickness of the plane,
/// which is fitted anew as the patch grows. Patches under `least_area` (m^2) are dropped.
pub fn grow(grid: &SurfelGrid, least_area: f64) -> Patches {
    let surfels = &grid.surfels;
    let mut order: Vec<usize> = (0..surfels.len())
        .filter(|&i| surfels[i].is_planar())
        .collect();
    order.sort_by(|&a, &b| {
        surfels[a]
            .thickness
            .total_cmp(&surfels[b].thickness)
            .then(a.cmp(&b))
    });

    let mut taken = vec![false; surfels.len()];
    let mut found: Vec<(Patch, Vec<usize>)> = Vec::new();
    for seed in order {
        if taken[seed] {
            continue;
        }
        let members = grow_from(grid, seed, &taken);
        if members.len() < FEWEST {
            taken[seed] = true;
            continue;
        }
        for &member in &members {
            taken[member] = true;
        }
        let patch = describe(grid, &members);
        if patch.area >= least_area {
            found.push((patch, members));
        }
    }
    let mut of_surfel = vec![None; surfels.len()];
    for (index, (_, members)) in found.iter().enumerate() {
        for &member in members {
            of_surfel[member] = Some(index as u32);
        }
    }
    largest_first(Patches {
        patches: found.into_iter().map(|f| f.0).collect(),
        of_surfel,
    })
}

/// The same patches, in the order of their areas.
pub fn largest_first(found: Patches) -> Patches {
    let areas: Vec<f64> = found.patches.iter().map(|patch| patch.area).collect();
    let mut order: Vec<usize> = (0..areas.len()).collect();
    order.sort_by(|&a, &b| areas[b].total_cmp(&areas[a]));
    let mut place = vec![0; order.len()];
    for (to, &from) in order.iter().enumerate() {
        place[from] = to as u32;
    }
    Patches {
        patches: order.iter().map(|&from| found.patches[from]).collect(),
        of_surfel: (found.of_surfel.iter())
            .map(|patch| patch.map(|patch| place[patch as usize]))
            .collect(),
    }
}

fn grow_from(grid: &SurfelGrid, seed: usize, taken: &[bool]) -> Vec<usize> {
    let surfels = &grid.surfels;
    let origin = surfels[seed].centre;
    let mut moments = surfels[seed].moments;
    let (mut normal, mut mean) = (surfels[seed].normal, surfels[seed].point);
    let mut thickness = surfels[seed].thickness;
    let mut refit_at = 8;
    let mut members = vec![seed];
    let mut seen: rustc_hash::FxHashSet<usize> = [seed].into_iter().collect();
    let mut queue = VecDeque::from([seed]);
    while let Some(here) = queue.pop_front() {
        for other in neighbours().filter_map(|offset| grid.beside(here, offset)) {
            let surfel = &surfels[other];
            let most = (3.0 * thickness).max(0.04 * grid.size);
            if taken[other]
                || !surfel.is_planar()
                || surfel.normal.dot(&normal) < SAME_NORMAL
                || normal.dot(&(surfel.point - mean)).abs() > most
                || !seen.insert(other)
            {
                continue;
            }
            members.push(other);
            queue.push_back(other);
            moments.merge(&surfel.moments.shifted(surfel.centre - origin));
            if members.len() >= refit_at {
                refit_at = members.len() * 3 / 2;
                let axes = moments.axes();
                mean = origin + moments.mean();
                normal = if axes.directions[0].dot(&normal) < 0.0 {
                    -axes.directions[0]
                } else {
                    axes.directions[0]
                };
                thickness = axes.variances[0].sqrt();
            }
        }
    }
    members
}

fn describe(grid: &SurfelGrid, members: &[usize]) -> Patch {
    let origin = grid.surfels[members[0]].centre;
    let mut moments = Moments::default();
    for &member in members {
        let surfel = &grid.surfels[member];
        moments.merge(&surfel.moments.shifted(surfel.centre - origin));
    }
    let across = moments.axes().directions[0];
    let normal = if across.dot(&(origin + moments.mean())) > 0.0 {
        -across
    } else {
        across
    };
    // A plane cuts a voxel in its section: the mean section of a cube of edge 1, by a plane of this normal, is
    // 1 / (sum of |n|) times the chance of a hit; surfels per unit area are the sum of |n|.
    let area = members.len() as f64 * grid.size * grid.size / normal.abs().sum();
    Patch { normal, area }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scan::surfels::{Samples, sample};

    /// The inside of a box of 6 x 4 x 3 m seen from its middle, points every 2 cm.
    fn room() -> Vec<[f32; 3]> {
        let half = [3.0_f32, 2.0, 1.5];
        let mut xyz = vec![];
        for axis in 0..3 {
            let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
            for side in [-1.0, 1.0] {
                for i in 0..(100.0 * half[u]) as i32 {
                    for j in 0..(100.0 * half[v]) as i32 {
                        let mut p = [0.0; 3];
                        p[axis] = side * half[axis];
                        p[u] = -half[u] + 0.02 * (i as f32 + 0.5);
                        p[v] = -half[v] + 0.02 * (j as f32 + 0.5);
                        xyz.push(p);
                    }
                }
            }
        }
        xyz
    }

    #[test]
    fn a_room_has_six_patches_with_its_areas_and_planes() {
        let xyz = room();
        let skip = vec![false; xyz.len()];
        let grids = sample(
            &Samples {
                xyz: &xyz,
                skip: &skip,
                intensity: None,
                color: None,
                colored: None,
            },
            20_000,
            true,
        );
        let grid = &grids[0];
        let patches = grow(grid, 0.5);
        assert_eq!(patches.patches.len(), 6);
        let expected = [24.0, 24.0, 18.0, 18.0, 12.0, 12.0];
        for (patch, area) in patches.patches.iter().zip(expected) {
            assert!(
                (patch.area / area - 1.0).abs() < 0.12,
                "{} m^2 for {area}",
                patch.area
            );
            assert!(patch.normal.abs().max() > 0.9999);
        }
        for (surfel, &patch) in grid.surfels.iter().zip(&patches.of_surfel) {
            if let Some(patch) = patch {
                let normal = patches.patches[patch as usize].normal;
                let distance = normal.dot(&surfel.point);
                let wall = [3.0, 2.0, 1.5][normal.iamax()];
                assert!(
                    (distance + wall).abs() < 0.001,
                    "the normal looks at the scanner"
                );
            }
        }
    }
}
