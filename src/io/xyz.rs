//! XYZ and CSV: one point a line.
//!
//! Both names read the same way. Columns are separated by commas, by semicolons or by white space; `#` and `//` start
//! comments; a first line may hold the number of points (as in `.pts`) or the names of the columns. Where names are
//! given and x, y, z are among them, these columns are taken, else the first three. Columns named nx, ny, nz are
//! normals; six columns without names may as well be colours.

use std::io::{self, Write};

use super::text::{Lines, not_a_number, three_floats, without_mark, words, write_floats};
use super::{Loaded, NORMAL, check_point, float};
use crate::{Error, ErrorKind};

/// Reads n x 3 points.
pub(super) fn read(bytes: &[u8]) -> Result<Loaded, Error> {
    let mut verts: Vec<[f32; 3]> = Vec::new();
    let mut notices = Vec::new();
    let mut promised: Option<u64> = None;
    let mut names: Option<Vec<String>> = None;
    let mut columns = Columns { point: [0, 1, 2], normal: None };
    let mut normals = Vec::new();
    let mut fields: Vec<&[u8]> = Vec::new();

    for (number, line) in Lines::new(without_mark(bytes)?) {
        let (data, comment) = split_comment(line.trim_ascii());
        if verts.is_empty()
            && let Some(comment) = comment
            && let Some(found) = axis_names(comment)
        {
            names = Some(found);
        }
        if data.is_empty() {
            continue;
        }
        let at = |e: Error, index: usize| e.at_line(number).at_element(format!("point {index}"));
        if verts.is_empty() {
            split(data, &mut fields);
            if promised.is_none() && fields.len() == 1 {
                let count = std::str::from_utf8(fields[0]).ok().and_then(|s| s.parse().ok());
                if count.is_some() {
                    promised = count;
                    continue;
                }
            }
            if fields.iter().all(|f| float(f).is_none()) && names.is_none() {
                names =
                    Some(fields.iter().map(|f| String::from_utf8_lossy(f).to_ascii_lowercase()).collect());
                continue;
            }
            columns = choose_columns(names.as_deref(), fields.len(), &mut notices);
        }
        let point = read_point(data, columns.point, &mut fields).map_err(|e| at(e, verts.len()))?;
        check_point(point, "point", verts.len()).map_err(|e| e.at_line(number))?;
        verts.push(point);
        if let Some(columns) = columns.normal {
            // A missing or odd value spoils the normals, not the points.
            split(data, &mut fields);
            let part = |c: usize| fields.get(c).and_then(|f| float(f)).unwrap_or(f32::NAN);
            normals.push(columns.map(part));
        }
    }

    if let Some(promised) = promised {
        let found = verts.len() as u64;
        if found < promised {
            return Err(Error::new(
                ErrorKind::Format,
                format!("truncated: the first line promises {promised} points, {found} are there"),
            )
            .advise("fetch the file again or correct its first line"));
        }
        if found > promised {
            notices.push(format!("the first line promises {promised} points; all {found} were read"));
        }
    }
    Ok(Loaded { verts, normals, notices, ..Loaded::default() })
}

/// Writes n points a line each; with a comma as `separator` a line of column names comes first.
pub(super) fn write(out: &mut dyn Write, points: &[[f32; 3]], separator: &str) -> io::Result<()> {
    if separator == "," {
        out.write_all(b"x,y,z\n")?;
    }
    for &p in points {
        write_floats(out, p, separator)?;
        out.write_all(b"\n")?;
    }
    Ok(())
}

/// Cuts a line into data and comment, both trimmed.
fn split_comment(line: &[u8]) -> (&[u8], Option<&[u8]>) {
    if let Some(comment) = line.strip_prefix(b"//") {
        return (b"", Some(comment.trim_ascii()));
    }
    match line.iter().position(|&b| b == b'#') {
        Some(at) => (line[..at].trim_ascii(), Some(line[at + 1..].trim_ascii())),
        None => (line, None),
    }
}

/// The column names in a comment such as `id x y z`, if x, y and z are among its words.
fn axis_names(comment: &[u8]) -> Option<Vec<String>> {
    let mut fields = Vec::new();
    split(comment, &mut fields);
    let names: Vec<String> = fields.iter().map(|f| String::from_utf8_lossy(f).to_ascii_lowercase()).collect();
    ["x", "y", "z"].iter().all(|axis| names.iter().any(|n| n == axis)).then_some(names)
}

/// Cuts a line at its separators. Commas and semicolons keep empty fields, so that a missing value is not skipped.
fn split<'a>(line: &'a [u8], fields: &mut Vec<&'a [u8]>) {
    fields.clear();
    let unquoted = |f: &'a [u8]| {
        let f = f.trim_ascii();
        f.strip_prefix(b"\"").and_then(|f| f.strip_suffix(b"\"")).unwrap_or(f)
    };
    let separator = if line.contains(&b';') { b';' } else { b',' };
    if line.contains(&separator) {
        fields.extend(line.split(|&b| b == separator).map(unquoted));
        if fields.last().is_some_and(|f| f.is_empty()) {
            fields.pop();
        }
    } else {
        fields.extend(words(line).map(unquoted));
    }
}

/// Where the numbers of a point are.
struct Columns {
    point: [usize; 3],
    normal: Option<[usize; 3]>,
}

/// The columns of position and normal, from the names if these fit the `total` columns of the first point.
fn choose_columns(names: Option<&[String]>, total: usize, notices: &mut Vec<String>) -> Columns {
    let named = names.filter(|n| n.len() == total);
    let places = |axes: [&str; 3]| -> Option<[usize; 3]> {
        let place = |axis: &str| named?.iter().position(|n| n == axis);
        Some([place(axes[0])?, place(axes[1])?, place(axes[2])?])
    };
    let columns = match places(["x", "y", "z"]) {
        Some(point) => Columns { point, normal: places(NORMAL) },
        None => {
            if names.is_some() {
                notices.push("the column names give no x, y, z; the first 3 columns were used".to_string());
            }
            Columns { point: [0, 1, 2], normal: None }
        }
    };
    let read = if columns.normal.is_some() { 6 } else { 3 };
    match total.saturating_sub(read) {
        0 => {}
        1 => notices.push("ignored 1 extra column".to_string()),
        extra => notices.push(format!("ignored {extra} extra columns")),
    }
    columns
}

fn read_point<'a>(
    data: &'a [u8],
    columns: [usize; 3],
    fields: &mut Vec<&'a [u8]>,
) -> Result<[f32; 3], Error> {
    let commas = data.contains(&b',');
    let semicolons = data.contains(&b';');
    if commas && semicolons {
        return Err(Error::new(ErrorKind::Format, "the line has both commas and semicolons").advise(
            "write numbers with a decimal point and separate columns by one of space, tab, comma, semicolon",
        ));
    }
    if !commas && !semicolons && columns == [0, 1, 2] && !data.contains(&b'"') {
        return three_floats(words(data));
    }
    split(data, fields);
    let mut point = [0.0; 3];
    for (value, column) in point.iter_mut().zip(columns) {
        let field: &[u8] = fields.get(column).copied().ok_or_else(|| {
            let needed = columns.iter().max().map_or(3, |c| c + 1);
            Error::new(ErrorKind::Format, format!("{needed} numbers expected, {} found", fields.len()))
                .advise("complete the line or delete it")
        })?;
        if field.is_empty() {
            return Err(Error::new(ErrorKind::Format, format!("column {} is empty", column + 1))
                .advise("complete the line or delete it"));
        }
        *value = float(field).ok_or_else(|| not_a_number(field))?;
    }
    Ok(point)
}

#[cfg(test)]
mod tests {
    use super::*;

    const TWO: [[f32; 3]; 2] = [[1.0, 2.0, 3.0], [-4.5, 0.001, 6.0]];

    #[test]
    fn reads_the_usual_dialects() {
        let cases: [&[u8]; 15] = [
            b"1 2 3\n-4.5 1e-3 6\n",
            b"1\t2\t3\r\n-4.5\t.001\t6.",
            b"1,2,3\n-4.5, 0.001 ,6\n",
            b"1;2;3\n-4.5; +0.001; 6\n",
            b"\xef\xbb\xbf  1   2 3\r-4.5 0.001 6\r",
            b"# comment \xff\n\n1 2 3 # here too\n// and here\n-4.5 0.001 6\n",
            b"x y z\n1 2 3\n-4.5 0.001 6\n",
            b"\"X\",\"Y\",\"Z\"\n\"1\",2,3\n-4.5,0.001,6\n",
            b"2\n1 2 3\n-4.5 0.001 6\n",
            b"1,2,3,\n-4.5,0.001,6,\n",
            b"id,x,y,z\n7,1,2,3\n8,-4.5,0.001,6\n",
            b"z y x\n3 2 1\n6 0.001 -4.5\n",
            b"# id x y z\n7 1 2 3\n8 -4.5 0.001 6\n",
            b"//X Y Z R G B\n1 2 3 0 0 0\n-4.5 0.001 6 0 0 0\n",
            b"1 2 3 word\n-4.5 0.001 6 word\n",
        ];
        for bytes in cases {
            let text = String::from_utf8_lossy(bytes);
            let loaded = read(bytes).unwrap_or_else(|e| panic!("{text}: {e}"));
            assert_eq!(loaded.verts, TWO, "{text}");
        }
    }

    #[test]
    fn says_what_was_ignored() {
        assert!(read(b"1 2 3\n").unwrap().notices.is_empty());
        assert_eq!(read(b"1 2 3 4\n").unwrap().notices, ["ignored 1 extra column"]);
        assert_eq!(read(b"1 2 3 4 5\n").unwrap().notices, ["ignored 2 extra columns"]);
        let named = read(b"a,b,c\n1,2,3\n").unwrap();
        assert_eq!(named.verts, [[1.0, 2.0, 3.0]]);
        assert!(named.notices[0].contains("first 3 columns"));
        assert!(read(b"1\n1 2 3\n4 5 6\n").unwrap().notices[0].contains("promises 1"));
    }

    #[test]
    fn named_columns_are_normals() {
        let cases: [&[u8]; 3] = [
            b"x,y,z,nx,ny,nz\n1,2,3,0,0.6,-.8\n-4.5,0.001,6,1,0,0\n",
            b"# X Y Z NX NY NZ\n1 2 3 0 0.6 -.8\n-4.5 0.001 6 1 0 0\n",
            b"nz;ny;nx;id;z;y;x\n-.8;0.6;0;7;3;2;1\n0;0;1;8;6;0.001;-4.5\n",
        ];
        for bytes in cases {
            let loaded = read(bytes).unwrap();
            assert_eq!(loaded.verts, TWO);
            assert_eq!(
                loaded.normals,
                [[0.0, 0.6, -0.8], [1.0, 0.0, 0.0]],
                "{}",
                String::from_utf8_lossy(bytes)
            );
        }
        assert!(read(b"1 2 3 0 0 1\n").unwrap().normals.is_empty());
        let odd = read(b"x y z nx ny nz\n1 2 3 0 one\n").map(|l| l.normals);
        assert!(odd.is_err() || odd.is_ok_and(|n| n.is_empty()), "names that do not fit give no normals");
        let odd = read(b"x,y,z,nx,ny,nz\n1,2,3,0,one,2\n").unwrap();
        assert!(odd.normals[0][1].is_nan());
    }

    #[test]
    fn errors_name_the_line_and_the_point() {
        let cases: [(&[u8], u64, &str); 9] = [
            (b"1 2 3\n1 2\n", 2, "3 numbers expected, 2 found"),
            (b"1 2 3\n\n1 2 abc\n", 3, "\"abc\" is not a number"),
            (b"1 2 3\n1,5;2,5;3,5\n", 2, "both commas and semicolons"),
            (b"1,5 2,5 3,5\n", 1, "\"5 2\" is not a number"),
            (b"1,2,3\n1,,3\n", 2, "column 2 is empty"),
            (b"1 2 3\n1 nan 3\n", 2, "not a finite"),
            (b"1 2 3\n1 1e60 3\n", 2, "not a finite"),
            (b"x y z\na b c\n", 2, "is not a number"),
            (b"id x y z\n1 1 2 3\n1 2 3\n", 3, "4 numbers expected, 3 found"),
        ];
        for (bytes, line, message) in cases {
            let e = read(bytes).map(|l| l.verts).unwrap_err();
            let text = String::from_utf8_lossy(bytes);
            assert_eq!(e.line(), Some(line), "{text}: {e}");
            assert!(e.to_string().contains(message), "{text}: {e}");
            assert!(e.element().unwrap().starts_with("point "), "{text}: {e}");
            assert!(e.advice().is_some(), "{text}: {e}");
        }
        let e = read(b"3\n1 2 3\n4 5 6\n").map(|l| l.verts).unwrap_err();
        assert!(e.to_string().contains("promises 3 points, 2 are there"), "{e}");
        let e = read(b"\xff\xfe1\x00").map(|l| l.verts).unwrap_err();
        assert!(e.to_string().contains("UTF-16"), "{e}");
    }
}
