//! Sums over points from which centroid and scatter follow; sums of sets are sums of sums.

use nalgebra::{Matrix3, SymmetricEigen, Vector3};

/// Count, sum and sum of outer products of points.
#[derive(Clone, Copy, Debug, Default)]
pub struct Moments {
    pub count: f64,
    sum: Vector3<f64>,
    products: Matrix3<f64>,
}

/// Eigenvalues of the covariance in rising order and the matching unit vectors as columns.
pub struct Axes {
    pub variances: [f64; 3],
    pub directions: [Vector3<f64>; 3],
}

impl Moments {
    pub fn add(&mut self, point: Vector3<f64>) {
        self.count += 1.0;
        self.sum += point;
        self.products += point * point.transpose();
    }

    pub fn merge(&mut self, other: &Self) {
        self.count += other.count;
        self.sum += other.sum;
        self.products += other.products;
    }

    /// The same points about another origin: every point moves by `shift`.
    pub fn shifted(&self, shift: Vector3<f64>) -> Self {
        let cross = self.sum * shift.transpose();
        Self {
            count: self.count,
            sum: self.sum + shift * self.count,
            products: self.products
                + cross
                + cross.transpose()
                + shift * shift.transpose() * self.count,
        }
    }

    pub fn mean(&self) -> Vector3<f64> {
        self.sum / self.count
    }

    /// Covariance with the count as divisor.
    pub fn covariance(&self) -> Matrix3<f64> {
        let mean = self.mean();
        self.products / self.count - mean * mean.transpose()
    }

    pub fn axes(&self) -> Axes {
        let eigen = SymmetricEigen::new(self.covariance());
        let mut order = [0, 1, 2];
        order.sort_by(|&a, &b| eigen.eigenvalues[a].total_cmp(&eigen.eigenvalues[b]));
        Axes {
            variances: order.map(|i| eigen.eigenvalues[i].max(0.0)),
            directions: order.map(|i| eigen.eigenvectors.column(i).into_owned()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn merging_and_shifting_equal_adding_the_moved_points() {
        let points = [
            [1.0, 2.0, 3.0],
            [-2.0, 0.5, 1.0],
            [0.0, 4.0, -1.0],
            [2.0, 2.0, 2.0],
        ]
        .map(Vector3::from);
        let shift = Vector3::new(10.0, -3.0, 0.5);
        let (mut left, mut right, mut all) =
            (Moments::default(), Moments::default(), Moments::default());
        points[..2].iter().for_each(|&p| left.add(p));
        points[2..].iter().for_each(|&p| right.add(p));
        points.iter().for_each(|&p| all.add(p + shift));
        left.merge(&right);
        let moved = left.shifted(shift);
        assert!((moved.mean() - all.mean()).norm() < 1e-12);
        assert!((moved.covariance() - all.covariance()).norm() < 1e-9);
    }

    #[test]
    fn the_thinnest_axis_of_a_plane_is_its_normal() {
        let normal = Vector3::new(1.0, 2.0, -2.0) / 3.0;
        let (u, v) = (
            Vector3::new(2.0, -1.0, 0.0).normalize(),
            normal.cross(&Vector3::new(2.0, -1.0, 0.0).normalize()),
        );
        let mut moments = Moments::default();
        for i in 0..10 {
            for j in 0..7 {
                moments.add(u * f64::from(i) + v * f64::from(j) * 0.5 + normal * 4.0);
            }
        }
        let axes = moments.axes();
        assert!(axes.directions[0].dot(&normal).abs() > 1.0 - 1e-12);
        assert!(axes.variances[0] < 1e-12 && axes.variances[1] < axes.variances[2]);
    }
}
