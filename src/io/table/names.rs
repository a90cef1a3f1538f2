//! Names of columns: which of them are x, y and z.

/// What the names of columns say.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Axes {
    /// The columns of a position and, if named, of a normal.
    Found {
        point: [usize; 3],
        normal: Option<[usize; 3]>,
        /// Another column has a name of the same meaning.
        twice: bool,
        /// z is named as a depth, which may count downwards.
        depth: bool,
    },
    /// Longitude and latitude: angles, no lengths.
    Degrees,
    /// Names of other things than positions, such as normals, colours or numbers of points.
    Other,
    /// Nothing that is known.
    Unknown,
}

/// What one name stands for: the scheme of names and the axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Name {
    /// `x`, alone.
    Plain(usize),
    /// `x` with other words, such as `pos_x`, `X_m`, `Points:0`.
    Worded(usize),
    /// `easting`, `N`.
    Map(usize),
    /// A height, which goes with either.
    Height {
        downwards: bool,
    },
    Normal(usize),
    Degree,
    /// Known, and no coordinate.
    Other,
}

/// Words that may stand beside the letter of an axis.
const POSITION: [&str; 29] = [
    "coord",
    "coords",
    "coordinate",
    "coordinates",
    "pos",
    "position",
    "positions",
    "point",
    "points",
    "pt",
    "pts",
    "loc",
    "location",
    "vertex",
    "vertices",
    "verts",
    "xyz",
    "cartesian",
    "world",
    "global",
    "field",
    "pose",
    "p",
    "utm",
    "axis",
    "koordinate",
    "grid",
    "local",
    "map",
];
const UNITS: [&str; 14] =
    ["m", "mm", "cm", "km", "ft", "feet", "in", "inch", "meter", "meters", "metre", "metres", "um", "usft"];
const EAST: [&str; 11] =
    ["e", "east", "easting", "eastings", "rechtswert", "ostwert", "ost", "este", "est", "rw", "rechts"];
const NORTH: [&str; 10] =
    ["n", "north", "northing", "northings", "hochwert", "nordwert", "nord", "norte", "hw", "hoch"];
const HEIGHT: [&str; 15] = [
    "h",
    "height",
    "elev",
    "elevation",
    "alt",
    "altitude",
    "hoehe",
    "höhe",
    "cota",
    "quota",
    "hgt",
    "rl",
    "el",
    "elv",
    "ht",
];
const DEGREES: [&str; 8] = ["lon", "long", "lng", "longitude", "lat", "latitude", "länge", "breite"];
const OTHER: [&str; 35] = [
    "id",
    "index",
    "idx",
    "nr",
    "no",
    "num",
    "number",
    "name",
    "pid",
    "label",
    "class",
    "classification",
    "intensity",
    "reflectance",
    "reflectivity",
    "r",
    "g",
    "b",
    "red",
    "green",
    "blue",
    "alpha",
    "time",
    "timestamp",
    "t",
    "gpstime",
    "ring",
    "laser",
    "row",
    "col",
    "column",
    "u",
    "v",
    "range",
    "azimuth",
];

/// Whether a word is a unit of length, as in a line of units below the names.
pub(super) fn is_unit(word: &str) -> bool {
    let word = word.trim_matches(['[', ']', '(', ')']).to_lowercase();
    UNITS.contains(&word.as_str()) || matches!(word.as_str(), "deg" | "rad" | "s" | "-" | "1" | "")
}

/// The columns of x, y and z.
pub(super) fn axes(names: &[String]) -> Axes {
    let known: Vec<Option<Name>> = names.iter().map(|n| meaning(n)).collect();
    let place = |fits: &dyn Fn(Name) -> bool| known.iter().position(|n| n.is_some_and(fits));
    let letter = |a: usize, plain: bool| {
        place(&|n| if plain { n == Name::Plain(a) } else { n == Name::Plain(a) || n == Name::Worded(a) })
    };
    let worded = |a: usize| place(&|n| n == Name::Worded(a));
    let height = || place(&|n| matches!(n, Name::Height { .. }));
    let schemes: [[Option<usize>; 3]; 5] = [
        [letter(0, true), letter(1, true), letter(2, true)],
        [worded(0), worded(1), worded(2)],
        [letter(0, false), letter(1, false), letter(2, false)],
        [place(&|n| n == Name::Map(0)), place(&|n| n == Name::Map(1)), letter(2, false).or_else(height)],
        [letter(0, false), letter(1, false), height()],
    ];
    for scheme in schemes {
        if let [Some(x), Some(y), Some(z)] = scheme {
            let point = [x, y, z];
            let same = |i: usize| point.iter().any(|&p| p != i && known[p] == known[i]);
            let twice = (0..known.len()).any(|i| known[i].is_some() && !point.contains(&i) && same(i));
            let normal = [0, 1, 2].map(|a| place(&|n| n == Name::Normal(a)));
            let normal = match normal {
                [Some(a), Some(b), Some(c)] => Some([a, b, c]),
                _ => None,
            };
            return Axes::Found {
                point,
                normal,
                twice,
                depth: known[z] == Some(Name::Height { downwards: true }),
            };
        }
    }
    if known.iter().filter(|n| **n == Some(Name::Degree)).count() >= 2 {
        return Axes::Degrees;
    }
    // A single letter may be anything: `a, b, c` are no colours.
    let first = || names.iter().zip(&known).take(3);
    let other = |n: &Option<Name>| matches!(n, Some(Name::Other | Name::Normal(_) | Name::Degree));
    let sure = first().any(|(name, n)| other(n) && name.trim().len() > 1);
    if sure || first().filter(|(_, n)| other(n)).count() > 1 { Axes::Other } else { Axes::Unknown }
}

/// The names in a comment such as `id x y z`, `X, Y, Z, TRACK[] as (...)` or `Columns: x y z`, and whether they are
/// surely names of columns even where their number is not that of the columns.
pub(super) fn of_comment(comment: &str) -> Option<(Vec<String>, bool)> {
    let comment = without_brackets(comment);
    let behind_colon = comment.split_once(": ").map(|(_, rest)| rest);
    for text in behind_colon.into_iter().chain([comment.as_str()]) {
        let names: Vec<String> = text
            .split(|c: char| c.is_whitespace() || matches!(c, ',' | ';' | '|'))
            .map(|n| n.trim_matches('"'))
            .filter(|n| !n.is_empty())
            .map(str::to_string)
            .collect();
        let point = match axes(&names) {
            Axes::Found { point, .. } => point,
            Axes::Degrees if names.len() <= 8 => return Some((names, false)),
            _ => continue,
        };
        // In a sentence x, y and z stand apart, or behind words that name no column.
        let (first, last) = (point.iter().min().copied()?, point.iter().max().copied()?);
        let listed = |i: usize| {
            let until = names[..=i].iter().map(String::as_str);
            let commas = text.matches([',', ';', '|']).count() >= last;
            commas || until.take(i).all(|n| meaning(n).is_some() || n.contains('_'))
        };
        let sure = last - first == 2 && listed(first);
        return Some((names, sure));
    }
    None
}

/// Removes `(...)` and `[...]`, which hold units.
fn without_brackets(text: &str) -> String {
    let mut depth = 0_usize;
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '(' | '[' => depth += 1,
            ')' | ']' => depth = depth.saturating_sub(1),
            c if depth == 0 => out.push(c),
            _ => {}
        }
    }
    out
}

fn meaning(name: &str) -> Option<Name> {
    let lower = without_brackets(name).to_lowercase();
    let all: Vec<&str> = lower.split(|c: char| !c.is_alphanumeric()).filter(|t| !t.is_empty()).collect();
    let letter = |t: &str| ["x", "y", "z"].iter().position(|l| *l == t);
    let digit = |t: &str| ["0", "1", "2"].iter().position(|l| *l == t);
    let [only] = all[..] else {
        if let [first, second] = all[..]
            && matches!(first, "normal" | "normals" | "n")
            && let Some(axis) = letter(second).or_else(|| digit(second))
        {
            return Some(Name::Normal(axis));
        }
        // Without units, then without the words of positions, one word is left.
        let bare: Vec<&str> = all.iter().copied().filter(|t| !UNITS.contains(t)).collect();
        if let [word] = bare[..] {
            return match one_word(word)? {
                Name::Plain(axis) => Some(Name::Worded(axis)),
                other => Some(other),
            };
        }
        let rest: Vec<&str> = bare.iter().copied().filter(|t| !POSITION.contains(t)).collect();
        let axis = |word: &&str| match one_word(word)? {
            Name::Plain(a) | Name::Map(a) => Some(a),
            Name::Height { downwards: false } => Some(2),
            _ => None,
        };
        if let [first, second] = rest[..]
            && let Some(a) = axis(&first)
            && axis(&second) == Some(a)
        {
            return Some(Name::Worded(a)); // Such as `Easting X`.
        }
        let [word] = rest[..] else {
            let other =
                |t: &&str| matches!(*t, "id" | "number" | "nr" | "no" | "index" | "normals" | "color");
            return bare.iter().any(other).then_some(Name::Other);
        };
        if let Some(axis) = letter(word).or_else(|| digit(word)) {
            return Some(Name::Worded(axis));
        }
        return one_word(word).filter(|n| !matches!(n, Name::Plain(_)));
    };
    one_word(only)
}

fn one_word(word: &str) -> Option<Name> {
    let letter = |t: &str| ["x", "y", "z"].iter().position(|l| *l == t);
    if let Some(axis) = letter(word) {
        return Some(Name::Plain(axis));
    }
    for part in ["coordinate", "coord", "position", "pos", "p", "point", "koordinate"] {
        if let Some(axis) = word.strip_prefix(part).or_else(|| word.strip_suffix(part)).and_then(letter) {
            return Some(Name::Worded(axis));
        }
    }
    if let Some(axis) = word
        .strip_prefix("normal")
        .or_else(|| word.strip_prefix('n'))
        .and_then(letter)
        .or_else(|| word.strip_suffix("normal").and_then(letter))
    {
        return Some(Name::Normal(axis));
    }
    let among = |list: &[&str]| list.contains(&word);
    if among(&EAST) {
        Some(Name::Map(0))
    } else if among(&NORTH) {
        Some(Name::Map(1))
    } else if among(&HEIGHT) {
        Some(Name::Height { downwards: false })
    } else if word == "depth" || word == "tiefe" {
        Some(Name::Height { downwards: true })
    } else if among(&DEGREES) {
        Some(Name::Degree)
    } else if among(&OTHER) || word == "point" {
        Some(Name::Other)
    } else {
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(text: &str) -> Axes {
        axes(&text.split(',').map(str::to_string).collect::<Vec<_>>())
    }

    #[test]
    fn names_of_many_programs_are_known() {
        let cases: [(&str, [usize; 3]); 27] = [
            ("x,y,z", [0, 1, 2]),
            ("id,X,Y,Z,R,G,B", [1, 2, 3]),
            ("Normals:0,Normals:1,Normals:2,Points:0,Points:1,Points:2", [3, 4, 5]),
            ("intensity,laser_id,Points_m_XYZ:0,Points_m_XYZ:1,Points_m_XYZ:2", [2, 3, 4]),
            ("Points_0,Points_1,Points_2", [0, 1, 2]),
            ("Point,Easting,Northing,Elevation", [1, 2, 3]),
            ("Point,Northing,Easting,Elevation,Description", [2, 1, 3]),
            ("P,N,E,Z,D", [2, 1, 3]),
            ("Name,E (m),N (m),H (m)", [1, 2, 3]),
            ("POINT_X,POINT_Y,POINT_Z", [0, 1, 2]),
            ("OID,pos_x,pos_y,pos_z", [1, 2, 3]),
            ("time,field.position.x,field.position.y,field.position.z", [1, 2, 3]),
            ("X [m],Y [m],Z [m]", [0, 1, 2]),
            ("x_m,y_m,z_m", [0, 1, 2]),
            ("xcoord,ycoord,zcoord", [0, 1, 2]),
            ("X,Y,Elevation", [0, 1, 2]),
            ("id,x,y,depth", [1, 2, 3]),
            ("Rechtswert,Hochwert,Höhe", [0, 1, 2]),
            ("lat,lon,x,y,z", [2, 3, 4]),
            ("u,v,x,y,z", [2, 3, 4]),
            (",x,y,z", [1, 2, 3]),
            ("z,y,x", [2, 1, 0]),
            ("nx,ny,nz,x,y,z", [3, 4, 5]),
            ("pointid,east,north,height", [1, 2, 3]),
            ("Pt,N,E,El,Desc", [2, 1, 3]),
            ("Grid Easting,Grid Northing,Elevation", [0, 1, 2]),
            ("Easting X,Northing Y,Height Z", [0, 1, 2]),
        ];
        for (text, wanted) in cases {
            match of(text) {
                Axes::Found { point, .. } => assert_eq!(point, wanted, "{text}"),
                other => panic!("{text}: {other:?}"),
            }
        }
        let Axes::Found { normal, twice, depth, .. } = of("x,y,z,nx,ny,nz,x") else { panic!() };
        assert_eq!((normal, twice, depth), (Some([3, 4, 5]), true, false));
        assert!(matches!(of("x,y,depth"), Axes::Found { depth: true, .. }));
        assert_eq!(of("lon,lat,alt"), Axes::Degrees);
        assert_eq!(of("Latitude,Longitude,Elevation"), Axes::Degrees);
        for other in ["nx,ny,nz", "r,g,b", "id,a,b,c", "Normals:0,Normals:1,Normals:2"] {
            assert_eq!(of(other), Axes::Other, "{other}");
        }
        for unknown in ["foo,bar,baz", "x,y", "", "a,b,c"] {
            assert_eq!(of(unknown), Axes::Unknown, "{unknown}");
        }
    }

    #[test]
    fn names_in_comments() {
        let sure = |text: &str| of_comment(text).is_some_and(|(_, sure)| sure);
        assert!(sure("POINT3D_ID, X, Y, Z, R, G, B, ERROR, TRACK[] as (IMAGE_ID, POINT2D_IDX)"));
        assert!(
            sure("id x y z") && sure("X Y Z") && sure("Columns: x y z r g b") && sure("x [m] y [m] z [m]")
        );
        assert!(!sure("the axes x y z are in metres"));
        assert!(!sure("x is right and y is up and z is back"));
        assert!(of_comment("Number of points: 50, mean track length: 3.1").is_none());
        assert!(of_comment("lon lat alt").is_some());
    }
}
