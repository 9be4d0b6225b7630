//! From camera coordinates to pixels and back: pinhole with Brown's distortion, spherical, cylindrical.
//!
//! Camera axes are x right, y down, z along the view; pixel centres lie at integers.

/// Share by which the field of view is enlarged where a lens model is still trusted, so that surfaces cross the border.
const MARGIN: f64 = 1.15;
const NEWTON_STEPS: usize = 8;
/// Of coordinates in the plane z = 1: no pixel is so fine.
const CLOSE: f64 = 1e-13;
/// Square of the largest radius in the plane z = 1 that is worked with.
const LARGEST: f64 = 1e4;
/// Points along each side of the picture at which its field of view is told.
const ALONG_BORDER: usize = 33;

/// Brown's model: radial k1, k2, k3 and tangential p1, p2, on coordinates in the plane z = 1.
#[derive(Clone, Copy, Debug)]
pub struct Distortion {
    /// k1, k2, p1, p2, k3.
    pub coefficients: [f64; 5],
    /// Square of the radius at which the radial polynomial stops growing: beyond it pixels mean nothing.
    pub fold: f64,
}

impl Distortion {
    fn is_none(&self) -> bool {
        self.coefficients.iter().all(|&k| k == 0.0)
    }

    fn limit(&self) -> f64 {
        self.fold.min(LARGEST)
    }

    fn distorted(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        let [k1, k2, p1, p2, k3] = self.coefficients;
        let r2 = x * x + y * y;
        let radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3));
        [
            x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
            y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y,
        ]
    }

    /// The coordinates whose distorted ones these are, by Newton's method; `None` if there are none.
    fn undistorted(&self, goal: [f64; 2]) -> Option<[f64; 2]> {
        if self.is_none() {
            return Some(goal);
        }
        let [k1, k2, p1, p2, k3] = self.coefficients;
        let limit = self.limit().sqrt();
        let within = |[x, y]: [f64; 2], radius: f64| {
            let shrink = (radius / x.hypot(y).max(1e-12)).min(1.0);
            [x * shrink, y * shrink]
        };
        // Begin inside the fold, where the model is one to one.
        let mut at = within(goal, 0.95 * limit);
        for _ in 0..NEWTON_STEPS {
            let [x, y] = at;
            let [u, v] = self.distorted(at);
            let (off_x, off_y) = (u - goal[0], v - goal[1]);
            if off_x.abs().max(off_y.abs()) < CLOSE {
                break;
            }
            let r2 = x * x + y * y;
            let radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3));
            let slope = 2.0 * (k1 + r2 * (2.0 * k2 + 3.0 * k3 * r2));
            let xx = radial + slope * x * x + 2.0 * p1 * y + 6.0 * p2 * x;
            let yy = radial + slope * y * y + 6.0 * p1 * y + 2.0 * p2 * x;
            let xy = slope * x * y + 2.0 * p1 * x + 2.0 * p2 * y;
            let det = xx * yy - xy * xy;
            let det = if det.abs() < 1e-9 { 1e-9 } else { det };
            let next = [
                x - (yy * off_x - xy * off_y) / det,
                y - (xx * off_y - xy * off_x) / det,
            ];
            at = within(next, limit);
        }
        let [u, v] = self.distorted(at);
        ((u - goal[0]).hypot(v - goal[1]) < 1e-6).then_some(at)
    }
}

/// How directions become pixels.
#[derive(Clone, Copy, Debug)]
pub enum Lens {
    Pinhole {
        /// Pixels.
        focal: [f64; 2],
        centre: [f64; 2],
        distortion: Distortion,
    },
    Spherical {
        /// Radians a pixel across and down.
        pixel_angle: [f64; 2],
    },
    Cylindrical {
        /// Radians a pixel across.
        pixel_angle: f64,
        /// Pixels down.
        focal: f64,
        centre: f64,
    },
}

/// A lens and the size of its pictures.
#[derive(Clone, Copy, Debug)]
pub struct Camera {
    pub lens: Lens,
    pub width: usize,
    pub height: usize,
    /// Square of the largest radius in the plane z = 1 that a pinhole camera may show.
    widest: f64,
}

impl Camera {
    pub fn new(lens: Lens, width: usize, height: usize) -> Self {
        let mut camera = Self {
            lens,
            width,
            height,
            widest: f64::INFINITY,
        };
        if let Lens::Pinhole { distortion, .. } = lens {
            let limit = distortion.limit();
            // Where the picture's border lies beyond the fold, everything up to it may show.
            let radius = camera
                .border()
                .map(|pixel| camera.flat(pixel).map_or(limit, |[x, y]| x * x + y * y))
                .fold(0.0, f64::max);
            camera.widest = (radius * MARGIN * MARGIN).min(limit);
        }
        camera
    }

    fn border(&self) -> impl Iterator<Item = [f64; 2]> + use<> {
        let (width, height) = (self.width as f64, self.height as f64);
        (0..ALONG_BORDER).flat_map(move |k| {
            let share = k as f64 / (ALONG_BORDER - 1) as f64;
            let (u, v) = (share * (width - 1.0), share * (height - 1.0));
            [[u, -0.5], [u, height - 0.5], [-0.5, v], [width - 0.5, v]]
        })
    }

    /// Coordinates in the plane z = 1 of a pixel of a pinhole camera.
    fn flat(&self, [column, row]: [f64; 2]) -> Option<[f64; 2]> {
        match self.lens {
            Lens::Pinhole {
                focal,
                centre,
                distortion,
            } => distortion.undistorted([
                (column - centre[0]) / focal[0],
                (row - centre[1]) / focal[1],
            ]),
            _ => None,
        }
    }

    /// Column and row of a point in camera coordinates, also outside the picture: Eq. (2) of Kim, Chen and Cho (2017).
    ///
    /// `None` for what a pinhole camera cannot see: points behind it, and points beyond the angle up to which its
    /// distortion is a lens's and not an artefact of its polynomial.
    pub fn project(&self, [x, y, z]: [f64; 3]) -> Option<[f64; 2]> {
        let across = |angle: f64| x.atan2(z) / angle + (self.width as f64 - 1.0) / 2.0;
        let pixel = match self.lens {
            Lens::Pinhole {
                focal,
                centre,
                distortion,
            } => {
                if z <= 1e-9 {
                    return None;
                }
                let flat = [x / z, y / z];
                if flat[0] * flat[0] + flat[1] * flat[1] > self.widest {
                    return None;
                }
                let [u, v] = distortion.distorted(flat);
                [focal[0] * u + centre[0], focal[1] * v + centre[1]]
            }
            Lens::Spherical { pixel_angle } => [
                across(pixel_angle[0]),
                y.atan2(x.hypot(z)) / pixel_angle[1] + (self.height as f64 - 1.0) / 2.0,
            ],
            Lens::Cylindrical {
                pixel_angle,
                focal,
                centre,
            } => [across(pixel_angle), centre + focal * y / x.hypot(z)],
        };
        pixel.iter().all(|v| v.is_finite()).then_some(pixel)
    }

    /// Unit direction, in camera coordinates, that a pixel looks along; `None` if no direction falls on it.
    pub fn ray(&self, [column, row]: [f64; 2]) -> Option<[f64; 3]> {
        let below = match self.lens {
            Lens::Pinhole { .. } => {
                let [x, y] = self.flat([column, row])?;
                let length = (x * x + y * y + 1.0).sqrt();
                return Some([x / length, y / length, 1.0 / length]);
            }
            Lens::Spherical { pixel_angle } => {
                let below = (row - (self.height as f64 - 1.0) / 2.0) * pixel_angle[1];
                (below.abs() <= std::f64::consts::FRAC_PI_2).then_some(below)?
            }
            Lens::Cylindrical { focal, centre, .. } => ((row - centre) / focal).atan(),
        };
        let azimuth = (column - (self.width as f64 - 1.0) / 2.0) * self.angle_across()?;
        let level = below.cos();
        Some([level * azimuth.sin(), below.sin(), level * azimuth.cos()])
    }

    /// Pixels that an angle of one radian covers in the middle of the picture.
    pub fn pixels_per_radian(&self) -> f64 {
        match self.lens {
            Lens::Pinhole { focal, .. } => focal[0].max(focal[1]),
            Lens::Spherical { pixel_angle } => 1.0 / pixel_angle[0].min(pixel_angle[1]),
            Lens::Cylindrical { pixel_angle, .. } => 1.0 / pixel_angle,
        }
    }

    /// Radians a pixel across a panorama.
    fn angle_across(&self) -> Option<f64> {
        match self.lens {
            Lens::Pinhole { .. } => None,
            Lens::Spherical { pixel_angle } => Some(pixel_angle[0]),
            Lens::Cylindrical { pixel_angle, .. } => Some(pixel_angle),
        }
    }

    /// Columns after which a full panorama begins again; `None` for every other picture.
    pub fn period(&self) -> Option<f64> {
        let turn = std::f64::consts::TAU / self.angle_across()?;
        (self.width as f64 > turn - 1.5).then_some(turn)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pinhole(coefficients: [f64; 5], fold: f64) -> Camera {
        let lens = Lens::Pinhole {
            focal: [240.0, 242.0],
            centre: [161.0, 118.0],
            distortion: Distortion { coefficients, fold },
        };
        Camera::new(lens, 320, 240)
    }

    #[test]
    fn the_ray_of_a_pixel_falls_on_it() {
        let pixel_angle = 0.5_f64.to_radians();
        let cameras = [
            pinhole([0.0; 5], f64::INFINITY),
            pinhole([-0.12, 0.05, 0.001, -0.0008, -0.01], f64::INFINITY),
            Camera::new(
                Lens::Spherical {
                    pixel_angle: [pixel_angle; 2],
                },
                720,
                360,
            ),
            Camera::new(
                Lens::Cylindrical {
                    pixel_angle,
                    focal: 120.0,
                    centre: 149.5,
                },
                720,
                300,
            ),
        ];
        for camera in cameras {
            for (column, row) in (0..camera.width)
                .step_by(37)
                .zip((0..camera.height).step_by(13))
            {
                let pixel = [column as f64, row as f64];
                let ray = camera.ray(pixel).unwrap();
                assert!((ray.iter().map(|v| v * v).sum::<f64>() - 1.0).abs() < 1e-12);
                let again = camera.project(ray.map(|v| 7.0 * v)).unwrap();
                assert!((0..2).all(|k| (again[k] - pixel[k]).abs() < 1e-6));
            }
        }
    }

    #[test]
    fn nothing_beyond_the_fold_is_seen() {
        // 1 + 3 k1 r2 is zero where r2 = 1 / 1.05.
        let camera = pinhole([-0.35, 0.0, 0.0, 0.0, 0.0], 1.0 / 1.05);
        assert!(camera.project([0.0, 0.0, 2.0]).is_some());
        assert!(camera.project([1.0, 0.0, 1.0]).is_none());
        assert!(camera.project([0.0, 0.0, -2.0]).is_none());
    }
}
