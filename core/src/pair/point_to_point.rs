//! Point-to-point ICP with Levenberg and Marquardt's steps (after Fitzgibbon 2003): the sum of squared distances to
//! the nearest points is minimised over the six parameters of a motion, nearest points found anew for every trial.

use nalgebra::{Isometry3, Matrix6, Point3, Vector3, Vector6};
use rayon::prelude::*;

use crate::pair::point_to_plane::small_motion;
use crate::spatial::kd_tree::Tree;

/// Points a block: sums are taken block by block in order, whatever the number of threads.
const BLOCK: usize = 1024;

/// When an alignment ends.
#[derive(Clone, Copy, Debug)]
pub struct Limits {
    /// Points without a neighbour within this (m) count as if it were at this distance, and pull nowhere.
    pub max_distance: f64,
    pub iterations: usize,
    /// A step below both ends it (m, rad).
    pub translation: f64,
    pub rotation: f64,
}

/// What an alignment ended with.
#[derive(Debug)]
pub struct Alignment {
    /// `b_from_a`.
    pub pose: Isometry3<f64>,
    /// Root mean square distance (m) of the points that have a neighbour within the maximum distance; NaN if none has.
    pub rmse: f64,
    /// How many have one.
    pub matched: usize,
    pub iterations: usize,
    pub converged: bool,
}

struct Sums {
    information: Matrix6<f64>,
    gradient: Vector6<f64>,
    /// Of squares, those beyond the maximum distance cut to it.
    cost: f64,
    square: f64,
    matched: usize,
}

/// Aligns the points of `a` with those of `b` from a starting pose `b_from_a`.
pub fn align(a: &[[f32; 3]], b: &Tree, start: &Isometry3<f64>, limits: &Limits) -> Alignment {
    let mut pose = *start;
    let mut sums = compare(a, b, &pose, limits.max_distance);
    let mut damping = 1e-6;
    let mut converged = false;
    let mut iterations = 0;
    while iterations < limits.iterations && sums.matched >= 3 && !converged {
        iterations += 1;
        loop {
            let mut normal = sums.information;
            for axis in 0..6 {
                normal[(axis, axis)] *= 1.0 + damping;
                normal[(axis, axis)] += 1e-9;
            }
            let Some(factor) = normal.cholesky() else {
                damping = (damping * 10.0).max(1e-6);
                if damping > 1e8 {
                    break;
                }
                continue;
            };
            let step = -factor.solve(&sums.gradient);
            let small = step.fixed_rows::<3>(0).norm() < limits.rotation
                && step.fixed_rows::<3>(3).norm() < limits.translation;
            // The step turns about the origin of `b`.
            let trial = small_motion(&step) * pose;
            let next = compare(a, b, &trial, limits.max_distance);
            if next.cost <= sums.cost {
                (pose, sums) = (trial, next);
                damping = (damping * 0.1).max(1e-9);
                converged = small;
                break;
            }
            if small || damping > 1e8 {
                converged = true;
                break;
            }
            damping *= 10.0;
        }
    }
    Alignment {
        pose,
        rmse: (sums.square / sums.matched as f64).sqrt(),
        matched: sums.matched,
        iterations,
        converged,
    }
}

fn compare(a: &[[f32; 3]], b: &Tree, pose: &Isometry3<f64>, max_distance: f64) -> Sums {
    let blocks: Vec<Sums> = a
        .par_chunks(BLOCK)
        .map(|block| {
            let mut sums = Sums::zero();
            for point in block {
                sums.add(point, b, pose, max_distance);
            }
            sums
        })
        .collect();
    blocks.iter().fold(Sums::zero(), Sums::merge)
}

impl Sums {
    fn zero() -> Self {
        Self {
            information: Matrix6::zeros(),
            gradient: Vector6::zeros(),
            cost: 0.0,
            square: 0.0,
            matched: 0,
        }
    }

    fn add(&mut self, point: &[f32; 3], b: &Tree, pose: &Isometry3<f64>, max_distance: f64) {
        let moved = pose * Point3::from(point.map(f64::from));
        let query = [moved.x as f32, moved.y as f32, moved.z as f32];
        let Some(neighbour) = b.nearest(query, max_distance as f32) else {
            self.cost += if max_distance.is_finite() {
                max_distance * max_distance
            } else {
                0.0
            };
            return;
        };
        let p = moved.coords;
        let r: Vector3<f64> = p - Vector3::from(neighbour.point.map(f64::from));
        // d(exp(omega, v) p) = v - p x omega: J = [-[p]x, I], so J^T r = (p x r, r).
        let skew = p.cross_matrix();
        let mut top = self.information.fixed_view_mut::<3, 3>(0, 0);
        top -= skew * skew;
        let mut side = self.information.fixed_view_mut::<3, 3>(0, 3);
        side += skew;
        let mut corner = self.information.fixed_view_mut::<3, 3>(3, 0);
        corner -= skew;
        for axis in 3..6 {
            self.information[(axis, axis)] += 1.0;
        }
        let turn = p.cross(&r);
        for axis in 0..3 {
            self.gradient[axis] += turn[axis];
            self.gradient[axis + 3] += r[axis];
        }
        self.cost += r.norm_squared();
        self.square += r.norm_squared();
        self.matched += 1;
    }

    fn merge(mut self, other: &Self) -> Self {
        self.information += other.information;
        self.gradient += other.gradient;
        self.cost += other.cost;
        self.square += other.square;
        self.matched += other.matched;
        self
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing;
    use nalgebra::{Translation3, UnitQuaternion};

    const LIMITS: Limits = Limits {
        max_distance: f64::INFINITY,
        iterations: 200,
        translation: 1e-7,
        rotation: 1e-7,
    };

    fn scattered(count: usize) -> Vec<[f32; 3]> {
        testing::scattered(count, 1, (1_u64 << 31) as f32)
    }

    fn motion() -> Isometry3<f64> {
        Isometry3::from_parts(
            Translation3::new(0.1, -0.05, 0.08),
            UnitQuaternion::from_euler_angles(0.01, -0.02, 0.03),
        )
    }

    #[test]
    fn recovers_the_motion_of_the_same_points() {
        let b = scattered(3000);
        let a: Vec<[f32; 3]> = b
            .iter()
            .map(|p| {
                let q = motion().inverse() * Point3::from(p.map(f64::from));
                [q.x as f32, q.y as f32, q.z as f32]
            })
            .collect();
        let found = align(&a, &Tree::new(&b), &Isometry3::identity(), &LIMITS);
        let off = found.pose.inverse() * motion();
        assert!(found.converged && found.matched == 3000);
        assert!(off.translation.vector.norm() < 1e-5 && off.rotation.angle() < 1e-5);
        assert!(found.rmse < 1e-5);
    }

    #[test]
    fn the_gradient_is_that_of_the_cost() {
        let b = Tree::new(&scattered(500));
        let a = scattered(400);
        let pose = motion();
        let sums = compare(&a, &b, &pose, f64::INFINITY);
        for axis in 0..6 {
            let mut xi = Vector6::zeros();
            xi[axis] = 1e-6;
            let cost =
                |xi: &Vector6<f64>| compare(&a, &b, &(small_motion(xi) * pose), f64::INFINITY).cost;
            let slope = (cost(&xi) - cost(&-xi)) / 2e-6;
            // The cost is half of what its Jacobian's product says twice.
            assert!((slope - 2.0 * sums.gradient[axis]).abs() < 1e-3 * slope.abs().max(1.0));
        }
    }

    #[test]
    fn nothing_within_the_maximum_distance_stays_where_it_is() {
        let far: Vec<[f32; 3]> = scattered(100)
            .iter()
            .map(|p| [p[0] + 1000.0, p[1], p[2]])
            .collect();
        let limits = Limits {
            max_distance: 1.0,
            ..LIMITS
        };
        let found = align(
            &far,
            &Tree::new(&scattered(100)),
            &Isometry3::identity(),
            &limits,
        );
        assert!(found.matched == 0 && found.rmse.is_nan() && !found.converged);
        assert_eq!(found.pose, Isometry3::identity());
    }
}
