//! OFF, the object file format of Geomview, with its kin COFF, NOFF, STOFF and 4OFF.
//!
//! A line with the name, which may be missing, a line with the numbers of vertices, faces and edges, a line for each
//! vertex, a line for each face. The letters in front of the name say what stands behind a position: `N` a normal, `C`
//! a colour, `ST` a place in a texture; `4` gives positions a fourth number that divides the others. Files often have
//! colours without saying so.

use std::io::{self, Write};

use super::encoding::Width;
use super::polygon::push_fan;
use super::precision::check_point;
use super::text::{
    Lines, float, integer, not_a_number, show, three_floats, without_byte_order_mark, words, write_position,
};
use super::{Loaded, Want};
use crate::geometry::TriangleMesh;
use crate::{Error, ErrorKind};

/// What the name of a file says of its vertices.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Kind {
    normal: bool,
    fourth: bool,
}

/// Whether the text begins with a name of this family, or is such a file without a name from the first line to the
/// last.
pub(super) fn looks_like_off(bytes: &[u8]) -> bool {
    first_line(bytes).and_then(name).is_some() || is_nameless(bytes)
}

/// Whether the text begins with counts of vertices and faces instead of a name. A list of points may do so, too.
pub(super) fn begins_with_counts(bytes: &[u8]) -> bool {
    first_line(bytes).and_then(counts).is_some()
}

/// The first line with anything but a comment.
fn first_line(bytes: &[u8]) -> Option<&[u8]> {
    lines(&bytes[..bytes.len().min(4096)]).next().map(|(_, line)| line)
}

/// Whether there are exactly as many vertices and faces as the first line says, and every face names vertices that are
/// there. A list of points of three columns never passes: some face must have the three corners that take four.
fn is_nameless(bytes: &[u8]) -> bool {
    let bytes = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
    let mut lines = lines(bytes).map(|(_, line)| line);
    let Some((vertices, faces)) = lines.next().and_then(counts).filter(|(_, faces)| *faces > 0) else {
        return false;
    };
    if (0..vertices).any(|_| lines.next().is_none_or(|line| three_floats(words(line)).is_err())) {
        return false;
    }
    let (mut polygon, mut most) = (Vec::new(), 0);
    for _ in 0..faces {
        let known = |i: &i64| (0..vertices as i64).contains(i);
        match lines.next().map(|line| corners(line, &mut polygon)) {
            Some(Ok(())) if !polygon.is_empty() && polygon.iter().all(known) => {
                most = polygon.len().max(most)
            }
            _ => return false,
        }
    }
    most >= 3 && lines.next().is_none()
}

/// Reads v x 3 positions and, if wanted, polygons cut into f x 3 triangles.
pub(super) fn read(bytes: &[u8], want: Want) -> Result<Loaded, Error> {
    let mut lines = lines(without_byte_order_mark(bytes)?);
    let wrong = |what: String, line: u64| {
        Error::new(ErrorKind::Format, what)
            .at_line(line)
            .advise("an OFF file begins with OFF and the numbers of vertices, faces and edges")
    };
    let Some((first, line)) = lines.next() else { return Err(wrong("the file is empty".into(), 1)) };
    let nameless = || counts(line).map(|_| (Kind { normal: false, fourth: false }, line));
    let Some((kind, rest)) = name(line).or_else(nameless) else {
        return Err(wrong(format!("{} is not the name of an OFF file", show(line)), first));
    };
    if rest.eq_ignore_ascii_case(b"BINARY") {
        return Err(Error::new(ErrorKind::Format, "binary OFF files are not supported")
            .advise("save the mesh as text, or as PLY"));
    }
    // The counts may stand behind the name.
    let (number, line) = if rest.is_empty() {
        lines.next().ok_or_else(|| wrong("truncated: the file ends in front of its counts".into(), first))?
    } else {
        (first, rest)
    };
    let Some((vertices, faces)) = counts(line) else {
        return Err(wrong(format!("{} are not the counts of vertices and faces", show(line)), number));
    };
    // Three numbers with white space behind each take 6 bytes.
    if vertices > bytes.len() as u64 / 6 + 1 {
        return Err(Error::new(
            ErrorKind::Format,
            format!("truncated: {vertices} vertices promised, {} bytes are there", bytes.len()),
        )
        .at_line(number)
        .advise("fetch the file again; if it is whole, its counts are wrong"));
    }
    let mut loaded = Loaded::default();
    loaded.verts.reserve_exact(vertices as usize);
    for i in 0..vertices as usize {
        let Some((number, line)) = lines.next() else { return Err(cut("vertices", vertices, i as u64)) };
        let at = |e: Error| e.at_line(number).at_element(format!("vertex {i}"));
        vertex(line, kind, want, i, &mut loaded).map_err(at)?;
    }
    if want != Want::Mesh {
        loaded.ignore_faces(faces);
        warn_of_rest(&mut loaded, vertices, faces, lines.count() as u64);
        return Ok(loaded);
    }
    let mut polygon = Vec::new();
    for i in 0..faces {
        let Some((number, line)) = lines.next() else { return Err(cut("faces", faces, i)) };
        let at = |e: Error| e.at_line(number).at_element(format!("face {i}"));
        corners(line, &mut polygon).and_then(|()| push_fan(&mut loaded.faces, &polygon)).map_err(at)?;
    }
    warn_of_rest(&mut loaded, vertices, faces, faces + lines.count() as u64);
    Ok(loaded)
}

/// Warns if more lines stand behind the vertices than there are faces.
fn warn_of_rest(loaded: &mut Loaded, vertices: u64, faces: u64, behind: u64) {
    let what = format!("lines ({vertices} vertices and {faces} faces)");
    loaded.warn_of_rest(&what, vertices.saturating_add(faces), vertices.saturating_add(behind));
}

/// Writes a mesh.
pub(super) fn write(out: &mut dyn Write, mesh: &TriangleMesh<[f64; 3]>, width: Width) -> io::Result<()> {
    writeln!(out, "OFF\n{} {} 0", mesh.verts.len(), mesh.faces.len())?;
    for &p in &mesh.verts {
        write_position(out, p, width, " ")?;
        out.write_all(b"\n")?;
    }
    for [a, b, c] in &mesh.faces {
        writeln!(out, "3 {a} {b} {c}")?;
    }
    Ok(())
}

/// The lines that hold anything but a comment, with their numbers.
fn lines(bytes: &[u8]) -> impl Iterator<Item = (u64, &[u8])> {
    Lines::new(bytes)
        .map(|(number, line)| (number, without_comment(line)))
        .filter(|(_, line)| !line.is_empty())
}

/// The numbers of vertices and faces on a line, behind which that of edges may stand.
fn counts(line: &[u8]) -> Option<(u64, u64)> {
    let number = |word: &[u8]| u64::try_from(integer(word)?).ok();
    // A fourth word makes it something else.
    let all: Option<Vec<u64>> = words(line).take(4).map(number).collect();
    match all?[..] {
        [vertices, faces] | [vertices, faces, _] => Some((vertices, faces)),
        _ => None,
    }
}

fn without_comment(line: &[u8]) -> &[u8] {
    let end = line.iter().position(|&b| b == b'#').unwrap_or(line.len());
    line[..end].trim_ascii()
}

/// The kind that the first line names, and what stands behind the name.
fn name(line: &[u8]) -> Option<(Kind, &[u8])> {
    let line = line.strip_prefix(b"\xef\xbb\xbf").unwrap_or(line);
    let at = line.windows(3).take(6).position(|w| w == b"OFF")?;
    let mut kind = Kind { normal: false, fourth: false };
    let mut letters = &line[..at];
    letters = letters.strip_prefix(b"ST").unwrap_or(letters);
    letters = letters.strip_prefix(b"C").unwrap_or(letters);
    if let Some(rest) = letters.strip_prefix(b"N") {
        (kind.normal, letters) = (true, rest);
    }
    // Some programs write the letters in another order.
    letters = letters.strip_prefix(b"C").unwrap_or(letters);
    if let Some(rest) = letters.strip_prefix(b"4") {
        (kind.fourth, letters) = (true, rest);
    }
    let rest = &line[at + 3..];
    // Some files have their counts right behind the name.
    let apart = rest.first().is_none_or(|b| b.is_ascii_whitespace() || b.is_ascii_digit());
    (letters.is_empty() && apart).then(|| (kind, rest.trim_ascii()))
}

fn vertex(line: &[u8], kind: Kind, want: Want, index: usize, loaded: &mut Loaded) -> Result<(), Error> {
    let mut point = three_floats(words(line))?;
    let mut behind = 3;
    if kind.fourth {
        let word = words(line).nth(3).unwrap_or(b"1");
        let fourth = float(word).ok_or_else(|| not_a_number(word))?;
        point = point.map(|x| x / fourth);
        behind = 4;
    }
    check_point(point, want, "vertex", index)?;
    loaded.verts.push(point);
    if kind.normal && want != Want::Mesh {
        let mut parts = words(line).skip(behind);
        loaded.normals.push([(); 3].map(|()| parts.next().and_then(float).map_or(f32::NAN, |x| x as f32)));
    }
    Ok(())
}

/// The corners of a face; colours may stand behind them.
fn corners(line: &[u8], polygon: &mut Vec<i64>) -> Result<(), Error> {
    let wrong = |word: &[u8]| {
        Error::new(ErrorKind::Format, format!("{} is not a whole number", show(word)))
            .advise("a face is the number of its corners and their indices from 0")
    };
    polygon.clear();
    let mut parts = words(line);
    let first = parts.next().unwrap_or_default();
    let count = integer(first).and_then(|n| usize::try_from(n).ok()).ok_or_else(|| wrong(first))?;
    for word in parts.take(count) {
        polygon.push(integer(word).ok_or_else(|| wrong(word))?);
    }
    if polygon.len() < count {
        return Err(Error::new(
            ErrorKind::Format,
            format!("{count} corners promised, {} are there", polygon.len()),
        )
        .advise("complete the line or export the mesh again"));
    }
    Ok(())
}

fn cut(what: &str, promised: u64, found: u64) -> Error {
    Error::new(ErrorKind::Format, format!("truncated: {promised} {what} promised, {found} are there"))
        .advise("fetch the file again; if it is whole, its counts are wrong")
}

#[cfg(test)]
mod tests {
    use super::super::{Format, ReadOptions, read_cloud_bytes, read_cloud_with, read_mesh_bytes};
    use super::*;

    const SQUARE: [[f64; 3]; 4] = [[0.0, 0.0, 0.5], [1.0, 0.0, 0.5], [1.0, 1.0, 0.5], [0.0, 1.0, 0.5]];

    #[test]
    fn reads_the_whole_family() {
        let cases: [&str; 9] = [
            "OFF\n4 1 0\n0 0 .5\n1 0 .5\n1 1 .5\n0 1 .5\n4 0 1 2 3\n",
            "# made by hand\nOFF # name\n\n4 1\n0 0 .5 # first\n1 0 .5\n\n1 1 .5\n0 1 .5\n4 0 1 2 3 255 0 0\n",
            "OFF 4 1 0\r\n0 0 .5\r\n1 0 .5\r\n1 1 .5\r\n0 1 .5\r\n4 0 1 2 3",
            "OFF4 1 0\n0 0 .5\n1 0 .5\n1 1 .5\n0 1 .5\n4 0 1 2 3\n",
            "COFF\n4 1 0\n0 0 .5 255 0 0 255\n1 0 .5 0 0 0 0\n1 1 .5 0 0 0 0\n0 1 .5 0 0 0 0\n4 0 1 2 3 1.0 0 0\n",
            "NOFF\n4 1 0\n0 0 .5 0 0 1\n1 0 .5 0 0 1\n1 1 .5 0 0 1\n0 1 .5 0 0 1\n4 0 1 2 3\n",
            "STCNOFF\n4 1 0\n0 0 .5 0 0 1 9 9 9 9\n1 0 .5 0 0 1\n1 1 .5 0 0 1\n0 1 .5 0 0 1\n4 0 1 2 3\n",
            "STOFF\n4 1 0\n0 0 .5 0 0\n1 0 .5 1 0\n1 1 .5 1 1\n0 1 .5 0 1\n4 0 1 2 3\n",
            "4OFF\n4 1 0\n0 0 1 2\n2 0 1 2\n1 1 .5 1\n0 1 .5 1\n4 0 1 2 3\n",
        ];
        for text in cases {
            assert!(looks_like_off(text.as_bytes()), "{text}");
            let mesh = read(text.as_bytes(), Want::Mesh).unwrap_or_else(|e| panic!("{text}: {e}"));
            assert_eq!((mesh.verts, mesh.faces), (SQUARE.to_vec(), vec![[0, 1, 2], [0, 2, 3]]), "{text}");
            let cloud = read(text.as_bytes(), Want::Cloud).unwrap();
            assert_eq!((cloud.verts.len(), cloud.ignored_faces), (4, 1));
            let normals = text.split('\n').next().unwrap().contains('N');
            assert_eq!(cloud.normals.first(), normals.then_some(&[0.0, 0.0, 1.0]), "{text}");
        }
        assert!(read(b"OFF\n1 0 0\n1 2 3\n", Want::Cloud).unwrap().notices.is_empty());
        for other in ["OFFSET 1 2 3\n", "x OFF\n", "BOFF\n", "off the wall\n", "1 2 3\n"] {
            assert!(!looks_like_off(other.as_bytes()), "{other}");
        }
    }

    #[test]
    fn the_name_may_be_missing() {
        let rows = "0 0 .5\n1 0 .5\n1 1 .5\n0 1 .5\n";
        for (head, faces) in [("4 1 0", "4 0 1 2 3\n"), ("\n# by hand\n4 1", "4 0 1 2 3 255 0 0 # red\n\n")] {
            let text = format!("{head}\n{rows}{faces}");
            for bytes in [text.clone().into_bytes(), [b"\xef\xbb\xbf", text.as_bytes()].concat()] {
                let mesh = read_mesh_bytes(&bytes, None).unwrap_or_else(|e| panic!("{text}: {e}"));
                assert_eq!((mesh.verts, mesh.faces), (SQUARE.to_vec(), vec![[0, 1, 2], [0, 2, 3]]), "{text}");
                let cloud = read_cloud_bytes(&bytes, None).unwrap();
                assert_eq!((cloud.points, cloud.faces), (SQUARE.to_vec(), 1), "{text}");
            }
        }
        // By the content alone these are points; the name of the file makes three of them OFF.
        let named = |text: &str| Format::of(text.as_bytes(), Some(Format::Off)).unwrap();
        for (text, format) in [
            (format!("4 0 0\n{rows}"), Format::Off),
            (format!("4 2 0\n{rows}4 0 1 2 3\n"), Format::Off),
            (format!("4 1 0\n{rows}3 0 1 4\n"), Format::Off),
            (format!("4 1 0 9\n{rows}4 0 1 2 3\n"), Format::Xyz),
            (format!("4 1 0.5\n{rows}4 0 1 2 3\n"), Format::Xyz),
            (rows.to_string(), Format::Xyz),
        ] {
            assert_eq!(Format::of(text.as_bytes(), None).unwrap(), Format::Xyz, "{text}");
            assert_eq!(named(&text), format, "{text}");
        }
        let options = ReadOptions { hint: Some(Format::Off), ..Default::default() };
        let cloud = read_cloud_with(format!("4 0 0\n{rows}").as_bytes(), &options).unwrap();
        assert_eq!(cloud.points, SQUARE);
        assert!(
            read_cloud_bytes(b"4 1 0.5\n", Some(Format::Off))
                .unwrap_err()
                .to_string()
                .contains("not the name")
        );
    }

    /// Every list of up to four points with whole numbers from 0 to 2 in three columns that could have counts in front.
    #[test]
    fn lists_of_whole_numbers_stay_points() {
        for code in 0..3_u32.pow(6) {
            let digit = |i: u32| code / 3_u32.pow(i) % 3;
            let rows: Vec<String> = (0..2)
                .map(|r| format!("{} {} {}\n", digit(3 * r), digit(3 * r + 1), digit(3 * r + 2)))
                .collect();
            for head in ["1 1 0\n", "1 1 1\n", "2 1 0\n1 1 1\n", "1 2 3\n0 0 0\n"] {
                let text = format!("{head}{}", rows.concat());
                assert!(!looks_like_off(text.as_bytes()), "{text}");
            }
        }
    }

    #[test]
    fn counts_that_are_too_small_are_warned_of() {
        let rows = "0 0 .5\n1 0 .5\n1 1 .5\n0 1 .5\n";
        let warnings = |text: &str, want| {
            let loaded = read(text.as_bytes(), want).unwrap();
            assert!(loaded.verts.len() < 5);
            loaded.warnings
        };
        let points = warnings(&format!("OFF\n3 0 0\n{rows}\n# end\n"), Want::Cloud);
        let expected =
            "the header promises 3 lines (3 vertices and 0 faces), 4 are there; the last 1 were not read";
        assert_eq!(points, [expected]);
        for want in [Want::Cloud, Want::Mesh] {
            let expected =
                "the header promises 5 lines (4 vertices and 1 faces), 7 are there; the last 2 were not read";
            let face = "3 0 1 2\n";
            assert_eq!(warnings(&format!("OFF\n4 1 0\n{rows}{face}{face}{face}"), want), [expected]);
            assert!(warnings(&format!("OFF\n4 1 0\n{rows}{face}\n# end\n"), want).is_empty());
        }
        // Faces that are not there are missed by nobody who wants points.
        assert!(warnings(&format!("OFF\n4 9 0\n{rows}"), Want::Cloud).is_empty());
    }

    #[test]
    fn errors_name_the_place() {
        let cases: [(&str, Option<u64>, &str); 8] = [
            ("OFF BINARY\n", None, "binary OFF files are not supported"),
            ("OFF\n", Some(1), "ends in front of its counts"),
            ("OFF\nx 1 0\n", Some(2), "are not the counts"),
            ("OFF\n99999999999 1 0\n", Some(2), "99999999999 vertices promised"),
            ("OFF\n2 0 0\n0 0 0\n", None, "2 vertices promised, 1 are there"),
            ("OFF\n1 1 0\n0 0\n", Some(3), "vertex 0: 3 numbers expected"),
            ("OFF\n1 1 0\n0 0 0\n3 0 0\n", Some(4), "face 0: 3 corners promised, 2 are there"),
            ("OFF\n1 2 0\n0 0 0\n3 0 0 0\n", None, "2 faces promised, 1 are there"),
        ];
        for (text, line, message) in cases {
            let e = read(text.as_bytes(), Want::Mesh).map(|l| l.verts).unwrap_err();
            assert_eq!(e.line(), line, "{text}: {e}");
            assert!(e.to_string().contains(message), "{text}: {e}");
        }
    }
}
