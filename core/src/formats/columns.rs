//! What the columns of a text file are where nothing names them: what their numbers look like, over the whole file.

use super::heading::{Meaning, axes_of, meaning_of};
use super::record::{ColorColumns, Column, Layout, Scalar};

/// Share of the sampled rows whose direction has the length of one where three columns are a normal.
const NORMALS: f64 = 0.95;
/// So many rows at the start of a file tell that a column numbers them.
const COUNTED: usize = 20;
/// Three numbers of few digits are a unit vector within this.
const UNIT: f64 = 0.02;

/// Fractions of one where the sample holds nothing beyond it.
fn color_scalar(sample: &[Vec<f64>], columns: [usize; 3]) -> Scalar {
    let mut values = sample.iter().flat_map(|row| columns.map(|at| row[at]));
    if values.all(|value| value.is_nan() || value <= 1.0) {
        Scalar::F32
    } else {
        Scalar::U16
    }
}

fn layout(
    sample: &[Vec<f64>],
    xyz: [usize; 3],
    intensity: Option<usize>,
    color: Option<[usize; 3]>,
) -> Layout {
    let column = |offset, scalar| Column {
        scalar,
        offset,
        stride: 0,
    };
    Layout {
        xyz: xyz.map(|at| column(at, Scalar::F64)),
        intensity: intensity.map(|at| column(at, Scalar::F64)),
        color: match color {
            Some(at) => {
                let scalar = color_scalar(sample, at);
                ColorColumns::Separate(at.map(|at| column(at, scalar)))
            }
            None => ColorColumns::None,
        },
        big_endian: false,
    }
}

/// The layout of columns with names.
pub fn named(names: &[String], sample: &[Vec<f64>]) -> Layout {
    let find = |wanted| {
        names
            .iter()
            .position(|name| meaning_of(name) == Some(wanted))
    };
    let colors = || {
        Some([
            find(Meaning::Color(0))?,
            find(Meaning::Color(1))?,
            find(Meaning::Color(2))?,
        ])
    };
    let xyz = axes_of(names).unwrap_or([0, 1, 2]);
    layout(sample, xyz, find(Meaning::Intensity), colors())
}

/// Columns that nothing names: x y z, then a colour, a normal and an intensity by what the numbers look like. A first
/// column that numbers the points is passed over.
pub fn guess(sample: &[Vec<f64>], columns: usize) -> Layout {
    if columns > 3 && counts(sample) {
        let rest: Vec<Vec<f64>> = sample.iter().map(|row| row[1..].to_vec()).collect();
        return guess(&rest, columns - 1).moved(1);
    }
    let mut free: Vec<usize> = (3..columns).collect();
    let drop = |free: &mut Vec<usize>, at: usize| free.retain(|&k| k < at || k >= at + 3);
    let triples = |free: &[usize]| -> Vec<usize> {
        let three = free.windows(3);
        three.filter(|w| w[2] == w[0] + 2).map(|w| w[0]).collect()
    };
    while let Some(at) = triples(&free).into_iter().find(|&at| is_normal(sample, at)) {
        drop(&mut free, at);
    }
    let color = color_among(sample, &triples(&free));
    if let Some(at) = color {
        drop(&mut free, at);
    }
    // Of six columns without a colour the last three are no intensity but a normal, a colour of another kind.
    let intensity = match (columns, color) {
        (6, None) if free.len() == 3 => None,
        (_, Some(at)) if !free.contains(&3) => Some(at + 3).filter(|next| free.contains(next)),
        _ => Some(3).filter(|next| free.contains(next)),
    };
    layout(
        sample,
        [0, 1, 2],
        intensity,
        color.map(|at| [at, at + 1, at + 2]),
    )
}

/// Whether the first column goes up by one from row to row, where rows of the sample follow each other.
fn counts(sample: &[Vec<f64>]) -> bool {
    let first = &sample[..sample.len().min(COUNTED)];
    let steps = first.windows(2).all(|pair| pair[1][0] - pair[0][0] == 1.0);
    first.len() == COUNTED && steps && first[0][0].fract() == 0.0
}

fn is_normal(sample: &[Vec<f64>], at: usize) -> bool {
    let unit = |row: &&Vec<f64>| {
        let length: f64 = row[at..at + 3].iter().map(|v| v * v).sum::<f64>();
        (length.sqrt() - 1.0).abs() < UNIT || length == 0.0
    };
    let units = sample.iter().filter(unit).count() as f64;
    // A colour of zeros and ones has that length, too, but nothing negative and nothing between.
    let between = |value: &f64| *value < 0.0 || value.fract() != 0.0;
    units >= NORMALS * sample.len() as f64
        && sample.iter().any(|row| row[at..at + 3].iter().any(between))
}

/// Where a colour begins among places of three free columns.
fn color_among(sample: &[Vec<f64>], places: &[usize]) -> Option<usize> {
    let all = |at: usize, test: &dyn Fn(f64) -> bool| {
        sample
            .iter()
            .all(|row| row[at..at + 3].iter().all(|value| test(*value)))
    };
    let whole = |value: f64, most: f64| value.fract() == 0.0 && (0.0..=most).contains(&value);
    let bytes: Vec<usize> = places
        .iter()
        .copied()
        .filter(|&at| at <= 4 && all(at, &|value| whole(value, 255.0)))
        .collect();
    match bytes.as_slice() {
        // Intensity before or behind: channels of a colour are more alike than either is to an intensity.
        [3, 4] if sample.iter().all(|row| row.len() > 6) => {
            let apart = |a: usize, b: usize| -> f64 {
                sample.iter().map(|row| (row[a] - row[b]).abs()).sum()
            };
            return Some(if 2.0 * apart(3, 4) < apart(5, 6) {
                3
            } else {
                4
            });
        }
        [.., last] => return Some(*last),
        [] => {}
    }
    // 16 bits: bytes times 256 or 257; or the full range. Row and column numbers are neither.
    let wide = |at: usize| {
        all(at, &|value| whole(value, 65_535.0))
            && (all(at, &|value| value % 257.0 == 0.0)
                || all(at, &|value| value % 256.0 == 0.0)
                || sample
                    .iter()
                    .any(|row| row[at..at + 3].iter().any(|value| *value >= 32_768.0)))
    };
    let fraction = |at: usize| {
        all(at, &|value| (0.0..=1.0).contains(&value)) && !all(at, &|value| value == sample[0][at])
    };
    let near = || places.iter().copied().filter(|at| *at <= 4).rev();
    near()
        .find(|&at| wide(at))
        .or_else(|| near().find(|&at| fraction(at)))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn taken(rows: &[&[f64]]) -> (Option<usize>, Option<usize>) {
        let sample: Vec<Vec<f64>> = rows.iter().map(|row| row.to_vec()).collect();
        let found = guess(&sample, sample[0].len());
        let color = match found.color {
            ColorColumns::Separate(columns) => Some(columns[0].offset),
            _ => None,
        };
        (found.intensity.map(|column| column.offset), color)
    }

    #[test]
    fn numbers_of_points_are_no_coordinates() {
        let rows: Vec<Vec<f64>> = (0..30)
            .map(|k| vec![f64::from(k + 1), 0.5, f64::from(k * k), 2.5, 0.25])
            .collect();
        let found = guess(&rows, 5);
        assert_eq!(found.offsets(), [1, 2, 3, 4]);
        assert_eq!(guess(&rows[..10], 5).xyz[0].offset, 0);
    }

    #[test]
    fn columns_without_names() {
        let (bytes, other) = ([40.0, 50.0, 60.0], [90.0, 95.0, 85.0]);
        let (normal, back) = ([0.6, 0.8, 0.0], [0.0, 0.0, -1.0]);
        let rows = |parts: [&[&[f64]]; 2]| {
            let [a, b] = parts.map(|parts| [&[1.0, 2.0, 3.0], parts.concat().as_slice()].concat());
            taken(&[&a, &b])
        };
        assert_eq!(rows([&[&bytes], &[&other]]), (None, Some(3)));
        assert_eq!(rows([&[&normal], &[&back]]), (None, None));
        assert_eq!(
            rows([&[&bytes, &normal], &[&other, &back]]),
            (None, Some(3))
        );
        assert_eq!(
            rows([&[&[0.5], &bytes], &[&[0.7], &other]]),
            (Some(3), Some(4))
        );
        assert_eq!(
            rows([&[&[0.5], &normal], &[&[0.7], &back]]),
            (Some(3), None)
        );
        assert_eq!(
            rows([&[&bytes, &[0.5]], &[&other, &[0.7]]]),
            (Some(6), Some(3))
        );
        assert_eq!(
            rows([&[&bytes, &[200.0]], &[&other, &[7.0]]]),
            (Some(6), Some(3))
        );
        assert_eq!(
            rows([&[&[200.0], &bytes], &[&[7.0], &other]]),
            (Some(3), Some(4))
        );
        assert_eq!(
            rows([&[&[0.5], &bytes, &normal], &[&[0.7], &other, &back]]),
            (Some(3), Some(4))
        );
        let sixteen = bytes.map(|value| value * 257.0);
        assert_eq!(rows([&[&sixteen], &[&sixteen]]), (None, Some(3)));
        let fraction = [0.25, 0.5, 0.125];
        assert_eq!(rows([&[&fraction], &[&fraction]]), (None, Some(3)));
        // Rows and columns of a grid, and a number.
        assert_eq!(
            rows([&[&[800.0, 1200.0, 3.0]], &[&[801.0, 7.0, 4.0]]]),
            (None, None)
        );
    }
}
