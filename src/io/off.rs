//! OFF, the object file format of Geomview, with its kin COFF, NOFF, STOFF and 4OFF.
//!
//! A line with the name, a line with the numbers of vertices, faces and edges, a line for each vertex, a line for each
//! face. The letters in front of the name say what stands behind a position: `N` a normal, `C` a colour, `ST` a place
//! in a texture; `4` gives positions a fourth number that divides the others. Files often have colours without saying
//! so.

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

/// Whether the text begins with a name of this family.
pub(super) fn looks_like_off(bytes: &[u8]) -> bool {
    let mut lines = Lines::new(&bytes[..bytes.len().min(4096)]).map(|(_, l)| without_comment(l));
    lines.find(|l| !l.is_empty()).and_then(name).is_some()
}

/// Reads v x 3 positions and, if wanted, polygons cut into f x 3 triangles.
pub(super) fn read(bytes: &[u8], want: Want) -> Result<Loaded, Error> {
    let mut lines = Lines::new(without_byte_order_mark(bytes)?)
        .map(|(number, line)| (number, without_comment(line)))
        .filter(|(_, line)| !line.is_empty());
    let wrong = |what: String, line: u64| {
        Error::new(ErrorKind::Format, what)
            .at_line(line)
            .advise("an OFF file begins with OFF and the numbers of vertices, faces and edges")
    };
    let Some((first, line)) = lines.next() else { return Err(wrong("the file is empty".into(), 1)) };
    let Some((kind, rest)) = name(line) else {
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
    let counts: Option<Vec<u64>> =
        words(line).map(|w| integer(w).and_then(|n| u64::try_from(n).ok())).collect();
    let (vertices, faces) = match counts.as_deref() {
        Some([vertices, faces] | [vertices, faces, _]) => (*vertices, *faces),
        _ => return Err(wrong(format!("{} are not the counts of vertices and faces", show(line)), number)),
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
        return Ok(loaded);
    }
    let mut polygon = Vec::new();
    for i in 0..faces {
        let Some((number, line)) = lines.next() else { return Err(cut("faces", faces, i)) };
        let at = |e: Error| e.at_line(number).at_element(format!("face {i}"));
        corners(line, &mut polygon).and_then(|()| push_fan(&mut loaded.faces, &polygon)).map_err(at)?;
    }
    Ok(loaded)
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
