//! A k-d tree for nearest neighbours without a limit of distance.

/// Points a leaf.
const LEAF: usize = 12;

/// The nearest of the points.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Neighbour {
    pub index: u32,
    pub point: [f32; 3],
    /// Squared distance (m^2).
    pub square: f32,
}

/// Points sorted so that every node is a stretch of them, halved at its middle along its longest side.
pub struct Tree {
    points: Vec<[f32; 3]>,
    /// Index that each point had.
    order: Vec<u32>,
    /// Axis and value that part each inner node, in the order of a heap.
    splits: Vec<(u8, f32)>,
    /// Least and greatest coordinates.
    bounds: [[f32; 3]; 2],
}

impl Tree {
    pub fn new(points: &[[f32; 3]]) -> Self {
        let mut items: Vec<([f32; 3], u32)> = points
            .iter()
            .enumerate()
            .filter(|(_, p)| p.iter().all(|v| v.is_finite()))
            .map(|(index, &point)| (point, index as u32))
            .collect();
        let bound = |pick: fn(f32, f32) -> f32, from: f32| {
            std::array::from_fn(|axis| items.iter().map(|i| i.0[axis]).fold(from, pick))
        };
        let bounds = [bound(f32::min, f32::MAX), bound(f32::max, f32::MIN)];
        let mut splits = Vec::new();
        split(&mut items, 0, &mut splits);
        Self {
            points: items.iter().map(|i| i.0).collect(),
            order: items.iter().map(|i| i.1).collect(),
            splits,
            bounds,
        }
    }

    /// The nearest point that is nearer than `max_distance` (m); the lowest index of equals.
    pub fn nearest(&self, query: [f32; 3], max_distance: f32) -> Option<Neighbour> {
        let mut best = Neighbour {
            index: u32::MAX,
            point: query,
            square: max_distance * max_distance,
        };
        if query.iter().all(|v| v.is_finite()) {
            let [low, high] = self.bounds;
            let away =
                std::array::from_fn(|k| (low[k] - query[k]).max(query[k] - high[k]).max(0.0));
            self.search(&query, (0, 0, self.points.len()), away, &mut best);
        }
        (best.index != u32::MAX).then_some(best)
    }

    /// Look through a node, its number and stretch of points, whose box is `away` from the query along each axis.
    fn search(
        &self,
        query: &[f32; 3],
        (node, from, to): (usize, usize, usize),
        away: [f32; 3],
        best: &mut Neighbour,
    ) {
        // Rounded as distances are, so a point in the box cannot be nearer than this says.
        if away[0] * away[0] + away[1] * away[1] + away[2] * away[2] > best.square {
            return;
        }
        if to - from <= LEAF {
            for slot in from..to {
                let p = &self.points[slot];
                let d = [p[0] - query[0], p[1] - query[1], p[2] - query[2]];
                let square = d[0] * d[0] + d[1] * d[1] + d[2] * d[2];
                let index = self.order[slot];
                let first = square == best.square && best.index != u32::MAX && index < best.index;
                if square < best.square || first {
                    *best = Neighbour {
                        index,
                        point: *p,
                        square,
                    };
                }
            }
            return;
        }
        let (axis, value) = self.splits[node];
        let middle = from + (to - from) / 2;
        let offset = query[usize::from(axis)] - value;
        let (low, high) = ((2 * node + 1, from, middle), (2 * node + 2, middle, to));
        let (near, far) = if offset < 0.0 {
            (low, high)
        } else {
            (high, low)
        };
        let mut beyond = away;
        beyond[usize::from(axis)] = offset.abs();
        self.search(query, near, away, best);
        self.search(query, far, beyond, best);
    }
}

fn split(items: &mut [([f32; 3], u32)], node: usize, splits: &mut Vec<(u8, f32)>) {
    if items.len() <= LEAF {
        return;
    }
    let side = |axis: usize| {
        let values = items.iter().map(|i| i.0[axis]);
        values.clone().fold(f32::MIN, f32::max) - values.fold(f32::MAX, f32::min)
    };
    let axis = (0..3)
        .max_by(|&a, &b| side(a).total_cmp(&side(b)))
        .expect("three axes");
    let middle = items.len() / 2;
    items.select_nth_unstable_by(middle, |a, b| {
        a.0[axis].total_cmp(&b.0[axis]).then(a.1.cmp(&b.1))
    });
    if splits.len() <= node {
        splits.resize(node + 1, (0, 0.0));
    }
    splits[node] = (axis as u8, items[middle].0[axis]);
    let (low, high) = items.split_at_mut(middle);
    split(low, 2 * node + 1, splits);
    split(high, 2 * node + 2, splits);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::scattered;

    #[test]
    fn nearest_agrees_with_trying_every_point() {
        // A coarse grid has many equal coordinates and equal distances.
        for steps in [8.0, 1e6] {
            let points = scattered(3000, 1, steps);
            let tree = Tree::new(&points);
            for query in scattered(300, 2, steps) {
                for max_distance in [0.2_f32, f32::INFINITY] {
                    let expected = points
                        .iter()
                        .enumerate()
                        .map(|(i, p)| {
                            let d: [f32; 3] = std::array::from_fn(|a| p[a] - query[a]);
                            (d[0] * d[0] + d[1] * d[1] + d[2] * d[2], i as u32)
                        })
                        .filter(|e| e.0 < max_distance * max_distance)
                        .min_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)))
                        .map(|e| (e.1, e.0));
                    let found = tree
                        .nearest(query, max_distance)
                        .map(|n| (n.index, n.square));
                    assert_eq!(found, expected);
                }
            }
        }
    }

    #[test]
    fn no_points_and_no_numbers_give_nothing() {
        assert_eq!(Tree::new(&[]).nearest([0.0; 3], f32::INFINITY), None);
        assert_eq!(Tree::new(&[[f32::NAN; 3]]).nearest([0.0; 3], 1.0), None);
        assert_eq!(Tree::new(&[[0.0; 3]]).nearest([f32::NAN; 3], 1.0), None);
    }
}
