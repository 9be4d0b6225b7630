//! Whether a pose is borne out by what both scanners saw: surfaces that agree, that are hidden, or that stand in space
//! which the other scanner saw to be empty.

use nalgebra::{Isometry3, Matrix3, SymmetricEigen, Vector3};
use rayon::prelude::*;

use crate::scan::free_space::{COLUMNS, Sight};
use crate::scan::surfel_map::{KINDS, Kind, Moving, SurfelLevel, SurfelMap};

/// Tolerances of a comparison (m).
#[derive(Clone, Copy, Debug)]
pub struct Tolerance {
    /// Offset along the normal within which two surfaces are one.
    pub offset: f64,
    /// Distance before a surface from which space counts as empty.
    pub margin: f64,
    /// Surfels compared each way, evenly drawn, and thin points in the same proportion.
    pub samples: usize,
}

/// Shares of one station's surface under a pose. What is left of 1 is unknown to the other station. A thin
/// point counts as a surfel.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Shares {
    /// On the other station's surface, facing alike.
    pub agreeing: f64,
    /// In space that the other station saw through.
    pub conflicting: f64,
    /// Behind what the other station saw.
    pub hidden: f64,
    /// Where the other station saw a surface, but not this one: another height, another facing.
    pub near: f64,
    /// Agreeing and conflicting surfels of each kind.
    pub agreeing_of: [f64; KINDS],
    pub conflicting_of: [f64; KINDS],
    /// Agreeing, weighed so that surfaces of every facing count alike: the geometric mean, over three axes, of three
    /// times the share that holds along the axis. Level ground alone, on which any shift agrees, comes to little.
    pub holding: f64,
}

/// Cosine of the largest angle between normals of surfaces that agree (30 degrees).
const FACING: f64 = 0.866;

/// Angle (rad) between a direction and the rays that answer for it. On a surface seen at a slant they end elsewhere,
/// so that a floor far away or the underside of eaves is not in conflict with the beams beside it.
const BESIDE: f64 = std::f64::consts::TAU / COLUMNS as f64;

/// Share along an axis that is taken for granted, so that one axis without surface does not hide the other two.
const LEAST_SHARE: f64 = 0.001;

/// What becomes of one surfel under a pose.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Outcome {
    Unknown,
    Agreeing,
    Conflicting,
    Hidden,
    Near,
}

/// A surfel or a thin point of one station under a pose.
#[derive(Clone, Copy, Debug)]
pub struct Compared {
    /// In the frame of its own station.
    pub point: [f32; 3],
    pub kind: Kind,
    pub outcome: Outcome,
    /// Distance from the plane at hand of the other station (m), and its standard deviation; NaN where none is at hand.
    pub offset: f32,
    pub sigma: f32,
}

/// What becomes of each surfel and thin point of `a` that is compared under `b_from_a`.
pub fn compared(
    a: &SurfelMap,
    b: &SurfelMap,
    b_from_a: &Isometry3<f64>,
    tolerance: &Tolerance,
) -> Vec<Compared> {
    let [from, onto] = a.levels(b, tolerance.offset);
    let one = |&index: &usize| {
        let moving = from.moving(index);
        let met = met(&moving, onto, from, b, b_from_a, tolerance);
        let (offset, sigma) = met
            .plane
            .map_or((f64::NAN, f64::NAN), |(offset, variance)| {
                (offset, (moving.variance + variance).sqrt())
            });
        Compared {
            point: [
                moving.point.x as f32,
                moving.point.y as f32,
                moving.point.z as f32,
            ],
            kind: moving.kind,
            outcome: met.outcome,
            offset: offset as f32,
            sigma: sigma as f32,
        }
    };
    let drawn: Vec<usize> = drawn(from, tolerance.samples).collect();
    drawn.par_iter().map(one).collect()
}

/// Surfels that are compared, then thin points in the same proportion.
fn drawn(from: &SurfelLevel, samples: usize) -> impl Iterator<Item = usize> {
    from.drawn(samples)
        .chain(from.thin_drawn(from.thin_share(samples)))
}

/// What a surfel or a thin point meets.
struct Met {
    outcome: Outcome,
    /// In the frame of `a`, of the surface where it agrees; zero elsewhere.
    normal: Vector3<f64>,
    /// Distance from the plane at hand (m), and that plane's variance (m^2).
    plane: Option<(f64, f64)>,
}

/// What becomes of a surfel or a thin point.
fn met(
    moving: &Moving,
    onto: &SurfelLevel,
    from: &SurfelLevel,
    b: &SurfelMap,
    b_from_a: &Isometry3<f64>,
    tolerance: &Tolerance,
) -> Met {
    let lateral = from.spacing.max(onto.spacing);
    let radius = (tolerance.offset * tolerance.offset + lateral * lateral).sqrt() as f32;
    let moved = b_from_a * moving.point;
    let point = [moved.x as f32, moved.y as f32, moved.z as f32];
    let mut plane = None;
    if let Some(other) = onto.nearest(point, radius) {
        let normal = Vector3::from(onto.normals[other].map(f64::from));
        let offset = normal.dot(&(moved.coords - Vector3::from(onto.points[other].map(f64::from))));
        plane = Some((offset, f64::from(onto.variances[other])));
        let own = match moving.normal {
            Some(own) => Some(own).filter(|own| (b_from_a.rotation * own).dot(&normal) > FACING),
            None => Some(b_from_a.rotation.inverse() * normal)
                .filter(|n| n.dot(&moving.point.coords) < 0.0),
        };
        if let Some(own) = own
            && offset.abs() < tolerance.offset
        {
            return Met {
                outcome: Outcome::Agreeing,
                normal: own,
                plane,
            };
        }
    }
    let slant = moving
        .normal
        .map_or(0.0, |own| slant(&(b_from_a.rotation * own), &moved.coords));
    let margin = tolerance.margin + slant * moved.coords.norm() * BESIDE;
    let outcome = match b.free_space.sight(point, margin as f32) {
        Sight::SeenThrough => Outcome::Conflicting,
        Sight::Hidden => Outcome::Hidden,
        // Where the other station has no surfel at hand, it saw too little to disagree.
        Sight::Near if plane.is_some() => Outcome::Near,
        Sight::Near => Outcome::Unknown,
        Sight::Unknown => Outcome::Unknown,
    };
    Met {
        outcome,
        normal: Vector3::zeros(),
        plane,
    }
}

/// How fast the range to a plane changes with the direction from the origin: the tangent of the incidence.
fn slant(normal: &Vector3<f64>, at: &Vector3<f64>) -> f64 {
    normal.cross(at).norm() / normal.dot(at).abs().max(f64::MIN_POSITIVE)
}

/// Shares of `a` under `b_from_a`, as seen by `b`.
pub fn one_way(
    a: &SurfelMap,
    b: &SurfelMap,
    b_from_a: &Isometry3<f64>,
    tolerance: &Tolerance,
) -> Shares {
    let mut sums = [0_usize; 5];
    let mut sums_of = [[0_usize; 5]; KINDS];
    let [from, onto] = a.levels(b, tolerance.offset);
    let mut facing = Matrix3::zeros();
    for index in drawn(from, tolerance.samples) {
        let moving = from.moving(index);
        let met = met(&moving, onto, from, b, b_from_a, tolerance);
        sums[met.outcome as usize] += 1;
        sums_of[moving.kind as usize][met.outcome as usize] += 1;
        facing += met.normal * met.normal.transpose();
    }
    let drawn = sums.iter().sum::<usize>().max(1) as f64;
    let axes = SymmetricEigen::new(facing / drawn).eigenvalues;
    let holding = axes
        .iter()
        .map(|share| (share + LEAST_SHARE).cbrt())
        .product::<f64>();
    let [_, agreeing, conflicting, hidden, near] = sums.map(|sum| sum as f64 / drawn);
    let of = |outcome: Outcome| sums_of.map(|sums| sums[outcome as usize] as f64 / drawn);
    Shares {
        agreeing,
        conflicting,
        hidden,
        near,
        agreeing_of: of(Outcome::Agreeing),
        conflicting_of: of(Outcome::Conflicting),
        holding: 3.0 * (holding - LEAST_SHARE),
    }
}

/// Shares both ways for many poses.
pub fn both_ways(
    a: &SurfelMap,
    b: &SurfelMap,
    poses: &[Isometry3<f64>],
    tolerance: &Tolerance,
) -> Vec<[Shares; 2]> {
    poses
        .par_iter()
        .map(|pose| {
            [
                one_way(a, b, pose, tolerance),
                one_way(b, a, &pose.inverse(), tolerance),
            ]
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::static_map;

    /// A wall 5 m ahead of the scanner, 6 m wide and 3 m high; with a screen before its left half if asked for.
    fn view(screen: bool) -> SurfelMap {
        let (mut points, mut normals, mut rays) = (vec![], vec![], vec![]);
        for i in 0..120 {
            for j in 0..60 {
                let (y, z) = (
                    -3.0 + 0.05 * (i as f32 + 0.5),
                    -1.5 + 0.05 * (j as f32 + 0.5),
                );
                let x = if screen && y > 0.0 { 3.0 } else { 5.0 };
                rays.push([x, y * x / 5.0, z * x / 5.0]);
                points.push([x, y * x / 5.0, z * x / 5.0]);
                normals.push([-1.0, 0.0, 0.0]);
            }
        }
        static_map(points, normals, 1e-6, 0.05, &rays)
    }

    const TOLERANCE: Tolerance = Tolerance {
        offset: 0.05,
        margin: 0.2,
        samples: 100_000,
    };

    #[test]
    fn the_same_view_agrees_with_itself() {
        let station = view(false);
        let shares = one_way(&station, &station, &Isometry3::identity(), &TOLERANCE);
        assert!(shares.agreeing > 0.999 && shares.conflicting == 0.0);
        assert!((shares.agreeing_of[Kind::Static as usize] - shares.agreeing).abs() < 1e-12);
        // All of it faces one way: the axes have shares 1, 0 and 0.
        let one_axis =
            3.0 * ((1.0 + LEAST_SHARE).cbrt() * LEAST_SHARE.powf(2.0 / 3.0) - LEAST_SHARE);
        assert!(
            (shares.holding - one_axis).abs() < 0.01,
            "{}",
            shares.holding
        );
    }

    #[test]
    fn surface_of_three_facings_holds_as_much_as_agrees() {
        // A corner of three walls of the same size, the scanner in its middle.
        let (mut points, mut normals) = (vec![], vec![]);
        for i in 0..60 {
            for j in 0..60 {
                let (u, v) = (
                    -1.5 + 0.05 * (i as f32 + 0.5),
                    -1.5 + 0.05 * (j as f32 + 0.5),
                );
                for axis in 0..3 {
                    let mut point = [u, v, 0.0];
                    point.rotate_left(axis);
                    let mut normal = [0.0, 0.0, -1.0];
                    normal.rotate_left(axis);
                    let face = point.iter().position(|&x| x == 0.0).expect("one is zero");
                    point[face] = 1.5;
                    points.push(point);
                    normals.push(normal);
                }
            }
        }
        let rays = points.clone();
        let station = static_map(points, normals, 1e-6, 0.05, &rays);
        let shares = one_way(&station, &station, &Isometry3::identity(), &TOLERANCE);
        assert!(shares.agreeing > 0.99);
        assert!(
            (shares.holding - shares.agreeing).abs() < 0.02,
            "{}",
            shares.holding
        );
    }

    #[test]
    fn a_surface_where_the_other_saw_through_is_in_conflict_and_one_behind_is_hidden() {
        let (plain, screened) = (view(false), view(true));
        let screen = one_way(&screened, &plain, &Isometry3::identity(), &TOLERANCE);
        // Shares are of area: the screen, at 3/5 of the wall's distance, has 9/25 of the half wall that it hides.
        let share = 0.36 / 1.36;
        assert!(
            (screen.conflicting - share).abs() < 0.05,
            "{} of {share}",
            screen.conflicting
        );
        assert!(
            (screen.agreeing - (1.0 - share)).abs() < 0.07,
            "{}",
            screen.agreeing
        );
        let wall = one_way(&plain, &screened, &Isometry3::identity(), &TOLERANCE);
        assert!(wall.conflicting < 1e-9);
        assert!(
            (wall.hidden - 0.5).abs() < 0.05,
            "half of the wall is behind the screen: {}",
            wall.hidden
        );
    }

    #[test]
    fn surfels_one_by_one_add_up_to_the_shares_and_are_as_far_off_as_they_were_moved() {
        let station = view(true);
        let nearer = Isometry3::translation(-0.02, 0.0, 0.0);
        let shares = one_way(&station, &station, &nearer, &TOLERANCE);
        let found = compared(&station, &station, &nearer, &TOLERANCE);
        let share = |outcome: Outcome| {
            let number = found.iter().filter(|one| one.outcome == outcome).count();
            number as f64 / found.len() as f64
        };
        assert!((share(Outcome::Agreeing) - shares.agreeing).abs() < 1e-12);
        assert!((share(Outcome::Conflicting) - shares.conflicting).abs() < 1e-12);
        let agreeing = found.iter().filter(|one| one.outcome == Outcome::Agreeing);
        for one in agreeing {
            // Normals face the scanner, along -x.
            assert!((one.offset - 0.02).abs() < 1e-5, "{}", one.offset);
            assert!((f64::from(one.sigma) - 2e-6_f64.sqrt()).abs() < 1e-6);
        }
    }

    #[test]
    fn a_wall_moved_towards_the_other_scanner_is_in_conflict() {
        let station = view(false);
        let nearer = Isometry3::translation(-1.0, 0.0, 0.0);
        let [there, back] = both_ways(&station, &station, &[nearer], &TOLERANCE)[0];
        // At 4 m the other's rays, which end on 6 x 3 m at 5 m, cross 4/5 of the width and of the height; voxels of
        // 0.2 m and cells of rays blur the rim.
        let share = 0.8 * 0.8;
        assert!(
            (there.conflicting - share).abs() < 0.08,
            "it stands in empty space: {} of {share}",
            there.conflicting
        );
        assert!(
            back.hidden > 0.5,
            "seen the other way it is behind: {}",
            back.hidden
        );
    }

    #[test]
    fn a_thin_point_agrees_with_a_plane_that_faces_its_scanner_and_conflicts_in_empty_space() {
        let wall = view(false);
        let none = || static_map(vec![], vec![], 1e-6, 0.05, &[]);
        let with = |point: [f32; 3]| none().with_thin(vec![point], vec![1e-6]);
        let only = |station: &SurfelMap, pose: &Isometry3<f64>| {
            let [from, onto] = station.levels(&wall, TOLERANCE.offset);
            met(&from.moving(0), onto, from, &wall, pose, &TOLERANCE)
        };
        let here = Isometry3::identity();
        let agrees = only(&with([5.02, 0.5, 0.3]), &here);
        assert_eq!(agrees.outcome, Outcome::Agreeing);
        assert!((agrees.normal - Vector3::new(-1.0, 0.0, 0.0)).norm() < 1e-6);
        assert_eq!(
            only(&with([4.0, 0.5, 0.3]), &here).outcome,
            Outcome::Conflicting
        );
        assert_eq!(only(&with([6.0, 0.5, 0.3]), &here).outcome, Outcome::Hidden);
        // Seen from 10 m ahead, looking back: the point is on the wall, but on its other face.
        let behind = Isometry3::translation(10.0, 0.0, 0.0);
        assert_ne!(
            only(&with([-5.0, 0.5, 0.3]), &behind).outcome,
            Outcome::Agreeing
        );
    }

    #[test]
    fn a_floor_seen_far_away_is_in_no_conflict_with_beams_that_end_beside_it() {
        // Level ground 1.6 m below the scanner; beams that would end nearer than 60 m were lost.
        let (mut rays, height) = (vec![], 1.6_f64);
        for step in 0..100 {
            for row in 0..20 {
                let heading = (0.1 * f64::from(step) - 5.0).to_radians();
                let level = height / (1.52 - 0.03 * f64::from(row)).to_radians().tan();
                rays.push(
                    [level * heading.cos(), level * heading.sin(), -height].map(|v| v as f32),
                );
            }
        }
        let far = static_map(vec![], vec![], 1e-6, 0.05, &rays);
        let here = Isometry3::identity();
        let only = |normal: [f32; 3]| {
            let near = static_map(vec![[57.0, 0.0, -1.6]], vec![normal], 1e-6, 0.05, &[]);
            let [from, onto] = near.levels(&far, TOLERANCE.offset);
            met(&from.moving(0), onto, from, &far, &here, &TOLERANCE).outcome
        };
        assert_ne!(only([0.0, 0.0, 1.0]), Outcome::Conflicting);
        assert_eq!(
            only([-1.0, 0.0, 0.0]),
            Outcome::Conflicting,
            "a wall there would have stopped them"
        );
    }
}
