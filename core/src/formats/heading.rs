//! What the columns of a text file are, by the names in its heading.

use super::error::{Result, fail};
use super::record::role_of;

/// What a name says that a column holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Meaning {
    /// x, y, z.
    Axis(usize),
    /// East, north, up.
    Direction(usize),
    Intensity,
    Color(usize),
    /// Of coordinates that are no lengths along axes.
    Angle,
}

/// Names of surveyors, in the languages that they write them in; `record::role_of` has those of programs.
const DIRECTIONS: [&[&str]; 3] = [
    &[
        "e",
        "east",
        "easting",
        "eastings",
        "ost",
        "osten",
        "ostwert",
        "rechts",
        "rechtswert",
        "rw",
        "est",
        "este",
    ],
    &[
        "n",
        "north",
        "northing",
        "northings",
        "nord",
        "norden",
        "nordwert",
        "hoch",
        "hochwert",
        "hw",
        "norte",
    ],
    &[
        "h",
        "height",
        "elevation",
        "elev",
        "hoehe",
        "höhe",
        "alt",
        "altitude",
        "up",
        "u",
        "kote",
        "cota",
        "quota",
    ],
];
const INTENSITIES: &[&str] = &[
    "int",
    "intens",
    "intensitaet",
    "intensität",
    "intensité",
    "reflectivity",
    "refl",
    "amplitude",
    "grey",
    "gray",
];
const COLORS: [&[&str]; 3] = [
    &["rot", "rouge", "rosso", "rojo", "rf"],
    &["gruen", "grün", "vert", "verde", "gf"],
    &["blau", "bleu", "blu", "azul", "bf"],
];
const ANGLES: &[&str] = &[
    "lon",
    "long",
    "longitude",
    "lng",
    "lat",
    "latitude",
    "azimuth",
    "zenith",
    "theta",
    "phi",
];
/// Words beside the one that matters.
const FILLERS: &[&str] = &[
    "coordinate",
    "coordinates",
    "coord",
    "coords",
    "koordinate",
    "value",
    "wert",
    "color",
    "colour",
    "channel",
    "scalar",
    "field",
    "diffuse",
    "point",
    "pos",
    "position",
    "cartesian",
    "m",
    "mm",
    "cm",
    "ft",
    "metre",
    "metres",
    "meter",
    "meters",
    "feet",
    "scan",
];
/// Names that stand for three columns.
const TRIPLES: &[(&[&str], [&str; 3])] = &[
    (&["xyz"], ["x", "y", "z"]),
    (
        &["rgb", "color", "colour", "colors", "colours"],
        ["red", "green", "blue"],
    ),
    (&["normal", "normals", "nxyz", "nxnynz"], ["nx", "ny", "nz"]),
];

fn meaning_of_word(word: &str) -> Option<Meaning> {
    use super::record::Role;
    let among = |lists: &[&[&str]; 3]| lists.iter().position(|list| list.contains(&word));
    match role_of(word) {
        Some(Role::Axis(axis)) => return Some(Meaning::Axis(axis)),
        Some(Role::Intensity) => return Some(Meaning::Intensity),
        Some(Role::Color(channel)) => return Some(Meaning::Color(channel)),
        Some(Role::PackedColor) | None => {}
    }
    if let Some(axis) = among(&DIRECTIONS) {
        return Some(Meaning::Direction(axis));
    }
    if let Some(channel) = among(&COLORS) {
        return Some(Meaning::Color(channel));
    }
    if INTENSITIES.contains(&word) {
        return Some(Meaning::Intensity);
    }
    ANGLES.contains(&word).then_some(Meaning::Angle)
}

/// What a column is by its name, whatever stands about the word that says it: `X-coordinate`, `Points:0`, `coord_x`.
pub fn meaning_of(name: &str) -> Option<Meaning> {
    let words: Vec<&str> = name.split(|c: char| !c.is_alphanumeric()).collect();
    let telling: Vec<&str> = words
        .iter()
        .copied()
        .filter(|word| !word.is_empty() && !FILLERS.contains(word))
        .collect();
    match telling.as_slice() {
        ["points", "0"] => Some(Meaning::Axis(0)),
        ["points", "1"] => Some(Meaning::Axis(1)),
        ["points", "2"] => Some(Meaning::Axis(2)),
        // `Y (Rechtswert)` is east whatever the letter.
        several if several.len() > 1 => {
            let meanings: Option<Vec<Meaning>> =
                several.iter().map(|word| meaning_of_word(word)).collect();
            let meanings = meanings?;
            let direction = |meaning: &&Meaning| matches!(meaning, Meaning::Direction(_));
            let same = meanings.iter().all(|meaning| *meaning == meanings[0]);
            let found = meanings.iter().find(direction).copied();
            found.or(same.then_some(meanings[0]))
        }
        [word] => meaning_of_word(word).or_else(|| {
            ["cartesian", "coord", "point", "pos", "color", "colour"]
                .iter()
                .find_map(|filler| word.strip_prefix(filler))
                .or_else(|| {
                    let fillers = ["coordinate", "coord", "pos"];
                    fillers.iter().find_map(|filler| word.strip_suffix(filler))
                })
                .and_then(meaning_of_word)
        }),
        _ => None,
    }
}

/// Units in brackets are left out; a word in them that says what a column is stays.
fn without_units(text: &str) -> String {
    let mut kept = String::new();
    let mut inside: Option<String> = None;
    for c in text.chars() {
        match (c, &mut inside) {
            ('[' | '(' | '<' | '{', None) => inside = Some(String::new()),
            (']' | ')' | '>' | '}', Some(word)) => {
                let word = word.to_lowercase();
                if meaning_of(&word).is_some() {
                    // Glued to the name before it, which ends at the bracket.
                    let end = kept.trim_end().len();
                    kept.truncate(end);
                    kept.push('-');
                    kept.push_str(&word);
                }
                inside = None;
            }
            (c, Some(word)) => word.push(c),
            (c, None) => kept.push(c),
        }
    }
    kept
}

fn split(text: &str) -> Vec<String> {
    let separator: fn(char) -> bool = if text.contains(';') {
        |c| c == ';'
    } else if text.contains('\t') {
        |c| c == '\t'
    } else if text.contains(',') {
        |c| c == ','
    } else {
        |c| c == ' '
    };
    text.split(separator)
        .map(|word| {
            word.trim_matches(|c: char| c.is_whitespace() || c == '"' || c == '\'')
                .to_lowercase()
        })
        .filter(|word| !word.is_empty())
        .collect()
}

/// The names in a line, in each of the ways that it may be meant: all of it, what follows a colon, its words.
fn readings(line: &[u8]) -> Vec<Vec<String>> {
    let text = String::from_utf8_lossy(line);
    let text = without_units(
        text.trim_start_matches(['\u{feff}', '#', '/', '%', '!', ';', ' ', '\t'])
            .trim_end(),
    );
    let behind = text
        .rsplit_once([':', '='])
        .map_or("", |(_, behind)| behind);
    let words = text.replace([',', ';', '\t'], " ");
    [split(&text), split(behind.trim()), split(words.trim())]
        .into_iter()
        .filter(|names| !names.is_empty())
        .collect()
}

/// Where x, y and z are among names: by letters, else by directions; a height stands in for z.
pub fn axes_of(names: &[String]) -> Option<[usize; 3]> {
    let find = |wanted: Meaning| {
        names
            .iter()
            .position(|name| meaning_of(name) == Some(wanted))
    };
    let up = || find(Meaning::Axis(2)).or(find(Meaning::Direction(2)));
    let letters = || Some([find(Meaning::Axis(0))?, find(Meaning::Axis(1))?, up()?]);
    let directions = || {
        Some([
            find(Meaning::Direction(0))?,
            find(Meaning::Direction(1))?,
            up()?,
        ])
    };
    letters().or_else(directions)
}

/// Whether a line names coordinates.
pub fn names_axes(line: &[u8]) -> bool {
    readings(line)
        .iter()
        .any(|names| axes_of(&expanded(names, usize::MAX)).is_some())
}

/// Names that stand for three columns, written out as long as there are columns for them.
fn expanded(names: &[String], columns: usize) -> Vec<String> {
    let mut out = Vec::new();
    let mut left = columns.saturating_sub(names.len());
    for name in names {
        let triple = TRIPLES
            .iter()
            .find(|(list, _)| list.contains(&name.as_str()));
        match triple {
            Some((_, three)) if left >= 2 => {
                left -= 2;
                out.extend(three.map(String::from));
            }
            _ => out.push(name.clone()),
        }
    }
    out
}

/// The names of `columns` columns by the lines of a heading; the last line that names coordinates counts. Empty where
/// none does.
///
/// Fewer names than columns are of the first ones. More are of the last ones (words stand before the names), else
/// only coordinates are taken, which must be among the first.
pub fn names_of(lines: &[Vec<u8>], columns: usize) -> Result<Vec<String>> {
    for line in lines.iter().rev() {
        let mut found: Vec<Vec<String>> = readings(line)
            .iter()
            .map(|names| expanded(names, columns))
            .filter(|names| axes_of(names).is_some())
            .collect();
        found.sort_by_key(|names| names.len().abs_diff(columns));
        let Some(names) = found.into_iter().next() else {
            refuse_half(line, columns)?;
            continue;
        };
        if names.len() <= columns {
            return Ok(names);
        }
        let last = names[names.len() - columns..].to_vec();
        if axes_of(&last).is_some() {
            return Ok(last);
        }
        let first = names[..columns].iter().enumerate();
        let axes = axes_of(&names).filter(|axes| axes.iter().all(|at| *at < columns));
        let Some(axes) = axes else {
            fail!(
                whole,
                "its heading names {} columns ({}), its rows have {columns} numbers",
                names.len(),
                names.join(" ")
            );
        };
        return Ok(first
            .map(|(at, name)| {
                if axes.contains(&at) {
                    name.clone()
                } else {
                    format!("{name}?")
                }
            })
            .collect());
    }
    Ok(Vec::new())
}

/// Refuses a heading that names as many columns as there are, some coordinates among them, but not all three.
fn refuse_half(line: &[u8], columns: usize) -> Result<()> {
    for names in readings(line) {
        let meanings: Vec<Meaning> = names.iter().filter_map(|name| meaning_of(name)).collect();
        let some = |wanted: fn(&Meaning) -> bool| meanings.iter().any(wanted);
        if names.len() != columns {
            continue;
        }
        if some(|meaning| *meaning == Meaning::Angle) {
            fail!(
                whole,
                "its heading names angles ({}): columns must be lengths along x y z, or east north height",
                names.join(" ")
            );
        }
        if some(|meaning| matches!(meaning, Meaning::Axis(_) | Meaning::Direction(0 | 1))) {
            fail!(
                whole,
                "its heading ({}) does not name all of x y z, or of east north height",
                names.join(" ")
            );
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(line: &str, columns: usize) -> Vec<String> {
        names_of(&[line.as_bytes().to_vec()], columns).unwrap()
    }

    #[test]
    fn coordinates_in_any_common_wording_and_order() {
        for (line, axes) in [
            ("X Y Z", [0, 1, 2]),
            ("N,E,Z", [1, 0, 2]),
            ("Z;Y;X", [2, 1, 0]),
            ("Hochwert;Rechtswert;Höhe", [1, 0, 2]),
            ("Y (Rechtswert);X (Hochwert);H", [0, 1, 2]),
            ("Easting [m], Northing [m], Elevation [m]", [0, 1, 2]),
            ("X[m] Y[m] Z[m]", [0, 1, 2]),
            ("X(m) Y(m) Z(m)", [0, 1, 2]),
            ("\"X\",\"Y\",\"Z\"", [0, 1, 2]),
            ("// x y z", [0, 1, 2]),
            ("# columns: x y z", [0, 1, 2]),
            ("; Ost Nord Hoehe", [0, 1, 2]),
            ("% coord_x, coord_y, coord_z", [0, 1, 2]),
            ("\"Points:0\",\"Points:1\",\"Points:2\"", [0, 1, 2]),
            ("X-coordinate\tY-coordinate\tZ-coordinate", [0, 1, 2]),
            ("cartesianX cartesianY cartesianZ", [0, 1, 2]),
            ("Est;Nord;Quota", [0, 1, 2]),
            ("E N H", [0, 1, 2]),
            ("XYZ", [0, 1, 2]),
            ("Y (E), X (N), Z (m)", [0, 1, 2]),
        ] {
            assert_eq!(axes_of(&names(line, 3)), Some(axes), "{line}");
        }
    }

    #[test]
    fn names_for_other_columns_than_there_are() {
        assert_eq!(
            names("x y z rgb intensity", 7)[3..],
            ["red", "green", "blue", "intensity"]
        );
        assert_eq!(names("the points of site 7 x y z", 3), ["x", "y", "z"]);
        assert_eq!(names("x y z intensity", 6).len(), 4);
        assert_eq!(names("x y z class gps time", 4)[3], "class?");
        for (line, columns) in [("lon lat height", 3), ("x y", 2), ("id name x y z more", 2)] {
            assert!(
                names_of(&[line.as_bytes().to_vec()], columns).is_err(),
                "{line}"
            );
        }
        assert!(names("Project: site 7", 3).is_empty());
        assert!(names("col1 col2 col3", 3).is_empty());
    }

    #[test]
    fn colours_with_their_channel_in_brackets() {
        let found = names("x,y,z,Color (R),Color (G),Color (B),Intensity (i)", 7);
        let meanings: Vec<_> = found[3..].iter().map(|name| meaning_of(name)).collect();
        let colors = [0, 1, 2].map(|channel| Some(Meaning::Color(channel)));
        assert_eq!(meanings[..3], colors);
        assert_eq!(meanings[3], Some(Meaning::Intensity));
    }

    #[test]
    fn normals_and_point_numbers_are_no_coordinates() {
        assert_eq!(meaning_of("nx"), None);
        assert_eq!(meaning_of("point"), None);
        assert_eq!(meaning_of("scalar_intensity"), Some(Meaning::Intensity));
        assert_eq!(
            meaning_of("Rf".to_lowercase().as_str()),
            Some(Meaning::Color(0))
        );
    }
}
