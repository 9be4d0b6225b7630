//! Planar patches: connected surface elements that lie on one plane.

use std::collections::VecDeque;

use nalgebra::{Matrix3, Vector3};

use crate::scan::surfels::{Surfels, neighbours};
use crate::spatial::moments::Moments;

/// No patch.
pub const NO_PATCH: u32 = u32::MAX;

/// Cosine of the largest angle between an element's normal and its patch's (15 degrees).
const SAME_NORMAL: f64 = 0.966;
/// Fewest elements of a patch.
const FEWEST: usize = 6;

/// A planar patch, in scanner-centred coordinates: `normal . x = distance`.
pub struct Patch {
    /// Unit normal, towards the scanner.
    pub normal: Vector3<f64>,
    pub distance: f64,
    pub centroid: Vector3<f64>,
    /// Covariance of (rotation about the two in-plane axes through the centroid, distance there), as a 3x3 in the basis
    /// (`along[0]`, `along[1]`, normal).
    pub covariance: Matrix3<f64>,
    /// In-plane axes, shorter spread first.
    pub along: [Vector3<f64>; 2],
    /// Surface covered by elements (m^2).
    pub area: f64,
    /// Standard deviation of the points across the plane (m).
    pub thickness: f64,
    /// Corners of the convex outline, counter-clockwise seen from the scanner's side.
    pub outline: Vec<Vector3<f64>>,
    pub intensity: f32,
    pub color: [f32; 3],
}

/// Patches, largest first, and the patch of each element (`NO_PATCH` for none).
pub struct Patches {
    pub patches: Vec<Patch>,
    pub of_element: Vec<u32>,
}

/// Grows patches over neighbouring elements, from the flattest element outwards.
///
/// An element joins while its normal is that of the patch and it lies within `3` times the thickness of the plane,
/// which is fitted anew as the patch grows. Patches under `least_area` (m^2) are dropped.
pub fn grow(surfels: &Surfels, least_area: f64) -> Patches {
    let elements = &surfels.elements;
    let mut order: Vec<usize> = (0..elements.len())
        .filter(|&i| elements[i].is_planar())
        .collect();
    order.sort_by(|&a, &b| {
        elements[a]
            .thickness
            .total_cmp(&elements[b].thickness)
            .then(a.cmp(&b))
    });

    let mut taken = vec![false; elements.len()];
    let mut found: Vec<(Patch, Vec<usize>)> = Vec::new();
    for seed in order {
        if taken[seed] {
            continue;
        }
        let members = grow_from(surfels, seed, &taken);
        if members.len() < FEWEST {
            taken[seed] = true;
            continue;
        }
        for &member in &members {
            taken[member] = true;
        }
        let patch = describe(surfels, &members);
        if patch.area >= least_area {
            found.push((patch, members));
        }
    }
    found.sort_by(|a, b| b.0.area.total_cmp(&a.0.area).then(a.1[0].cmp(&b.1[0])));
    let mut of_element = vec![NO_PATCH; elements.len()];
    for (index, (_, members)) in found.iter().enumerate() {
        for &member in members {
            of_element[member] = index as u32;
        }
    }
    Patches {
        patches: found.into_iter().map(|f| f.0).collect(),
        of_element,
    }
}

fn grow_from(surfels: &Surfels, seed: usize, taken: &[bool]) -> Vec<usize> {
    let elements = &surfels.elements;
    let origin = elements[seed].centre;
    let mut moments = elements[seed].moments;
    let (mut normal, mut mean) = (elements[seed].normal, elements[seed].point);
    let mut thickness = elements[seed].thickness;
    let mut refit_at = 8;
    let mut members = vec![seed];
    let mut seen: rustc_hash::FxHashSet<usize> = [seed].into_iter().collect();
    let mut queue = VecDeque::from([seed]);
    while let Some(here) = queue.pop_front() {
        for other in neighbours().filter_map(|offset| surfels.beside(here, offset)) {
            let element = &elements[other];
            let reach = (3.0 * thickness).max(0.04 * surfels.size);
            if taken[other]
                || !element.is_planar()
                || element.normal.dot(&normal) < SAME_NORMAL
                || normal.dot(&(element.point - mean)).abs() > reach
                || !seen.insert(other)
            {
                continue;
            }
            members.push(other);
            queue.push_back(other);
            moments.merge(&element.moments.shifted(element.centre - origin));
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

fn describe(surfels: &Surfels, members: &[usize]) -> Patch {
    let elements = &surfels.elements;
    let origin = elements[members[0]].centre;
    let mut moments = Moments::default();
    let (mut weight, mut intensity) = (0.0, 0.0);
    let (mut color, mut shown) = ([0.0; 3], 0.0);
    for &member in members {
        let element = &elements[member];
        moments.merge(&element.moments.shifted(element.centre - origin));
        weight += element.count;
        intensity += element.count * f64::from(element.intensity);
        if element.color[0].is_finite() {
            shown += element.count;
            for (sum, &channel) in color.iter_mut().zip(&element.color) {
                *sum += element.count * f64::from(channel);
            }
        }
    }
    let axes = moments.axes();
    let centroid = origin + moments.mean();
    let normal = if axes.directions[0].dot(&centroid) > 0.0 {
        -axes.directions[0]
    } else {
        axes.directions[0]
    };
    let along = [axes.directions[1], axes.directions[2]];
    // A plane cuts a voxel in its section: the mean section of a cube of edge 1, by a plane of this normal, is
    // 1 / (sum of |n|) times the chance of a hit; elements per unit area are the sum of |n|.
    let area = members.len() as f64 * surfels.size * surfels.size / normal.abs().sum();
    let variance = axes.variances[0].max(1e-10);
    // Rotation about along[0] lifts points by their reach along along[1], and the other way round.
    let covariance = Matrix3::from_diagonal(&Vector3::new(
        variance / (moments.count * axes.variances[2]),
        variance / (moments.count * axes.variances[1]),
        variance / moments.count,
    ));
    let flat: Vec<[f64; 2]> = members
        .iter()
        .map(|&m| elements[m].point - centroid)
        .map(|d| [d.dot(&along[0]), d.dot(&along[1])])
        .collect();
    let facing = along[0].cross(&along[1]).dot(&normal) > 0.0;
    let mut outline: Vec<Vector3<f64>> = convex_hull(flat)
        .into_iter()
        .map(|[u, v]| centroid + along[0] * u + along[1] * v)
        .collect();
    if !facing {
        outline.reverse();
    }
    Patch {
        normal,
        distance: normal.dot(&centroid),
        centroid,
        covariance,
        along,
        area,
        thickness: variance.sqrt(),
        outline,
        intensity: (intensity / weight) as f32,
        color: color.map(|sum| (sum / shown) as f32),
    }
}

/// Andrew's monotone chain, counter-clockwise.
fn convex_hull(mut points: Vec<[f64; 2]>) -> Vec<[f64; 2]> {
    points.sort_by(|a, b| a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1])));
    points.dedup();
    if points.len() < 3 {
        return points;
    }
    let turn = |a: [f64; 2], b: [f64; 2], c: [f64; 2]| {
        (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
    };
    let chain = |ordered: &mut dyn Iterator<Item = [f64; 2]>| {
        let mut hull: Vec<[f64; 2]> = Vec::new();
        for point in ordered {
            while hull.len() >= 2 && turn(hull[hull.len() - 2], hull[hull.len() - 1], point) <= 0.0
            {
                hull.pop();
            }
            hull.push(point);
        }
        hull.pop();
        hull
    };
    let mut hull = chain(&mut points.iter().copied());
    hull.extend(chain(&mut points.iter().rev().copied()));
    hull
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
        let (surfels, _) = sample(
            &Samples {
                xyz: &xyz,
                skip: &skip,
                intensity: None,
                color: None,
                colored: None,
            },
            20_000,
        );
        let patches = grow(&surfels, 0.5);
        assert_eq!(patches.patches.len(), 6);
        let expected = [24.0, 24.0, 18.0, 18.0, 12.0, 12.0];
        for (patch, area) in patches.patches.iter().zip(expected) {
            assert!(
                (patch.area / area - 1.0).abs() < 0.12,
                "{} m^2 for {area}",
                patch.area
            );
            assert!(patch.normal.abs().max() > 0.9999);
            assert!(patch.distance < 0.0, "the normal looks at the scanner");
            let n = patch.outline.len();
            let doubled: Vector3<f64> = (0..n)
                .map(|i| {
                    (patch.outline[i] - patch.centroid)
                        .cross(&(patch.outline[(i + 1) % n] - patch.centroid))
                })
                .sum();
            // The outline joins the elements' centres; elements in the corners of the room are no planes.
            let least = 1.0 - 5.0 * surfels.size / area.sqrt();
            let enclosed = doubled.dot(&patch.normal) / 2.0 / area;
            assert!(
                enclosed > least && enclosed <= 1.0,
                "the outline turns about the normal: {enclosed} of {area}"
            );
        }
    }

    #[test]
    fn the_hull_of_a_square_is_its_corners() {
        let mut points = vec![];
        for i in 0..5 {
            for j in 0..5 {
                points.push([f64::from(i), f64::from(j)]);
            }
        }
        assert_eq!(
            convex_hull(points),
            [[0.0, 0.0], [4.0, 0.0], [4.0, 4.0], [0.0, 4.0]]
        );
    }
}
