//! What a scanner saw all around it, drawn on the six faces of a cube: no direction is a pole.

/// Faces: +x, -x, +y, -y, +z, -z.
pub const FACES: usize = 6;
/// Points of a cell this much farther than its nearest one are of another surface, which shows through gaps.
const BEHIND: f32 = 1.05;

/// Row-major faces one after the other, `side` cells along each side.
pub struct CubeMap {
    pub side: usize,
    /// Mean grey value of the nearest surface in the cell; 0 where nothing was seen.
    pub paint: Vec<f32>,
    /// Range (m) of the cell's nearest point; 0 where nothing was seen.
    pub range: Vec<f32>,
}

/// Draws scanner-centred points; `paint` gives the grey value of a point.
///
/// On the face of axis `k` rows follow the axis `k + 2` and columns the axis `k + 1` (modulo 3), both from -1 to 1.
pub fn draw(xyz: &[[f32; 3]], paint: impl Fn(usize) -> f32, side: usize) -> CubeMap {
    let cells = FACES * side * side;
    let mut range = vec![0.0_f32; cells];
    let mut sums = vec![(0.0_f32, 0_u32); cells];
    for (index, &p) in xyz.iter().enumerate() {
        let Some(cell) = cell(p, side) else { continue };
        let here = (p[0] * p[0] + p[1] * p[1] + p[2] * p[2]).sqrt();
        let nearest = range[cell];
        if nearest == 0.0 || here * BEHIND < nearest {
            range[cell] = here;
            sums[cell] = (paint(index), 1);
        } else if here <= nearest * BEHIND {
            range[cell] = nearest.min(here);
            sums[cell].0 += paint(index);
            sums[cell].1 += 1;
        }
    }
    let paint = sums
        .iter()
        .map(|&(sum, count)| sum / count.max(1) as f32)
        .collect();
    CubeMap { side, paint, range }
}

/// The cell that a direction falls in; `None` for the scanner itself and for what is no number.
fn cell(p: [f32; 3], side: usize) -> Option<usize> {
    let [x, y, z] = p.map(f32::abs);
    let axis = if x >= y && x >= z {
        0
    } else if y >= z {
        1
    } else {
        2
    };
    let depth = p[axis].abs();
    if !(depth > 0.0 && p.iter().all(|v| v.is_finite())) {
        return None;
    }
    let place = |value: f32| {
        let position = (value / depth + 1.0) * 0.5 * side as f32;
        (position as usize).min(side - 1)
    };
    let face = 2 * axis + usize::from(p[axis] < 0.0);
    let (column, row) = (place(p[(axis + 1) % 3]), place(p[(axis + 2) % 3]));
    Some((face * side + row) * side + column)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_direction_has_the_face_of_its_longest_coordinate() {
        let map = draw(
            &[[2.0, 0.1, -0.1], [-3.0, 0.0, 0.0], [0.0, 0.0, 4.0]],
            |i| i as f32 + 1.0,
            8,
        );
        let seen: Vec<(usize, f32, f32)> = (0..FACES * 64)
            .filter(|&c| map.range[c] > 0.0)
            .map(|c| (c, map.paint[c], map.range[c]))
            .collect();
        // y = 0.1 of 2 is just right of the middle, z = -0.1 of 2 just above it.
        assert_eq!(seen[0].0, 3 * 8 + 4);
        assert_eq!(seen[0].1, 1.0);
        assert_eq!((seen[1].0 / 64, seen[1].1, seen[1].2), (1, 2.0, 3.0));
        assert_eq!((seen[2].0 / 64, seen[2].1, seen[2].2), (4, 3.0, 4.0));
    }

    #[test]
    fn a_cell_shows_the_mean_of_its_nearest_surface() {
        for order in [[0, 1, 2], [2, 1, 0], [1, 2, 0]] {
            let points = [[5.0, 0.01, 0.01], [2.0, 0.01, 0.01], [2.02, 0.01, 0.01]];
            let paint = [100.0, 10.0, 30.0];
            let map = draw(&order.map(|i| points[i]), |i| paint[order[i]], 4);
            let cell = (0..16).find(|&c| map.range[c] > 0.0).expect("one cell");
            assert_eq!(map.paint[cell], 20.0);
            assert!((map.range[cell] - 2.0).abs() < 1e-3);
        }
    }

    #[test]
    fn what_is_no_direction_is_left_out() {
        let map = draw(
            &[[0.0; 3], [f32::NAN, 1.0, 1.0], [f32::INFINITY, 1.0, 1.0]],
            |_| 1.0,
            4,
        );
        assert!(map.range.iter().all(|&r| r == 0.0));
    }
}
