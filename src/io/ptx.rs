//! PTX, scans of Leica: for each the numbers of columns and rows, the scanner's place and axes, a matrix of 4 x 4, and
//! a line for each point, x, y, z and intensity in the scanner's own frame. `0 0 0` means that nothing came back.

use super::precision::check_point;
use super::text::{Lines, float, integer, three_floats, without_byte_order_mark, words};
use super::{Loaded, Want};
use crate::geometry::{Attribute, COLOUR, Number};
use crate::{Error, ErrorKind};

/// Lines between the counts of a scan and its points: place, three axes, and four rows of the matrix.
const POSE: [usize; 8] = [3, 3, 3, 3, 4, 4, 4, 4];

/// Whether the text begins with the head of a scan.
pub(super) fn looks_like_ptx(bytes: &[u8]) -> bool {
    let mut lines = Lines::new(&bytes[..bytes.len().min(4096)]).map(|(_, l)| l);
    let numbers = |line: Option<&[u8]>, count: usize, whole: bool| {
        line.is_some_and(|l| {
            let fits = |w: &[u8]| if whole { integer(w).is_some() } else { float(w).is_some() };
            words(l).count() == count && words(l).all(fits)
        })
    };
    numbers(lines.next(), 1, true)
        && numbers(lines.next(), 1, true)
        && POSE.iter().all(|count| numbers(lines.next(), *count, false))
}

/// Reads the points of all scans in their common frame.
pub(super) fn read(bytes: &[u8], want: Want) -> Result<Loaded, Error> {
    let mut loaded = Loaded::default();
    let mut lines =
        Lines::new(without_byte_order_mark(bytes)?).filter(|(_, l)| !l.trim_ascii().is_empty()).peekable();
    let (mut scans, mut rows, mut none) = (0_usize, 0_usize, 0_usize);
    let mut beside = Beside::default();
    while lines.peek().is_some() {
        scans += 1;
        let scan = format!("scan {scans}");
        let mut number_of = |what: &str| {
            let (line, text) = lines.next().ok_or_else(|| {
                wrong(format!("truncated: the file ends before the {what} of a scan")).at_element(&*scan)
            })?;
            let count = Some(text.trim_ascii()).and_then(integer).and_then(|n| u64::try_from(n).ok());
            count.ok_or_else(|| {
                wrong(format!("a line with the {what} of a scan expected")).at_line(line).at_element(&*scan)
            })
        };
        let (columns, height) = (number_of("columns")?, number_of("rows")?);
        let promised = columns.checked_mul(height);
        let mut pose = [[0.0; 4]; 8];
        for (row, count) in pose.iter_mut().zip(POSE) {
            let (line, text) = lines
                .next()
                .ok_or_else(|| wrong("truncated: the file ends in the head of a scan").at_element(&*scan))?;
            let numbers: Option<Vec<f64>> = words(text).map(float).collect();
            match numbers.filter(|n| n.len() == count) {
                Some(numbers) => row[..count].copy_from_slice(&numbers),
                None => {
                    let what = format!("a line of {count} numbers expected in the head of a scan");
                    return Err(wrong(what).at_line(line).at_element(&*scan));
                }
            }
        }
        let matrix = [pose[4], pose[5], pose[6], pose[7]];
        if matrix[3].iter().all(|x| x.is_finite()) {
            loaded.viewpoints.push([matrix[3][0], matrix[3][1], matrix[3][2]]);
        }
        let mut found = 0_u64;
        // A line with one number is the head of the next scan, if this one is shorter than it promises.
        while Some(found) != promised
            && let Some((line, text)) = lines.next_if(|(_, l)| words(l).count() > 1)
        {
            let index = rows;
            let at = |e: Error| e.at_line(line).at_element(format!("point {index}"));
            let p = three_floats(words(text)).map_err(at)?;
            (found, rows) = (found + 1, rows + 1);
            if p == [0.0; 3] && matches!(want, Want::Cloud | Want::Attributes) {
                none += 1;
                continue;
            }
            // The point is a row before the matrix, whose last row is the scanner's place.
            let moved = [0, 1, 2].map(|a| (0..3).map(|i| p[i] * matrix[i][a]).sum::<f64>() + matrix[3][a]);
            check_point(moved, want, "point", index).map_err(|e| e.at_line(line))?;
            loaded.verts.push(moved);
            if want == Want::Attributes {
                beside.push(words(text).skip(3));
            }
        }
        if Some(found) != promised {
            loaded.warnings.push(format!(
                "{scan} promises {columns} x {height} points, {found} are there; the file may be cut short"
            ));
        }
    }
    loaded.left_out = none;
    if none > 0 {
        loaded
            .notices
            .push(format!("left out {none} of {rows} points: they are 0 0 0, from where nothing came back"));
    }
    if scans > 1 {
        loaded.notices.push(format!("joined {scans} scans, each moved to its place"));
    }
    loaded.attributes = beside.attributes(loaded.verts.len());
    Ok(loaded)
}

/// What stands behind the coordinates.
#[derive(Default)]
struct Beside {
    intensity: Vec<f64>,
    colour: [Vec<f64>; 3],
}

impl Beside {
    /// Takes the words behind the coordinates of a point: an intensity, and maybe a colour of three bytes.
    fn push<'a>(&mut self, words: impl Iterator<Item = &'a [u8]>) {
        let numbers: Vec<f64> = words.take(5).map_while(float).collect();
        self.intensity.push(numbers.first().copied().unwrap_or(f64::NAN));
        if let [_, colour @ ..] = &numbers[..]
            && colour.len() == 3
            && colour.iter().all(|x| (0.0..=255.0).contains(x) && x.fract() == 0.0)
        {
            self.colour.iter_mut().zip(colour).for_each(|(part, x)| part.push(*x));
        }
    }

    /// The attributes of n points: the intensity if any has one, the colour if all have one.
    fn attributes(self, n: usize) -> Vec<Attribute> {
        let one = |name: &str, number, values| Attribute { name: name.into(), number, values };
        let mut all = Vec::new();
        if self.intensity.iter().any(|x| !x.is_nan()) {
            all.push(one("intensity", Number::F32, self.intensity));
        }
        if n > 0 && self.colour[0].len() == n {
            all.extend(COLOUR.into_iter().zip(self.colour).map(|(name, part)| one(name, Number::U8, part)));
        }
        all
    }
}

fn wrong(what: impl Into<String>) -> Error {
    Error::new(ErrorKind::Format, what).advise("the file is damaged or not PTX; export it again")
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    /// Two scans of three places each: one as it stands, one turned by a quarter around z and moved.
    pub const SCANS: &str = "3\n1\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n\
        1 2 3 0.5\n0 0 0 0.5\n4 5 6 0.5 255 0 0\n1\n2\n10 20 30\n0 1 0\n-1 0 0\n0 0 1\n0 1 0 0\n-1 0 0 0\n0 0 1 0\n\
        10 20 30 1\n1 2 3 0.5\n0 0 0 0.5\n";

    #[test]
    fn scans_are_moved_to_their_places() {
        assert!(looks_like_ptx(SCANS.as_bytes()));
        let loaded = read(SCANS.as_bytes(), Want::Cloud).unwrap();
        assert_eq!(loaded.verts, [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0], [8.0, 21.0, 33.0]]);
        assert_eq!((loaded.left_out, loaded.viewpoints), (2, vec![[0.0; 3], [10.0, 20.0, 30.0]]));
        assert!(
            loaded.notices[0].contains("left out 2 of 5") && loaded.notices[1].contains("joined 2 scans")
        );
        assert!(loaded.warnings.is_empty());
        assert_eq!(read(SCANS.as_bytes(), Want::EveryRow).unwrap().verts.len(), 5);
        for other in ["3\n1 2 3\n4 5 6\n7 8 9\n", "3\n1\n0 0 0\n", "1 2 3\n"] {
            assert!(!looks_like_ptx(other.as_bytes()), "{other}");
        }
    }

    #[test]
    fn intensity_and_colour_are_read_if_asked_for() {
        let of = |text: &str| read(text.as_bytes(), Want::Attributes).unwrap().attributes;
        let names = |all: &[Attribute]| all.iter().map(|a| a.name.clone()).collect::<Vec<_>>();
        // One of three points has a colour.
        let some = of(SCANS);
        assert_eq!((names(&some), some[0].values.len()), (vec!["intensity".to_string()], 3));
        let coloured = SCANS.replace("1 2 3 0.5", "1 2 3 0.25 9 8 7");
        let all = of(&coloured);
        assert_eq!(names(&all), ["intensity", "red", "green", "blue"]);
        assert_eq!(
            (&all[0].values[..], &all[1].values[..]),
            (&[0.25, 0.5, 0.25][..], &[9.0, 255.0, 9.0][..])
        );
        assert!(read(coloured.as_bytes(), Want::Cloud).unwrap().attributes.is_empty());
        let bare = coloured.replace(" 0.25 9 8 7", "").replace(" 0.5 255 0 0", "");
        assert!(of(&bare).is_empty());
    }

    #[test]
    fn wrong_counts_are_told_and_damage_is_refused() {
        let short = SCANS.replacen("3\n1\n", "5\n1\n", 1);
        let loaded = read(short.as_bytes(), Want::Cloud).unwrap();
        assert_eq!(loaded.verts.len(), 3);
        assert!(loaded.warnings[0].contains("scan 1 promises 5 x 1 points, 3 are there"));
        let cut = &SCANS[..SCANS.len() - 10];
        assert!(
            read(cut.as_bytes(), Want::Cloud).unwrap().warnings[0]
                .contains("scan 2 promises 1 x 2 points, 1")
        );
        let cases = [
            (SCANS.replacen("0 1 0\n", "0 1\n", 1), "line 5: scan 1: a line of 3 numbers"),
            (SCANS.replacen("4 5 6", "4 x 6", 1), "line 13: point 2: \"x\" is not a number"),
            ("3\n-1\n".into(), "line 2: scan 1: a line with the rows"),
            ("3\n".into(), "ends before the rows"),
            ("3\n1\n0 0 0\n".into(), "ends in the head of a scan"),
            // One row more than promised is taken for the head of a scan.
            (SCANS.replacen("3\n1\n", "2\n1\n", 1), "line 13: scan 2: a line with the columns"),
        ];
        for (text, message) in cases {
            let e = read(text.as_bytes(), Want::Cloud).map(|l| l.verts).unwrap_err().to_string();
            assert!(e.contains(message), "{e}");
        }
    }
}
