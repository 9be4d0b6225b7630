//! The points of one scan, gathered as a parser meets them.

/// Beyond this distance from zero (metres) coordinates are kept relative to a local origin: a float32 at 2 km is
/// still good to 0.12 mm.
pub const LARGE: f64 = 2_000.0;
/// No coordinate on Earth is larger (metres); such a number is damage, and would spoil the local origin.
pub const FARTHEST: f64 = 1e9;
/// Local origins are whole multiples of this (metres).
const ORIGIN_STEP: f64 = 100.0;
/// So many points decide the local origin.
pub const ORIGIN_SAMPLE: usize = 65_536;

/// Where large coordinates are counted from: a round place near the middle of the first points, of which a few may
/// lie anywhere.
pub fn local_origin(first: &[[f64; 3]]) -> [f64; 3] {
    let mut order = first.to_vec();
    let middle = order.len() / 2;
    let median = [0, 1, 2].map(|axis| match order.len() {
        0 => 0.0,
        _ => {
            order
                .select_nth_unstable_by(middle, |a, b| a[axis].total_cmp(&b[axis]))
                .1[axis]
        }
    });
    match median.iter().any(|value| value.abs() > LARGE) {
        true => median.map(|value| (value / ORIGIN_STEP).round() * ORIGIN_STEP),
        false => [0.0; 3],
    }
}

/// What a file stores beside the coordinates.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Channels {
    pub intensity: bool,
    pub color: bool,
    pub grid: bool,
    /// Colours are stored as fractions of one, or are floats up to 255.
    pub fractions: bool,
}

/// One record of a file.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Point {
    pub xyz: [f64; 3],
    pub intensity: f64,
    pub color: [u16; 3],
    pub cell: [i32; 2],
}

/// Valid points: finite and not the (0, 0, 0) that formats without a validity flag write for "no return".
#[derive(Debug)]
pub struct Cloud {
    pub channels: Channels,
    /// x, y, z of each point less `local_origin`, metres.
    pub xyz: Vec<f32>,
    pub local_origin: [f64; 3],
    pub intensity: Vec<f32>,
    /// Red, green, blue of each point: 8 or 16 bits, as stored.
    pub color: Vec<u16>,
    pub row: Vec<i32>,
    pub column: Vec<i32>,
    /// Records left out because a coordinate was NaN, infinite or beyond any on Earth.
    pub not_finite: u64,
    /// Records left out because they were (0, 0, 0).
    pub no_return: u64,
    /// Records behind the last one that the header promises, which are not read.
    pub surplus: u64,
    /// The last line has no end: the file may be cut short within its last number.
    pub open_end: bool,
    metres_per_unit: f64,
    /// The first points, until they have decided the local origin.
    waiting: Option<Vec<[f64; 3]>>,
}

impl Cloud {
    /// `expected` points are allocated at once: check it against the file's size first.
    pub fn new(channels: Channels, metres_per_unit: f64, expected: usize) -> Self {
        let room = |wanted: bool, each: usize| if wanted { expected * each } else { 0 };
        Self {
            channels,
            xyz: Vec::with_capacity(expected * 3),
            local_origin: [0.0; 3],
            intensity: Vec::with_capacity(room(channels.intensity, 1)),
            color: Vec::with_capacity(room(channels.color, 3)),
            row: Vec::with_capacity(room(channels.grid, 1)),
            column: Vec::with_capacity(room(channels.grid, 1)),
            not_finite: 0,
            no_return: 0,
            surplus: 0,
            open_end: false,
            metres_per_unit,
            waiting: Some(Vec::with_capacity(expected.min(ORIGIN_SAMPLE))),
        }
    }

    /// What every parser hands on: all points are counted from the local origin, colours are of 8 or 16 bits.
    pub fn finished(mut self) -> Self {
        self.settle_origin();
        // Fractions were taken for those of one, and were of 255.
        if self.channels.fractions && self.color.iter().any(|value| *value > 2 * 255) {
            for value in &mut self.color {
                *value = ((u32::from(*value) + 127) / 255) as u16;
            }
        }
        self
    }

    fn settle_origin(&mut self) {
        let Some(first) = self.waiting.take() else {
            return;
        };
        self.local_origin = local_origin(&first);
        for (short, xyz) in self.xyz.chunks_exact_mut(3).zip(&first) {
            for axis in 0..3 {
                short[axis] = (xyz[axis] - self.local_origin[axis]) as f32;
            }
        }
    }

    pub fn len(&self) -> usize {
        self.xyz.len() / 3
    }

    /// Records there were so far, those that were left out included.
    pub fn records(&self) -> u64 {
        self.len() as u64 + self.not_finite + self.no_return
    }

    pub fn is_empty(&self) -> bool {
        self.xyz.is_empty()
    }

    /// Panics unless all arrays fit each other and every coordinate is finite: what every parser owes.
    pub fn check(&self) {
        let points = self.len();
        let fits = |length: usize, wanted: bool| length == if wanted { points } else { 0 };
        assert_eq!(self.xyz.len(), 3 * points);
        assert!(self.xyz.iter().all(|value| value.is_finite()));
        assert!(self.local_origin.iter().all(|value| value.is_finite()));
        assert!(fits(self.intensity.len(), self.channels.intensity));
        assert!(fits(self.row.len(), self.channels.grid));
        assert!(fits(self.column.len(), self.channels.grid));
        assert_eq!(
            self.color.len(),
            if self.channels.color { 3 * points } else { 0 }
        );
    }

    #[inline]
    pub fn push(&mut self, point: &Point) {
        let xyz = point.xyz.map(|value| value * self.metres_per_unit);
        // NaN is within no bound either.
        if !xyz.iter().all(|value| value.abs() <= FARTHEST) {
            self.not_finite += 1;
            return;
        }
        if xyz == [0.0; 3] {
            self.no_return += 1;
            return;
        }
        if let Some(waiting) = &mut self.waiting {
            waiting.push(xyz);
        }
        let [x, y, z] = self.local_origin;
        let short = [xyz[0] - x, xyz[1] - y, xyz[2] - z].map(|value| value as f32);
        self.xyz.extend_from_slice(&short);
        if self.channels.intensity {
            self.intensity.push(point.intensity as f32);
        }
        if self.channels.color {
            self.color.extend_from_slice(&point.color);
        }
        if self.channels.grid {
            self.row.push(point.cell[0]);
            self.column.push(point.cell[1]);
        }
        if self
            .waiting
            .as_ref()
            .is_some_and(|first| first.len() == ORIGIN_SAMPLE)
        {
            self.settle_origin();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(xyz: [f64; 3]) -> Point {
        Point {
            xyz,
            ..Point::default()
        }
    }

    #[test]
    fn large_coordinates_keep_their_millimetres() {
        let mut cloud = Cloud::new(Channels::default(), 1.0, 0);
        cloud.push(&at([636110.3004, 849345.0512, 512.1399]));
        cloud.push(&at([636102.8401, 849345.2003, 512.0094]));
        let cloud = cloud.finished();
        let y = f64::from(cloud.xyz[4]) + cloud.local_origin[1];
        assert!((y - 849345.2003).abs() < 1e-4, "{y}");
    }

    #[test]
    fn stray_points_at_the_head_cost_no_precision() {
        for stray in [[0.0, 0.0, 8e6], [0.0, 0.0, 1.7]] {
            for base in [[0.0; 3], [512345.0, 5401234.0, 420.0]] {
                let mut cloud = Cloud::new(Channels::default(), 1.0, 0);
                cloud.push(&at(stray));
                let points: Vec<[f64; 3]> = (0..ORIGIN_SAMPLE + 9)
                    .map(|i| {
                        [0, 1, 2]
                            .map(|axis| base[axis] + 0.5 + ((i * (7 + axis)) % 997) as f64 / 99.7)
                    })
                    .collect();
                points.iter().for_each(|xyz| cloud.push(&at(*xyz)));
                let cloud = cloud.finished();
                for (short, xyz) in cloud.xyz.chunks_exact(3).skip(1).zip(&points) {
                    for axis in 0..3 {
                        let back = f64::from(short[axis]) + cloud.local_origin[axis];
                        assert!((back - xyz[axis]).abs() < 1e-5);
                    }
                }
            }
        }
    }

    #[test]
    fn records_without_a_point_are_counted_not_kept() {
        let mut cloud = Cloud::new(Channels::default(), 0.001, 0);
        cloud.push(&at([0.0, 0.0, 0.0]));
        cloud.push(&at([f64::NAN, 1.0, 1.0]));
        cloud.push(&at([1e300, 1e300, 1e300]));
        cloud.push(&at([1000.0, 2000.0, -500.0]));
        let cloud = cloud.finished();
        assert_eq!((cloud.no_return, cloud.not_finite), (1, 2));
        assert_eq!(cloud.xyz, vec![1.0, 2.0, -0.5]);
    }
}
