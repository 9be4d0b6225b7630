//! Colours that points take from pictures.

use rayon::prelude::*;

use crate::image::rasterizer::{Drawing, Picture, Place};
use crate::image::scan_mesh::{Surface, range_of};

/// Points that are blended together.
const BLOCK: usize = 1 << 14;

/// The colour that a point would take from one picture.
pub struct Taken {
    /// Of the surface's points.
    pub point: u32,
    /// Positive.
    pub weight: f32,
    /// Red, green, blue, 0 to 255.
    pub color: [f32; 3],
}

/// What the points that a camera sees take from its picture, in the order of the points.
///
/// Weights fall smoothly to zero over `border`, a share of half the picture, with no kink that a feature could sit on.
pub fn sample(
    surface: &Surface,
    picture: &Picture,
    drawing: &Drawing,
    image: &[[u8; 3]],
    border: f32,
) -> Vec<Taken> {
    let camera = picture.camera;
    let (width, height) = (camera.width as f32, camera.height as f32);
    let period = camera.period().map(|turn| turn as f32);
    let pixels_per_radian = camera.pixels_per_radian() as f32;
    let ramp = |place: f32, size: f32| {
        let inside = (place + 0.5).min(size - 0.5 - place) / (border * size / 2.0);
        let t = inside.clamp(0.0, 1.0);
        t * t * (3.0 - 2.0 * t)
    };
    let noise = 5.0 * surface.range_noise as f32;
    let taken = |place: &Place| {
        let [mut x, y] = place.pixel;
        if let Some(turn) = period {
            x = ((x + 0.5).rem_euclid(turn) - 0.5).min(width - 0.501);
        }
        if !(x >= -0.5 && x < width - 0.5 && y >= -0.5 && y < height - 0.5) {
            return None;
        }
        let around = Around::new(camera.width, camera.height, x, y);
        let nearest = drawing.nearest[around.closest()];
        let before = nearest.max(around.depth(&drawing.shown, &drawing.nearest));
        let slack = surface.step as f32 * range_of(&surface.points[place.point as usize]);
        if place.distance > before + slack.max(noise) {
            return None;
        }
        // A picture that shows the point twice as large knows its colour four times as well.
        let mut weight = (pixels_per_radian / place.distance.max(1e-3)).powi(2) * ramp(y, height);
        if period.is_none() {
            weight *= ramp(x, width);
        }
        (weight > 0.0).then(|| Taken {
            point: place.point,
            weight,
            color: around.color(image),
        })
    };
    drawing.places.par_iter().filter_map(taken).collect()
}

/// The four pixels around a place, and how far it lies from the first one.
struct Around {
    /// Upper left, upper right, lower left, lower right.
    pixels: [usize; 4],
    across: f32,
    down: f32,
}

impl Around {
    fn new(width: usize, height: usize, x: f32, y: f32) -> Self {
        let first = |place: f32, size: usize| (place.max(0.0) as usize).min(size.saturating_sub(2));
        let (left, top) = (first(x, width), first(y, height));
        let (right, bottom) = ((left + 1).min(width - 1), (top + 1).min(height - 1));
        Self {
            pixels: [(top, left), (top, right), (bottom, left), (bottom, right)]
                .map(|(row, column)| row * width + column),
            across: x - left as f32,
            down: y - top as f32,
        }
    }

    fn closest(&self) -> usize {
        self.pixels[usize::from(self.across > 0.5) + 2 * usize::from(self.down > 0.5)]
    }

    /// Depth between the pixels; zero where one of them is empty, and across a jump, where nothing lies between.
    fn depth(&self, shown: &[f32], nearest: &[f32]) -> f32 {
        let around = self.pixels.map(|pixel| nearest[pixel]);
        let low = around.iter().copied().fold(f32::INFINITY, f32::min);
        let high = around.iter().copied().fold(0.0, f32::max);
        if high.is_infinite() || high - low > 0.2 * low {
            return 0.0;
        }
        // Inverse depths of a plane are linear over the picture; those of nothing are zero.
        let [a, b, c, d] = self.pixels.map(|pixel| 1.0 / shown[pixel]);
        let mix = |left: f32, right: f32| (1.0 - self.across) * left + self.across * right;
        1.0 / ((1.0 - self.down) * mix(a, b) + self.down * mix(c, d))
    }

    fn color(&self, image: &[[u8; 3]]) -> [f32; 3] {
        let (across, down) = (self.across.clamp(0.0, 1.0), self.down.clamp(0.0, 1.0));
        let corners = self.pixels.map(|pixel| image[pixel].map(f32::from));
        std::array::from_fn(|k| {
            let upper = corners[0][k] * (1.0 - across) + corners[1][k] * across;
            let lower = corners[2][k] * (1.0 - across) + corners[3][k] * across;
            upper * (1.0 - down) + lower * down
        })
    }
}

/// Mean colour that each of the scan's points takes from the pictures, brought to one exposure by factors on red, green
/// and blue; `None` where it takes none. In the order in which the surface was given its points.
pub fn blend(surface: &Surface, pictures: &[(&[Taken], [f32; 3])]) -> Vec<Option<[u8; 3]>> {
    let count = surface.source.len();
    let mut mixed: Vec<Option<[u8; 3]>> = vec![None; count];
    let mix = |(block, mixed): (usize, &mut [Option<[u8; 3]>])| {
        let first = block * BLOCK;
        let mut sums = vec![([0.0_f32; 3], 0.0_f32); mixed.len()];
        for (taken, gain) in pictures {
            let begin = taken.partition_point(|one| (one.point as usize) < first);
            let within = |one: &&Taken| (one.point as usize) < first + BLOCK;
            for one in taken[begin..].iter().take_while(within) {
                let (sum, weight) = &mut sums[one.point as usize - first];
                for k in 0..3 {
                    sum[k] += one.weight * one.color[k] * gain[k];
                }
                *weight += one.weight;
            }
        }
        for (color, (sum, weight)) in mixed.iter_mut().zip(sums) {
            if weight > 0.0 {
                *color = Some(sum.map(|v| (v / weight).round_ties_even() as u8));
            }
        }
    };
    mixed.par_chunks_mut(BLOCK).enumerate().for_each(mix);
    let mut colors = vec![None; count];
    for (&point, color) in surface.source.iter().zip(mixed) {
        colors[point as usize] = color;
    }
    colors
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::scan_mesh::tests::wall_and_board;

    #[test]
    fn colours_are_weighted_means_in_the_order_that_points_were_given() {
        let (image, mut xyz) = wall_and_board(None);
        // A second point in a cell that is taken has no cell of its own.
        xyz.push(xyz[0]);
        let surface = Surface::new(image, xyz);
        let taken = |given: usize, weight: f32, level: f32| Taken {
            point: surface
                .source
                .iter()
                .position(|&of| of as usize == given)
                .unwrap() as u32,
            weight,
            color: [level, 10.0, 20.0],
        };
        let last = surface.source.len() - 1;
        let first = [taken(3, 1.0, 100.0), taken(last, 2.0, 40.0)];
        let second = [taken(3, 3.0, 25.0)];
        let pictures = [(&first[..], [1.0; 3]), (&second[..], [2.0, 1.0, 1.0])];
        let colors = blend(&surface, &pictures);
        // (100 + 3 * 25 * 2) / 4.
        assert_eq!(colors[3], Some([62, 10, 20]));
        assert_eq!(colors[last], Some([40, 10, 20]));
        assert_eq!(colors.iter().flatten().count(), 2);
    }

    #[test]
    fn nothing_lies_between_pixels_across_a_jump() {
        let around = Around::new(2, 2, 0.5, 0.5);
        assert!((around.depth(&[4.0; 4], &[4.0; 4]) - 4.0).abs() < 1e-6);
        assert_eq!(around.depth(&[4.0; 4], &[4.0, 3.0, 4.0, 4.0]), 0.0);
        assert_eq!(
            around.depth(&[4.0; 4], &[4.0, f32::INFINITY, 4.0, 4.0]),
            0.0
        );
    }
}
