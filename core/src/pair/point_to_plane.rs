//! Point-to-plane alignment of two stations, both ways, over stages of shrinking maximum correspondence distance.
//!
//! Every surfel of one station is compared with the plane of the nearest surfel of the other; only surfels whose
//! normals face alike are compared, so that the two faces of a wall do not attract each other. Points that one station
//! saw too thinly for planes are compared with planes of the other that face its scanner: what is far and grazing for
//! one is near for the other.

use nalgebra::{Isometry3, Matrix6, Point3, Translation3, UnitQuaternion, Vector3, Vector6};
use rayon::prelude::*;

use crate::scan::surfel_map::{SurfelLevel, SurfelMap};

/// Cosine of the largest angle between the normals of two surfels that are compared (30 degrees).
const FACING: f64 = 0.866;
/// Standard deviations at which an offset keeps a quarter of its weight.
const DOUBTED: f64 = 3.0;
/// Surfels a block: sums are taken block by block in order, whatever the number of threads.
const BLOCK: usize = 1024;
/// Side of a place (m): offsets in one place may err together, as a wall's warp and a plane's fit do.
/// docs/method/refinement.md has how errors compare with the covariance that this gives.
const PLACE: f64 = 2.0;
/// Surfaces that face alike within about half a radian, their planes as near as this (m), are one plane.
const PLANE: f64 = 0.3;

/// One stage.
#[derive(Clone, Copy, Debug)]
pub struct Stage {
    /// Maximum correspondence distance (m): offsets beyond it have no weight (Tukey's biweight).
    pub max_distance: f64,
    /// Surfels of each station that take part, evenly drawn.
    pub samples: usize,
    pub iterations: usize,
    /// Weigh by the surfels' variances instead of alike.
    pub by_variance: bool,
}

/// What a fit ended with.
pub struct Fit {
    /// `b_from_a`.
    pub pose: Isometry3<f64>,
    /// Normal matrix of (omega, v) on the left of the pose, in the frame of `b`, weights as in the last stage, the two
    /// ways counted once.
    pub information: Matrix6<f64>,
    /// Sum over places of the outer product of their gradients at the pose: what the normal matrix would be, both ways
    /// counted, if offsets scattered by their variances and independently.
    pub scatter: Matrix6<f64>,
    /// How many places were compared.
    pub places: usize,
    /// Sum over planes of the outer product of the gradients (per m) of a plane that is off as a whole, both ways.
    pub planes: Matrix6<f64>,
    /// Weighted mean square of the last stage's offsets over their variances (1 where the noise model holds).
    pub chi_square: f64,
    /// Signed offsets along the normal (m) of the surfels compared last, from `a` onto `b` then from `b` onto `a`.
    pub offsets: Vec<f32>,
    /// Whether the last step was below a hundredth of a millimetre and a microradian.
    pub converged: bool,
}

#[derive(Clone, Copy, Default)]
struct Sums {
    information: Matrix6<f64>,
    gradient: Vector6<f64>,
    weight: f64,
    weighted_square: f64,
}

impl Sums {
    fn add(&mut self, comparison: &Comparison, stage: &Stage) {
        let jacobian = &comparison.jacobian;
        let (weight, kept) = comparison.weights(stage);
        self.information += jacobian * jacobian.transpose() * (kept / comparison.variance);
        self.gradient += jacobian * (comparison.offset * kept / comparison.variance);
        self.weight += weight;
        self.weighted_square += weight * comparison.square();
    }

    fn merge(mut self, other: &Self) -> Self {
        self.information += other.information;
        self.gradient += other.gradient;
        self.weight += other.weight;
        self.weighted_square += other.weighted_square;
        self
    }
}

/// `exp(xi)` for a small motion `(omega, v)`: the rotation of omega, the translation v.
pub fn small_motion(xi: &Vector6<f64>) -> Isometry3<f64> {
    Isometry3::from_parts(
        Translation3::new(xi[3], xi[4], xi[5]),
        UnitQuaternion::from_scaled_axis(Vector3::new(xi[0], xi[1], xi[2])),
    )
}

/// Aligns `a` with `b` from a starting pose `b_from_a`.
pub fn refine(a: &SurfelMap, b: &SurfelMap, start: &Isometry3<f64>, stages: &[Stage]) -> Fit {
    let mut pose = *start;
    let mut converged = false;
    let mut last = Sums::default();
    for stage in stages {
        for _ in 0..stage.iterations {
            let [there, back] = both_ways(a, b, &pose, stage).map(|way| way.sums());
            let sums = there.merge(&back);
            last = sums;
            // A direction that nothing observes stays where it is.
            let damping =
                Matrix6::identity() * (1e-9 * sums.information.trace().max(f64::MIN_POSITIVE));
            let Some(factor) = (sums.information + damping).cholesky() else {
                break;
            };
            let step = -factor.solve(&sums.gradient);
            pose = small_motion(&step) * pose;
            converged =
                step.fixed_rows::<3>(3).norm() < 1e-5 && step.fixed_rows::<3>(0).norm() < 1e-6;
            if converged {
                break;
            }
        }
    }
    let (mut of_last, mut clusters) = (Vec::new(), [(Matrix6::zeros(), 0); 2]);
    if let Some(stage) = stages.last() {
        let ways = both_ways(a, b, &pose, stage);
        let gradients: Vec<Gradient> = ways.iter().flat_map(Way::gradients).collect();
        clusters = [
            clustered(gradients.iter().map(|g| (g.place, g.of_offset)).collect()),
            clustered(gradients.iter().map(|g| (g.plane, g.of_plane)).collect()),
        ];
        of_last = offsets(ways);
    }
    let [(scatter, places), (planes, _)] = clusters;
    Fit {
        pose,
        information: last.information / 2.0,
        scatter,
        places,
        planes,
        chi_square: if last.weight > 0.0 {
            last.weighted_square / last.weight
        } else {
            f64::NAN
        },
        offsets: of_last,
        converged,
    }
}

/// One compared surfel: where it is in the frame of `b`, derivative of the offset, offset, variance.
struct Comparison {
    at: Point3<f64>,
    jacobian: Vector6<f64>,
    offset: f64,
    variance: f64,
}

impl Comparison {
    fn square(&self) -> f64 {
        self.offset * self.offset / self.variance
    }

    /// Weight by the maximum distance, and what surfaces that differ by far more than their noise (things that moved, leaves) keep
    /// of it (Geman and McClure 1987).
    fn weights(&self, stage: &Stage) -> (f64, f64) {
        let relative = self.offset / stage.max_distance;
        let weight = (1.0 - relative * relative).powi(2);
        let kept = if stage.by_variance {
            weight / (1.0 + self.square() / (DOUBTED * DOUBTED)).powi(2)
        } else {
            weight
        };
        (weight, kept)
    }
}

/// What a comparison adds to the gradient of the sum of squares, in the cluster of its place by its offset, and in that of
/// its plane for each metre that this is off.
struct Gradient {
    place: [i32; 3],
    of_offset: Vector6<f64>,
    plane: [i32; 4],
    of_plane: Vector6<f64>,
}

/// One station's surfels and thin points, compared with planes of the other's.
struct Way<'a> {
    from: &'a SurfelLevel,
    onto: &'a SurfelLevel,
    onto_from_from: Isometry3<f64>,
    /// Whether the planes are those of `b`.
    onto_is_b: bool,
    stage: &'a Stage,
}

/// Both ways of a stage. Planes are about as far apart as its maximum correspondence distance, and so are the surfels
/// but in the last stages, which use all.
fn both_ways<'a>(
    a: &'a SurfelMap,
    b: &'a SurfelMap,
    b_from_a: &Isometry3<f64>,
    stage: &'a Stage,
) -> [Way<'a>; 2] {
    let planes = a.levels(b, stage.max_distance);
    let moving = if stage.by_variance {
        [a.finest(), b.finest()]
    } else {
        planes
    };
    let way = |from: usize, onto_from_from| Way {
        from: moving[from],
        onto: planes[1 - from],
        onto_from_from,
        onto_is_b: from == 0,
        stage,
    };
    [way(0, *b_from_a), way(1, b_from_a.inverse())]
}

impl Way<'_> {
    /// Surfels that take part, then thin points.
    fn drawn(&self) -> Vec<usize> {
        let thin = self.from.thin_drawn(self.stage.samples);
        self.from.drawn(self.stage.samples).chain(thin).collect()
    }

    fn comparison(&self, index: usize) -> Option<Comparison> {
        let (from, onto, stage) = (self.from, self.onto, self.stage);
        let moving = from.moving(index);
        let moved = self.onto_from_from * moving.point;
        let lateral = from.spacing.max(onto.spacing);
        let radius = (stage.max_distance * stage.max_distance + lateral * lateral).sqrt();
        let other = onto.nearest(
            [moved.x as f32, moved.y as f32, moved.z as f32],
            radius as f32,
        )?;
        let normal = Vector3::from(onto.normals[other].map(f64::from));
        let faces = match moving.normal {
            Some(own) => (self.onto_from_from.rotation * own).dot(&normal) >= FACING,
            None => (self.onto_from_from.translation.vector - moved.coords).dot(&normal) > 0.0,
        };
        if !faces {
            return None;
        }
        let apart = moved.coords - Vector3::from(onto.points[other].map(f64::from));
        let offset = normal.dot(&apart);
        if offset.abs() >= stage.max_distance
            || (apart.norm_squared() - offset * offset) > lateral * lateral
        {
            return None;
        }
        let variance = if stage.by_variance {
            // What moves onto one plane errs with it: together they have no more of its information than there is.
            let sharing = (onto.area(other) / from.area(index)).max(1.0);
            moving.variance + f64::from(onto.variances[other]) * sharing
        } else {
            1.0
        };
        // Where the plane belongs to `a`, its normal is turned into b, where the fixed point is the surfel itself.
        let (at, sign, normal) = if self.onto_is_b {
            (moved, 1.0, normal)
        } else {
            let turned = self.onto_from_from.rotation.inverse() * normal;
            (moving.point, -1.0, turned)
        };
        let moment = at.coords.cross(&normal);
        let jacobian = Vector6::new(moment.x, moment.y, moment.z, normal.x, normal.y, normal.z);
        Some(Comparison {
            at,
            jacobian: jacobian * sign,
            offset,
            variance,
        })
    }

    fn sums(&self) -> Sums {
        let blocks: Vec<Sums> = self
            .drawn()
            .par_chunks(BLOCK)
            .map(|block| {
                let mut sums = Sums::default();
                for comparison in block.iter().filter_map(|&index| self.comparison(index)) {
                    sums.add(&comparison, self.stage);
                }
                sums
            })
            .collect();
        blocks.iter().fold(Sums::default(), Sums::merge)
    }

    fn gradients(&self) -> Vec<Gradient> {
        // Both ways have a plane face alike.
        let sign = if self.onto_is_b { 1.0 } else { -1.0 };
        let gradient = |&index: &usize| {
            let c = self.comparison(index)?;
            let weighted = c.jacobian * (c.weights(self.stage).1 / c.variance);
            let normal = c.jacobian.fixed_rows::<3>(3) * sign;
            let facing = (normal * 2.0).map(|v| v.round() as i32);
            let distance = (c.at.coords.dot(&normal) / PLANE).round() as i32;
            Some(Gradient {
                place: (c.at / PLACE).coords.map(|v| v.floor() as i32).into(),
                of_offset: weighted * c.offset,
                plane: [facing.x, facing.y, facing.z, distance],
                of_plane: weighted * sign,
            })
        };
        self.drawn().par_iter().filter_map(gradient).collect()
    }

    /// Offsets where both stations have surfels side by side: a plane carried on to its sparse neighbours is no measure
    /// of fit.
    fn offsets(&self) -> Vec<f32> {
        let drawn: Vec<usize> = self.from.drawn(self.stage.samples).collect();
        let offset = |&index: &usize| self.comparison(index).map(|c| c.offset as f32);
        drawn.par_iter().filter_map(offset).collect()
    }
}

/// Sum over clusters of the outer product of what their members sum to, and how many there are.
fn clustered<K: Ord + Copy>(mut members: Vec<(K, Vector6<f64>)>) -> (Matrix6<f64>, usize) {
    members.sort_by_key(|member| member.0);
    let clusters = members.chunk_by(|one, other| one.0 == other.0);
    let mut count = 0;
    let sum = clusters.fold(Matrix6::zeros(), |sum, cluster| {
        count += 1;
        let gradient: Vector6<f64> = cluster.iter().map(|member| member.1).sum();
        sum + gradient * gradient.transpose()
    });
    (sum, count)
}

/// See `Fit::offsets`.
fn offsets([there, back]: [Way; 2]) -> Vec<f32> {
    let (of_a, of_b) = (there.from, back.from);
    let there = Way {
        onto: of_b,
        ..there
    };
    let back = Way { onto: of_a, ..back };
    [there.offsets(), back.offsets()].concat()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::static_map;

    /// Surfels of the six sides of a room of 8 x 6 x 3 m, seen from a scanner inside.
    fn room(scanner: [f64; 3], turn: f64) -> SurfelMap {
        let (mut points, mut normals) = (vec![], vec![]);
        let mut wall = |origin: [f64; 3], u: [f64; 3], v: [f64; 3], normal: [f64; 3]| {
            for i in 0..40 {
                for j in 0..30 {
                    let (s, t) = ((f64::from(i) + 0.5) / 40.0, (f64::from(j) + 0.5) / 30.0);
                    points.push(std::array::from_fn::<f64, 3, _>(|a| {
                        origin[a] + s * u[a] + t * v[a]
                    }));
                    normals.push(normal);
                }
            }
        };
        let (x, y, z) = ([8.0, 0.0, 0.0], [0.0, 6.0, 0.0], [0.0, 0.0, 3.0]);
        wall([0.0; 3], x, y, [0.0, 0.0, 1.0]);
        wall(z, x, y, [0.0, 0.0, -1.0]);
        wall([0.0; 3], x, z, [0.0, 1.0, 0.0]);
        wall(y, x, z, [0.0, -1.0, 0.0]);
        wall([0.0; 3], y, z, [1.0, 0.0, 0.0]);
        wall(x, y, z, [-1.0, 0.0, 0.0]);
        let rotation = UnitQuaternion::from_euler_angles(0.0, 0.0, -turn);
        let moved = |v: &[f64; 3], shift: [f64; 3]| {
            let p = rotation * Vector3::from(std::array::from_fn::<f64, 3, _>(|a| v[a] - shift[a]));
            [p.x as f32, p.y as f32, p.z as f32]
        };
        let points: Vec<[f32; 3]> = points.iter().map(|p| moved(p, scanner)).collect();
        let normals = normals.iter().map(|n| moved(n, [0.0; 3])).collect();
        static_map(points, normals, 1e-6, 0.2, &[])
    }

    /// The same room, of whose walls along one axis only single points are known.
    fn room_with_thin_walls(scanner: [f64; 3], turn: f64) -> SurfelMap {
        let whole = room(scanner, turn);
        let (points, normals) = (&whole.finest().points, &whole.finest().normals);
        let across = UnitQuaternion::from_euler_angles(0.0, 0.0, -turn) * Vector3::x();
        let is_thin =
            |i: &usize| Vector3::from(normals[*i].map(f64::from)).dot(&across).abs() > 0.5;
        let (thin, planes): (Vec<usize>, Vec<usize>) = (0..points.len()).partition(is_thin);
        let pick = |values: &[[f32; 3]], of: &[usize]| of.iter().map(|&i| values[i]).collect();
        let thin_points = pick(points, &thin);
        let (points, normals) = (pick(points, &planes), pick(normals, &planes));
        static_map(points, normals, 1e-6, 0.2, &[]).with_thin(thin_points, vec![4e-6; thin.len()])
    }

    fn truth() -> Isometry3<f64> {
        // b_from_a: a at (2, 3, 1.5) turned by 0.4, b at (5.5, 2.5, 1.6) turned by -0.3.
        let pose = |p: [f64; 3], turn: f64| {
            Isometry3::from_parts(
                Translation3::from(p),
                UnitQuaternion::from_euler_angles(0.0, 0.0, turn),
            )
        };
        pose([5.5, 2.5, 1.6], -0.3).inverse() * pose([2.0, 3.0, 1.5], 0.4)
    }

    fn stages() -> Vec<Stage> {
        [0.6, 0.3, 0.15, 0.05]
            .map(|max_distance| Stage {
                max_distance,
                samples: 10_000,
                iterations: 20,
                by_variance: max_distance < 0.1,
            })
            .to_vec()
    }

    #[test]
    fn a_disturbed_pose_comes_back_to_the_truth() {
        let (a, b) = (room([2.0, 3.0, 1.5], 0.4), room([5.5, 2.5, 1.6], -0.3));
        let start = small_motion(&Vector6::new(0.02, -0.03, 0.04, 0.2, -0.15, 0.1)) * truth();
        let fit = refine(&a, &b, &start, &stages());
        let off = truth().inverse() * fit.pose;
        assert!(fit.converged);
        assert!(
            off.translation.vector.norm() < 1e-4,
            "{}",
            off.translation.vector.norm()
        );
        assert!(off.rotation.angle() < 1e-5);
    }

    #[test]
    fn thin_points_hold_a_pose_where_only_the_other_station_has_planes() {
        let (a, b) = (
            room_with_thin_walls([2.0, 3.0, 1.5], 0.4),
            room([5.5, 2.5, 1.6], -0.3),
        );
        let start = small_motion(&Vector6::new(0.02, -0.03, 0.04, 0.2, -0.15, 0.1)) * truth();
        for pose in [
            refine(&a, &b, &start, &stages()).pose,
            refine(&b, &a, &start.inverse(), &stages()).pose.inverse(),
        ] {
            let off = truth().inverse() * pose;
            assert!(off.translation.vector.norm() < 1e-4, "{}", off.translation);
            assert!(off.rotation.angle() < 1e-5);
        }
    }

    #[test]
    fn the_way_back_is_the_inverse() {
        let (a, b) = (room([2.0, 3.0, 1.5], 0.4), room([5.5, 2.5, 1.6], -0.3));
        let start = small_motion(&Vector6::new(0.01, 0.0, -0.02, 0.1, 0.1, -0.05)) * truth();
        let there = refine(&a, &b, &start, &stages()).pose;
        let back = refine(&b, &a, &start.inverse(), &stages()).pose;
        let round = there * back;
        assert!(round.translation.vector.norm() < 1e-5 && round.rotation.angle() < 1e-6);
    }

    #[test]
    fn jacobians_agree_with_numerical_differences() {
        let (a, b) = (
            room_with_thin_walls([2.0, 3.0, 1.5], 0.4),
            room([5.5, 2.5, 1.6], -0.3),
        );
        let pose = small_motion(&Vector6::new(0.001, -0.002, 0.001, 0.01, -0.01, 0.005)) * truth();
        let stage = Stage {
            max_distance: 0.3,
            samples: usize::MAX,
            iterations: 1,
            by_variance: false,
        };
        let step = 1e-6;
        let mut slopes = 0;
        for way in [0, 1] {
            for index in both_ways(&a, &b, &pose, &stage)[way].drawn() {
                let evaluate =
                    |pose: &Isometry3<f64>| both_ways(&a, &b, pose, &stage)[way].comparison(index);
                let Some(here) = evaluate(&pose) else {
                    continue;
                };
                for axis in 0..6 {
                    let mut xi = Vector6::zeros();
                    xi[axis] = step;
                    let [ahead, behind] =
                        [xi, -xi].map(|xi| evaluate(&(small_motion(&xi) * pose)).unwrap().offset);
                    let slope = (ahead - behind) / (2.0 * step);
                    let off = (slope - here.jacobian[axis]).abs();
                    assert!(off < 1e-6, "{slope} {}", here.jacobian[axis]);
                    slopes += 1;
                }
            }
        }
        assert!(slopes > 10_000, "only {slopes} slopes were compared");
    }

    /// A wall of 4 x 4 m across x whose surfels are so far apart (m) and stand for the square of that.
    fn wall_sampled(apart: f32, variance: f32) -> SurfelMap {
        wall_of(wall_points(apart), apart, variance)
    }

    fn wall_points(apart: f32) -> Vec<[f32; 3]> {
        let side = (4.0 / apart).round() as usize;
        let place = |k: usize| (k as f32 + 0.5) * apart;
        (0..side * side)
            .map(|k| [3.0, place(k % side) - 2.0, place(k / side) - 2.0])
            .collect()
    }

    fn wall_of(points: Vec<[f32; 3]>, apart: f32, variance: f32) -> SurfelMap {
        let count = points.len();
        let normals = vec![[-1.0, 0.0, 0.0]; count];
        static_map(points, normals, variance, 0.1, &[]).with_areas(vec![apart * apart; count])
    }

    #[test]
    fn surface_that_one_station_saw_thinly_has_no_more_information_than_it_gave() {
        let variance = 4e-6;
        let stage = Stage {
            max_distance: 0.05,
            samples: usize::MAX,
            iterations: 1,
            by_variance: true,
        };
        for (apart_a, apart_b) in [(0.1, 0.1), (0.1, 0.25), (0.25, 0.1)] {
            let (a, b) = (
                wall_sampled(apart_a, variance),
                wall_sampled(apart_b, variance),
            );
            let fit = refine(&a, &b, &Isometry3::identity(), &[stage]);
            // Of each square metre either station knows 1 / (variance * area of a surfel) of where it is.
            let known = [apart_a, apart_b].map(|apart| 1.0 / f64::from(variance * apart * apart));
            let expected = 16.0 * known[0] * known[1] / (known[0] + known[1]);
            let share = fit.information[(3, 3)] / expected;
            assert!(share < 1.05, "{share} of what the walls tell");
            assert!(share > 0.7, "{share} of what the walls tell");
        }
    }

    #[test]
    fn surface_that_only_one_station_saw_does_not_draw_the_pose_to_what_is_beside_it() {
        // A fifth of a wall stands 10 mm before the rest, and one station missed that; offsets are good to 0.7 mm.
        let stage = Stage {
            max_distance: 0.05,
            samples: usize::MAX,
            iterations: 20,
            by_variance: true,
        };
        let mut points = wall_points(0.1);
        for point in points.iter_mut().step_by(5) {
            point[0] -= 0.01;
        }
        let (stepped, plain) = (wall_of(points, 0.1, 2.5e-7), wall_sampled(0.1, 2.5e-7));
        let fit = refine(&stepped, &plain, &Isometry3::identity(), &[stage]);
        let off = (fit.pose * Point3::new(3.0, 0.0, 0.0)).x - 3.0;
        assert!(off.abs() < 5e-5, "{off} m");
    }

    #[test]
    fn faces_that_look_apart_do_not_attract() {
        // Two sides of a wall 10 cm thick: nothing to compare.
        let side = |x: f64, nx: f32| {
            let points: Vec<[f32; 3]> = (0..900)
                .map(|i| [x as f32, 0.1 * (i % 30) as f32, 0.1 * (i / 30) as f32])
                .collect();
            let normals = vec![[nx, 0.0, 0.0]; points.len()];
            static_map(points, normals, 1e-6, 0.1, &[])
        };
        let points = side(3.0, -1.0).finest().points.clone();
        let variances = vec![1e-6; points.len()];
        let thin = side(-50.0, 1.0).with_thin(points, variances);
        for front in [side(3.0, -1.0), thin] {
            let fit = refine(&front, &side(3.1, 1.0), &Isometry3::identity(), &stages());
            assert!(fit.offsets.is_empty());
            assert_eq!(fit.places, 0);
            assert!(
                fit.pose.translation.vector.norm() < 1e-12,
                "nothing observed, nothing moved"
            );
        }
    }

    #[test]
    fn the_result_does_not_depend_on_the_number_of_threads() {
        let (a, b) = (room([2.0, 3.0, 1.5], 0.4), room([5.5, 2.5, 1.6], -0.3));
        let start = small_motion(&Vector6::new(0.01, 0.0, -0.02, 0.1, 0.1, -0.05)) * truth();
        let with = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new()
                .num_threads(threads)
                .build()
                .unwrap();
            pool.install(|| refine(&a, &b, &start, &stages()))
                .pose
                .to_homogeneous()
        };
        assert_eq!(with(1), with(2));
        assert_eq!(with(1), with(3));
    }
}
