//! Wavefront OBJ: `v` and `f` lines; everything else is skipped. Colours behind the place of a vertex are no part of
//! the format, but many programs write and read them.

use std::io::{self, Write};

use super::encoding::Width;
use super::polygon::push_fan;
use super::precision::check_point;
use super::text::{
    Lines, float, integer, show, three_floats, without_byte_order_mark, words, write_position,
};
use super::{Loaded, Want};
use crate::geometry::{Attribute, COLOUR, Number, TriangleMesh};
use crate::{Error, ErrorKind};

/// Reads v x 3 positions and, if wanted, polygons cut into f x 3 triangles.
pub(super) fn read(bytes: &[u8], want: Want) -> Result<Loaded, Error> {
    let mut loaded = Loaded::default();
    let mut polygon: Vec<i64> = Vec::new();
    let mut polygons = 0_u64;
    let mut own_normals = true;
    // A face may name vertices that come later in the file, so the largest index is checked at the end.
    let mut largest = (-1_i64, 0_u64, 0_u64);

    for (number, line) in Lines::new(without_byte_order_mark(bytes)?) {
        let mut parts = words(line);
        match parts.next() {
            Some(b"v") => {
                let index = loaded.verts.len();
                if want == Want::Attributes {
                    colour(&mut loaded, parts.clone());
                }
                let point = three_floats(parts)
                    .map_err(|e| e.at_line(number).at_element(format!("vertex {index}")))?;
                check_point(point, want, "vertex", index).map_err(|e| e.at_line(number))?;
                loaded.verts.push(point);
            }
            Some(b"f") => {
                polygons += 1;
                if want != Want::Mesh {
                    own_normals &= parts.take_while(|w| !w.starts_with(b"#")).all(names_its_own_normal);
                    continue;
                }
                let at = |e: Error| e.at_line(number).at_element(format!("face {}", polygons - 1));
                polygon.clear();
                for word in parts.take_while(|w| !w.starts_with(b"#")) {
                    polygon.push(corner(word, loaded.verts.len()).map_err(at)?);
                }
                push_fan(&mut loaded.faces, &polygon).map_err(at)?;
                let most = polygon.iter().copied().max().unwrap_or(-1);
                if most > largest.0 {
                    largest = (most, number, polygons - 1);
                }
            }
            Some(b"vn") if want != Want::Mesh => {
                let mut part = || parts.next().and_then(float).map_or(f32::NAN, |x| x as f32);
                loaded.normals.push([part(), part(), part()]);
            }
            _ => {}
        }
    }
    // Faces may give vertices other normals than those of their numbers.
    if !own_normals || loaded.normals.len() != loaded.verts.len() {
        loaded.normals.clear();
    }

    if largest.0 >= loaded.verts.len() as i64 {
        return Err(Error::new(
            ErrorKind::Format,
            format!("vertex {} is named, but the file has {} vertices", largest.0 + 1, loaded.verts.len()),
        )
        .at_line(largest.1)
        .at_element(format!("face {}", largest.2))
        .advise("the file is truncated or its indices are wrong; export it again"));
    }
    if want != Want::Mesh {
        loaded.ignore_faces(polygons);
    }
    Ok(loaded)
}

/// Whether the corner of a face, such as `7//7` or `7/2/7`, names the normal of the same number as its vertex.
fn names_its_own_normal(corner: &[u8]) -> bool {
    let mut parts = corner.split(|b| *b == b'/');
    let (vertex, normal) = (parts.next(), parts.nth(1));
    normal.is_some() && vertex == normal
}

/// Takes the three numbers behind a place as a colour; behind a weight of the place, if there are four. Where one
/// vertex has none, none has.
fn colour<'a>(loaded: &mut Loaded, words: impl Iterator<Item = &'a [u8]>) {
    let index = loaded.verts.len();
    if index == 0 {
        let one = |name: &str| Attribute { name: name.into(), number: Number::F32, values: Vec::new() };
        loaded.attributes = COLOUR.map(one).into();
    }
    let words = words.take_while(|w| !w.starts_with(b"#"));
    let numbers: Vec<f64> = words.skip(3).take(5).map_while(float).collect();
    match &numbers[..] {
        [part @ .., _, _, _] if part.len() < 2 && !loaded.attributes.is_empty() => {
            let colour = &numbers[part.len()..];
            loaded.attributes.iter_mut().zip(colour).for_each(|(a, &x)| a.values.push(x));
        }
        _ => loaded.attributes.clear(),
    }
}

/// Writes a mesh with indices from 1, and a colour a vertex behind its place, as many programs do.
pub(super) fn write(
    out: &mut dyn Write,
    mesh: &TriangleMesh<[f64; 3]>,
    width: Width,
    colours: Option<&[[f32; 3]]>,
) -> io::Result<()> {
    for (i, &p) in mesh.verts.iter().enumerate() {
        out.write_all(b"v ")?;
        write_position(out, p, width, " ")?;
        if let Some([r, g, b]) = colours.map(|c| c[i]) {
            write!(out, " {r} {g} {b}")?;
        }
        out.write_all(b"\n")?;
    }
    for [a, b, c] in &mesh.faces {
        writeln!(out, "f {} {} {}", u64::from(*a) + 1, u64::from(*b) + 1, u64::from(*c) + 1)?;
    }
    Ok(())
}

/// The vertex index from 0 of a corner `a`, `a/b`, `a//c` or `a/b/c`; negative ones count back from the last vertex.
fn corner(word: &[u8], so_far: usize) -> Result<i64, Error> {
    let position = word.split(|&b| b == b'/').next().unwrap_or(word);
    let wrong = |what: String, advice: &str| Error::new(ErrorKind::Format, what).advise(advice);
    let Some(i) = integer(position) else {
        let what = format!("{} is not a corner such as 5 or 5/2/7", show(word));
        return Err(wrong(what, "correct the line or export the file again"));
    };
    if i == 0 {
        let what = "vertex 0 is named, but OBJ counts from 1".to_string();
        return Err(wrong(what, "add 1 to every index or export the file again"));
    }
    if i > i64::from(u32::MAX) {
        let what = format!("vertex {i} is named, which is not a possible index");
        return Err(wrong(what, "the file is damaged; export it again"));
    }
    if i > 0 {
        return Ok(i - 1);
    }
    if i.unsigned_abs() > so_far as u64 {
        let what = format!("vertex {i} is named, but only {so_far} come before it");
        return Err(wrong(what, "the file is truncated or its indices are wrong; export it again"));
    }
    Ok(so_far as i64 + i)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn normals_are_read_if_each_vertex_has_its_own() {
        let normals = |text: &str| read(text.as_bytes(), Want::Cloud).unwrap().normals;
        let verts = "v 0 0 0\nv 1 0 0\nv 0 1 0\n";
        let own = "vn 0 0 1\nvn 0 0.6 0.8\nvn 1 0 0\n";
        let want = [[0.0, 0.0, 1.0], [0.0, 0.6, 0.8], [1.0, 0.0, 0.0]];
        assert_eq!(normals(&[verts, own].concat()), want);
        assert_eq!(normals(&[verts, own, "f 1//1 2//2 3//3 # 1\n"].concat()), want);
        assert_eq!(normals(&[verts, own, "f 1/9/1 2/9/2 3/9/3\n"].concat()), want);
        for faces in ["f 1//1 2//1 3//1\n", "f 1 2 3\n", "f 1/1 2/2 3/3\n", "vn 0 0 1\n"] {
            assert!(normals(&[verts, own, faces].concat()).is_empty(), "{faces}");
        }
    }

    #[test]
    fn reads_corners_of_every_form() {
        let text = b"# a square pyramid\nmtllib x.mtl\no pyramid\nv 0 0 0\nv 1 0 0 1.0\nv 1 1 0 1 0.5 0.5 0.5\n\
            vn 0 0 1\nvt 0 0\r\nv 0 1 0\nv 0.5 0.5 1\nf 4/1/1 3/1/1 2/1/1 1/1/1 # base\nf 1 2 5\nf 2// 3// 5//\n\
            f -3//1 -2//1 -1//1\nf 4/7 1/7 5/7\n";
        let loaded = read(text, Want::Mesh).unwrap();
        assert_eq!(loaded.verts[4], [0.5, 0.5, 1.0]);
        assert_eq!(loaded.faces, [[3, 2, 1], [3, 1, 0], [0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]]);
        let cloud = read(text, Want::Cloud).unwrap();
        assert_eq!(cloud.verts, loaded.verts);
        assert_eq!(cloud.notices, ["ignored 5 faces; their vertices are the points"]);
    }

    #[test]
    fn faces_may_come_before_their_vertices() {
        let loaded = read(b"f 1 2 3\nv 0 0 0\nv 1 0 0\nv 0 1 0\n", Want::Mesh).unwrap();
        assert_eq!(loaded.faces, [[0, 1, 2]]);
    }

    #[test]
    fn errors_name_line_and_element() {
        let cases: [(&str, u64, &str, &str); 9] = [
            ("v 0 0\n", 1, "vertex 0", "3 numbers expected, 2 found"),
            ("v 0 0 x\n", 1, "vertex 0", "\"x\" is not a number"),
            ("v 0 0 0\nv 0 0 inf\n", 2, "vertex 1", "not a finite"),
            ("v 0 0 0\nf 1 1 2\n", 2, "face 0", "vertex 2 is named, but the file has 1 vertices"),
            ("v 0 0 0\nf 1 1 0\n", 2, "face 0", "counts from 1"),
            ("v 0 0 0\nf 1 1 -2\n", 2, "face 0", "only 1 come before"),
            ("v 0 0 0\nf 1 1 a/b\n", 2, "face 0", "not a corner"),
            ("v 0 0 0\nf 1 1\n", 2, "face 0", "at least 3 corners expected, 2 found"),
            ("v 0 0 0\nf 1 1 99999999999999\n", 2, "face 0", "vertex 99999999999999 is named"),
        ];
        for (text, line, element, message) in cases {
            let e = read(text.as_bytes(), Want::Mesh).map(|l| l.verts).unwrap_err();
            assert_eq!((e.line(), e.element()), (Some(line), Some(element)), "{text}: {e}");
            assert!(e.to_string().contains(message), "{text}: {e}");
            assert!(e.advice().is_some(), "{text}: {e}");
        }
    }
}
