//! A surface as a camera sees it: what shows in each pixel, what is hidden, and where the points fall.

use std::ops::Range;

use nalgebra::{Matrix3, Vector3};
use rayon::prelude::*;

use crate::image::camera::{Camera, Lens};
use crate::image::scan_mesh::{Surface, range_of};
use crate::scan::range_image::NO_POINT;

/// Depths that differ by less than this many standard deviations of a range ...
const SAME_SIGMAS: f64 = 4.0;
/// ... or this share of a spacing are of one surface, measured several times: their mean is taken.
const SAME_SPACINGS: f64 = 0.25;
/// Splats are not wider than so many pixels to each side.
const WIDEST_SPLAT: f32 = 48.0;
/// Corners of a triangle that shows lie within this angle (rad) of what a pixel looks along ...
const BESIDE: f64 = 0.2;
/// ... and so many steps between beams as they are seen from the camera.
const BESIDE_STEPS: f64 = 4.0;
/// Rows of the scan that are drawn together.
const ROWS: usize = 16;
/// Points without a cell that are drawn together.
const LOOSE: usize = 1 << 16;

/// A picture's geometry.
pub struct Picture<'a> {
    pub camera: Camera,
    /// The camera's axes and centre in the frame of the points.
    pub rotation: Matrix3<f64>,
    pub centre: Vector3<f64>,
    /// Unit direction of each pixel, row by row, camera coordinates; NaN where the lens shows nothing.
    pub rays: &'a [[f64; 3]],
}

/// Where a point falls.
#[derive(Clone, Copy)]
pub struct Place {
    pub point: u32,
    /// Column and row, also outside the picture.
    pub pixel: [f32; 2],
    /// From the camera (m).
    pub distance: f32,
}

impl Place {
    const NONE: Self = Self {
        point: NO_POINT,
        pixel: [0.0; 2],
        distance: 0.0,
    };
}

/// What a camera sees of a surface.
pub struct Drawing {
    /// Distance (m) of the surface in the middle of each pixel; infinite where none is known.
    pub shown: Vec<f32>,
    /// Distance (m) of the nearest thing that may hide others there, the surface or the rim of one; infinite for none.
    pub nearest: Vec<f32>,
    /// The scan's points that may fall into the picture, in their order.
    pub places: Vec<Place>,
}

/// Draws the surface into a picture. The result does not depend on the number of threads.
pub fn draw(surface: &Surface, picture: &Picture) -> Drawing {
    let pen = Pen::new(surface, picture);
    let starts: Vec<usize> = (0..surface.rows).step_by(ROWS).collect();
    let mut strips: Vec<Strip> = starts
        .into_par_iter()
        .map(|start| pen.strip(start..(start + ROWS).min(surface.rows)))
        .collect();
    let loose: Vec<usize> = (surface.in_cells..surface.source.len()).collect();
    strips.par_extend(loose.par_chunks(LOOSE).map(|points| {
        let places = points.iter().filter_map(|&point| pen.place(point as u32));
        Strip {
            places: places.collect(),
            ..Strip::default()
        }
    }));

    let pixels = picture.camera.width * picture.camera.height;
    let mut nearest = vec![f32::INFINITY; pixels];
    for &(pixel, depth) in strips.iter().flat_map(|strip| &strip.hits) {
        let cell = &mut nearest[pixel as usize];
        *cell = cell.min(depth);
    }
    let mut sums = vec![(0.0_f64, 0_u32); pixels];
    for &(pixel, depth) in strips.iter().flat_map(|strip| &strip.hits) {
        let depth = f64::from(depth);
        let same = (SAME_SIGMAS * surface.range_noise).max(SAME_SPACINGS * surface.step * depth);
        if depth - f64::from(nearest[pixel as usize]) <= same {
            let (sum, count) = &mut sums[pixel as usize];
            *sum += depth;
            *count += 1;
        }
    }
    let mean = |(sum, count): (f64, u32)| {
        if count > 0 {
            (sum / f64::from(count)) as f32
        } else {
            f32::INFINITY
        }
    };
    for rim in strips.iter().flat_map(|strip| &strip.rims) {
        pen.splat(rim, &mut nearest);
    }
    Drawing {
        shown: sums.into_par_iter().map(mean).collect(),
        nearest,
        places: strips.into_iter().flat_map(|strip| strip.places).collect(),
    }
}

impl Drawing {
    /// Distances as `shown`, infinite also where the rim of something nearer may hide the surface.
    pub fn unhidden(&self, surface: &Surface) -> Vec<f32> {
        let (noise, step) = (5.0 * surface.range_noise as f32, surface.step as f32);
        let unhidden = |(&shown, &nearest): (&f32, &f32)| {
            let hidden = nearest < shown - noise.max(step * shown);
            if hidden { f32::INFINITY } else { shown }
        };
        let depths = self.shown.par_iter().zip(&self.nearest);
        depths.map(unhidden).collect()
    }
}

/// The point at a distance (m) along the ray of each pixel; NaN for infinite ones.
pub fn points_at(picture: &Picture, distances: &[f32]) -> Vec<[f32; 3]> {
    let point = |(&distance, &ray): (&f32, &[f64; 3])| {
        if distance.is_infinite() {
            return [f32::NAN; 3];
        }
        let offset = picture.rotation * Vector3::from(ray) * f64::from(distance);
        (picture.centre + offset).map(|v| v as f32).into()
    };
    let seen = distances.par_iter().zip(picture.rays);
    seen.map(point).collect()
}

/// What part of a surface gives.
#[derive(Default)]
struct Strip {
    places: Vec<Place>,
    /// Pixels that lie in a triangle, and its depth there.
    hits: Vec<(u32, f32)>,
    /// Points beside which the surface ends.
    rims: Vec<Place>,
}

/// About the view of a camera: beyond lies nothing that shows, nor a corner of a triangle that does.
struct Cone {
    centre: [f32; 3],
    axis: [f32; 3],
    /// Cosine of the angle between axis and side.
    least: f32,
    /// By how much the cone is wider, per metre from the scanner; and metres from the scanner to the centre.
    wider: f32,
    offset: f32,
}

impl Cone {
    fn new(surface: &Surface, picture: &Picture) -> Self {
        let least = picture.rays.iter().map(|ray| ray[2]).fold(1.0, f64::min);
        let widest = (least.clamp(-1.0, 1.0).acos() + BESIDE).min(std::f64::consts::PI);
        Self {
            centre: picture.centre.map(|v| v as f32).into(),
            axis: picture.rotation.column(2).map(|v| v as f32).into(),
            least: widest.cos() as f32,
            wider: (BESIDE_STEPS * surface.step) as f32,
            offset: picture.centre.norm() as f32,
        }
    }

    fn reaches(&self, point: &[f32; 3]) -> bool {
        let offset: [f32; 3] = std::array::from_fn(|k| point[k] - self.centre[k]);
        let along: f32 = (0..3).map(|k| offset[k] * self.axis[k]).sum();
        let distance = range_of(&offset);
        along > 1e-6 && along + self.wider * (distance + self.offset) >= self.least * distance
    }
}

/// Where the points of a row fall, and between which columns there are any.
struct Line {
    places: Vec<Place>,
    span: Range<usize>,
}

struct Pen<'a> {
    surface: &'a Surface,
    picture: &'a Picture<'a>,
    camera: Camera,
    width: f32,
    height: f32,
    period: Option<f32>,
    pixels_per_radian: f32,
    /// What may show; panoramas look everywhere.
    cone: Option<Cone>,
    camera_from_surface: Matrix3<f64>,
}

impl<'a> Pen<'a> {
    fn new(surface: &'a Surface, picture: &'a Picture<'a>) -> Self {
        let camera = picture.camera;
        let pinhole = matches!(camera.lens, Lens::Pinhole { .. });
        Self {
            surface,
            picture,
            camera,
            width: camera.width as f32,
            height: camera.height as f32,
            period: camera.period().map(|turn| turn as f32),
            pixels_per_radian: camera.pixels_per_radian() as f32,
            cone: pinhole.then(|| Cone::new(surface, picture)),
            camera_from_surface: picture.rotation.transpose(),
        }
    }

    /// A point from the camera, in its axes.
    fn seen(&self, point: u32) -> Vector3<f64> {
        let point = Vector3::from(self.surface.points[point as usize].map(f64::from));
        self.camera_from_surface * (point - self.picture.centre)
    }

    /// Where a point falls; `None` if that is far outside the picture.
    fn place(&self, point: u32) -> Option<Place> {
        let reached = |cone: &Cone| cone.reaches(&self.surface.points[point as usize]);
        if !self.cone.as_ref().is_none_or(reached) {
            return None;
        }
        let seen = self.seen(point);
        Some(Place {
            point,
            pixel: self.camera.project(seen.into())?.map(|v| v as f32),
            distance: seen.norm() as f32,
        })
    }

    /// Places the points of a row.
    fn place_row(&self, row: usize, line: &mut Line) {
        line.places[line.span.clone()].fill(Place::NONE);
        let (mut first, mut end) = (usize::MAX, 0);
        for (column, &point) in self.surface.row(row).iter().enumerate() {
            if point != NO_POINT
                && let Some(place) = self.place(point)
            {
                line.places[column] = place;
                (first, end) = (first.min(column), column + 1);
            }
        }
        line.span = first.min(end)..end;
    }

    fn strip(&self, rows: Range<usize>) -> Strip {
        let surface = self.surface;
        let mut strip = Strip::default();
        let [mut here, mut below] = [(); 2].map(|()| Line {
            places: vec![Place::NONE; surface.columns],
            span: 0..0,
        });
        self.place_row(rows.start, &mut below);
        for row in rows {
            std::mem::swap(&mut here, &mut below);
            for column in here.span.clone() {
                let place = here.places[column];
                if place.point == NO_POINT {
                    continue;
                }
                if (place.point as usize) < surface.in_cells {
                    strip.places.push(place);
                }
                if surface.ends_at(row, column) {
                    strip.rims.push(place);
                }
            }
            if row + 1 == surface.rows {
                break;
            }
            self.place_row(row + 1, &mut below);
            let first = here.span.start.min(below.span.start);
            for column in first..here.span.end.max(below.span.end) {
                let next = surface.next(column);
                for triangle in surface.triangles(row, column) {
                    let around = [
                        &here.places[column],
                        &here.places[next],
                        &below.places[next],
                        &below.places[column],
                    ];
                    let corners = triangle.map(|k| around[k]);
                    if corners.iter().all(|place| place.point != NO_POINT) {
                        self.fill(corners, &mut strip.hits);
                    }
                }
            }
        }
        strip
    }

    /// Finds the pixels whose centres lie in a triangle; of a full panorama also one turn to each side.
    fn fill(&self, corners: [&Place; 3], hits: &mut Vec<(u32, f32)>) {
        let mut pixels = corners.map(|place| place.pixel);
        let Some(period) = self.period else {
            return self.fill_at(corners, pixels, hits);
        };
        for k in 1..3 {
            let turns = ((pixels[k][0] - pixels[0][0]) / period).round();
            pixels[k][0] -= turns * period;
        }
        for shift in [0.0, period, -period] {
            self.fill_at(corners, pixels.map(|[x, y]| [x + shift, y]), hits);
        }
    }

    fn fill_at(&self, corners: [&Place; 3], pixels: [[f32; 2]; 3], hits: &mut Vec<(u32, f32)>) {
        let [a, b, c] = pixels;
        let span = |k: usize, size: f32| {
            let low = a[k].min(b[k]).min(c[k]).max(0.0);
            let high = a[k].max(b[k]).max(c[k]).min(size - 1.0);
            if low > high {
                return None;
            }
            // Rounded up by hand: baseline processors have no instruction for it, and most triangles end here.
            let first = low as usize + usize::from((low as usize as f32) < low);
            Some(first..high as usize + 1)
        };
        let Some((columns, rows)) = span(0, self.width).zip(span(1, self.height)) else {
            return;
        };
        if columns.is_empty() || rows.is_empty() {
            return;
        }
        let area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
        if area == 0.0 || !area.is_finite() {
            return;
        }
        let distances = corners.map(|place| place.distance);
        let least = distances.iter().copied().fold(f32::INFINITY, f32::min);
        let most = distances.iter().copied().fold(0.0, f32::max);
        let [p, q, r] = corners.map(|place| self.seen(place.point));
        let normal = (q - p).cross(&(r - p));
        let height = normal.dot(&p);
        for row in rows {
            for column in columns.clone() {
                let (x, y) = (column as f32, row as f32);
                let w0 = ((b[0] - x) * (c[1] - y) - (b[1] - y) * (c[0] - x)) / area;
                let w1 = ((c[0] - x) * (a[1] - y) - (c[1] - y) * (a[0] - x)) / area;
                let w2 = 1.0 - w0 - w1;
                const OUTSIDE: f32 = -1e-5;
                if w0 < OUTSIDE || w1 < OUTSIDE || w2 < OUTSIDE {
                    continue;
                }
                let pixel = row * self.camera.width + column;
                let ray = self.picture.rays[pixel];
                let met = (height / normal.dot(&Vector3::from(ray))) as f32;
                // A triangle seen edge-on has no depth of its own along the ray: then its corners' are mixed.
                let depth = if met >= least && met <= most {
                    met
                } else {
                    1.0 / (w0 / distances[0] + w1 / distances[1] + w2 / distances[2])
                };
                if depth.is_finite() && ray[0].is_finite() {
                    hits.push((pixel as u32, depth));
                }
            }
        }
    }

    /// Lets a point at a rim hide what lies behind it, half a spacing around.
    fn splat(&self, rim: &Place, nearest: &mut [f32]) {
        let [x, y] = rim.pixel;
        let spacing =
            0.5 * self.surface.step as f32 * range_of(&self.surface.points[rim.point as usize]);
        let radius = spacing / rim.distance * self.pixels_per_radian;
        let radius = radius.clamp(0.5, WIDEST_SPLAT);
        let top = (y - radius).ceil().max(0.0);
        let bottom = (y + radius).floor().min(self.height - 1.0);
        if bottom < top {
            return;
        }
        for row in top as usize..=bottom as usize {
            let half = (radius * radius - (row as f32 - y).powi(2)).max(0.0).sqrt();
            let left = (x - half).ceil().max(0.0);
            let right = (x + half).floor().min(self.width - 1.0);
            if right < left {
                continue;
            }
            for column in left as usize..=right as usize {
                let cell = &mut nearest[row * self.camera.width + column];
                *cell = cell.min(rim.distance);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::camera::Distortion;
    use crate::image::scan_mesh::tests::wall_and_board;
    use crate::scan::range_image::IndexImage;

    fn seen_from(surface: &Surface, centre: [f64; 3], focal: f64) -> Drawing {
        let lens = Lens::Pinhole {
            focal: [focal; 2],
            centre: [59.5, 44.5],
            distortion: Distortion {
                coefficients: [0.0; 5],
                fold: f64::INFINITY,
            },
        };
        let camera = Camera::new(lens, 120, 90);
        let ray = |at: usize| camera.ray([(at % 120) as f64, (at / 120) as f64]).unwrap();
        let rays: Vec<[f64; 3]> = (0..120 * 90).map(ray).collect();
        let picture = Picture {
            camera,
            rotation: Matrix3::identity(),
            centre: centre.into(),
            rays: &rays,
        };
        draw(surface, &picture)
    }

    #[test]
    fn every_pixel_knows_the_plane_it_shows() {
        let (image, xyz) = wall_and_board(None);
        let surface = Surface::new(image, xyz);
        let centre = [0.2, -0.1, 0.0];
        let drawing = seen_from(&surface, centre, 200.0);
        let mut known = 0;
        for (at, &distance) in drawing.shown.iter().enumerate() {
            if distance.is_finite() {
                let ray = [
                    ((at % 120) as f32 - 59.5) / 200.0,
                    ((at / 120) as f32 - 44.5) / 200.0,
                    1.0,
                ];
                let depth = distance / range_of(&ray);
                assert!(
                    (depth - 3.0).abs() < 1e-4 || (depth - 5.0).abs() < 1e-4,
                    "{depth}"
                );
                known += 1;
            }
        }
        assert!(known > 120 * 90 * 8 / 10, "{known}");
    }

    #[test]
    fn the_board_hides_half_a_spacing_more_than_its_mesh() {
        let (image, xyz) = wall_and_board(None);
        let surface = Surface::new(image, xyz);
        let drawing = seen_from(&surface, [0.0; 3], 200.0);
        let before = |depths: &[f32]| depths.iter().filter(|&&d| d < 3.9).count();
        assert!(before(&drawing.nearest) > before(&drawing.shown) + 90);
        assert!(
            drawing
                .nearest
                .iter()
                .zip(&drawing.shown)
                .all(|(n, s)| n <= s)
        );
    }

    #[test]
    fn the_number_of_threads_changes_nothing() {
        let run = |threads| {
            rayon::ThreadPoolBuilder::new()
                .num_threads(threads)
                .build()
                .unwrap()
                .install(|| {
                    let (image, xyz) = wall_and_board(None);
                    let surface = Surface::new(image, xyz);
                    let drawing = seen_from(&surface, [0.2, -0.1, 0.0], 200.0);
                    (drawing.shown, drawing.nearest)
                })
        };
        assert_eq!(run(1), run(3));
    }

    #[test]
    fn no_points_no_surface() {
        let surface = Surface::new(IndexImage::by_projection(&[], 0.01), Vec::new());
        let drawing = seen_from(&surface, [0.0; 3], 100.0);
        assert!(drawing.places.is_empty());
        assert!(drawing.nearest.iter().all(|d| d.is_infinite()));
    }
}
