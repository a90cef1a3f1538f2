//! STL, text and binary. The file repeats each corner's position; equal positions become one vertex.

use std::collections::HashMap;
use std::io::{self, Write};

use super::encoding::Encoding;
use super::number::{ByteOrder, NumberType, unsigned};
use super::precision::check_point;
use super::text::{Lines, show, three_floats, words, write_floats};
use super::{Loaded, Want};
use crate::geometry::vec3::{cross, sub, unit_vector, wide};
use crate::geometry::{Bounds, Position, TriangleMesh, are_f32};
use crate::{Error, ErrorKind};

const HEADER: usize = 84;
const ROW: usize = 50;

/// Whether the bytes have the exact size that a binary STL names, or begin like a text one.
pub(super) fn looks_like_stl(bytes: &[u8]) -> bool {
    size_fits(bytes) || starts_with_solid(bytes)
}

/// Reads f x 3 triangles and merges equal positions into v x 3 vertices.
pub(super) fn read(bytes: &[u8], want: Want) -> Result<Loaded, Error> {
    // Some binary files also begin with `solid`, so the size is asked first.
    let ascii = !size_fits(bytes) && starts_with_solid(bytes);
    let mut loaded = if ascii { read_ascii(bytes, want)? } else { read_binary(bytes, want)? };
    if want != Want::Mesh {
        loaded.ignored_faces = loaded.faces.len() as u64;
    }
    Ok(loaded)
}

/// Writes triangles with unit normals, or zero normals where a triangle has no area, in 32 bits: less the offset of
/// [`offset_left_out`].
pub(super) fn write(
    out: &mut dyn Write,
    mesh: &TriangleMesh<[f64; 3]>,
    encoding: Encoding,
) -> io::Result<()> {
    let local = mesh.relative_to(offset_left_out(mesh).unwrap_or_default());
    match encoding {
        Encoding::Binary => write_binary(out, &local),
        Encoding::Ascii => write_ascii(out, &local),
    }
}

/// What the file leaves out of the coordinates: the offset of a mesh whose detail needs more than 32 bits.
pub(super) fn offset_left_out<P: Position>(mesh: &TriangleMesh<P>) -> Option<[f64; 3]> {
    let offset = || Bounds::of(&mesh.verts).map_or([0.0; 3], |bounds| bounds.offset());
    let narrow = !are_f32(&mesh.verts);
    narrow.then(offset).filter(|&offset| offset != [0.0; 3])
}

fn write_binary(out: &mut dyn Write, mesh: &TriangleMesh) -> io::Result<()> {
    let mut header = [b' '; HEADER];
    header[..13].copy_from_slice(b"bijective-sdf");
    header[80..].copy_from_slice(&(mesh.faces.len() as u32).to_le_bytes());
    out.write_all(&header)?;
    for face in &mesh.faces {
        let corners = face.map(|i| mesh.verts[i as usize]);
        let mut row = [0; ROW];
        let numbers = [normal(corners), corners[0], corners[1], corners[2]];
        for (to, x) in row.as_chunks_mut::<4>().0.iter_mut().zip(numbers.as_flattened()) {
            *to = x.to_le_bytes();
        }
        out.write_all(&row)?;
    }
    Ok(())
}

fn write_ascii(out: &mut dyn Write, mesh: &TriangleMesh) -> io::Result<()> {
    out.write_all(b"solid bijective-sdf\n")?;
    for face in &mesh.faces {
        let corners = face.map(|i| mesh.verts[i as usize]);
        out.write_all(b"facet normal ")?;
        write_floats(out, normal(corners), " ")?;
        out.write_all(b"\nouter loop\n")?;
        for corner in corners {
            out.write_all(b"vertex ")?;
            write_floats(out, corner, " ")?;
            out.write_all(b"\n")?;
        }
        out.write_all(b"endloop\nendfacet\n")?;
    }
    out.write_all(b"endsolid bijective-sdf\n")
}

fn count(bytes: &[u8]) -> Option<u64> {
    unsigned(bytes, 80, 4)
}

fn size_fits(bytes: &[u8]) -> bool {
    count(bytes).is_some_and(|n| n > 0 && (HEADER as u64 + n * ROW as u64) == bytes.len() as u64)
}

fn starts_with_solid(bytes: &[u8]) -> bool {
    let bytes = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes).trim_ascii_start();
    bytes.len() >= 5
        && bytes[..5].eq_ignore_ascii_case(b"solid")
        && bytes.get(5).is_none_or(u8::is_ascii_whitespace)
}

fn read_binary(bytes: &[u8], want: Want) -> Result<Loaded, Error> {
    let Some(n) = count(bytes) else {
        return Err(Error::new(
            ErrorKind::Format,
            format!("truncated: a binary STL begins with {HEADER} bytes, {} are there", bytes.len()),
        )
        .advise("fetch the file again; a text STL begins with the word solid"));
    };
    let rows = &bytes[HEADER..];
    if n * ROW as u64 > rows.len() as u64 {
        return Err(Error::new(
            ErrorKind::Format,
            format!("truncated: {n} triangles promised, {} are there", rows.len() / ROW),
        )
        .advise("fetch the file again; a text STL begins with the word solid"));
    }
    let mut corners = Corners::default();
    let (all, _) = rows.as_chunks::<ROW>();
    // Programs that write while they scan may leave the count at 0.
    let rows = if n == 0 { all } else { &all[..n as usize] };
    if n == 0 && !all.is_empty() {
        let warning = format!("the header promises 0 triangles, {} are there; all were read", all.len());
        corners.loaded.warnings.push(warning);
    } else {
        corners.loaded.warn_of_rest("triangles", n, all.len() as u64);
    }
    for (i, row) in rows.iter().enumerate() {
        let number = |at: usize| NumberType::F32.read(&row[at..], ByteOrder::Little);
        let mut face = [0; 3];
        for (corner, index) in face.iter_mut().enumerate() {
            let at = 12 + 12 * corner;
            let point = [number(at), number(at + 4), number(at + 8)];
            check_point(point, want, "triangle", i)?;
            *index = corners.add(point)?;
        }
        corners.loaded.faces.push(face);
    }
    let extra = bytes.len() - HEADER - rows.len() * ROW;
    if (1..ROW).contains(&extra) {
        corners.loaded.notices.push(format!("ignored {extra} bytes behind the last triangle"));
    }
    Ok(corners.loaded)
}

fn read_ascii(bytes: &[u8], want: Want) -> Result<Loaded, Error> {
    let mut corners = Corners::default();
    let mut face: Vec<u32> = Vec::with_capacity(4);
    let mut closed = false;
    let bytes = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
    for (number, line) in Lines::new(bytes) {
        let triangle = corners.loaded.faces.len();
        let at = |e: Error| e.at_line(number).at_element(format!("triangle {triangle}"));
        let mut parts = words(line);
        let Some(keyword) = parts.next() else { continue };
        let open = !face.is_empty();
        match keyword.to_ascii_lowercase().as_slice() {
            b"vertex" => {
                let point = three_floats(parts).map_err(at)?;
                check_point(point, want, "triangle", triangle).map_err(|e| e.at_line(number))?;
                face.push(corners.add(point)?);
            }
            b"endloop" => {
                let &[a, b, c] = face.as_slice() else {
                    return Err(at(Error::new(
                        ErrorKind::Format,
                        format!("3 vertices expected, {} found", face.len()),
                    )
                    .advise("the file is damaged; export it again")));
                };
                corners.loaded.faces.push([a, b, c]);
                face.clear();
            }
            b"endsolid" if !open => closed = true,
            b"solid" if !open => closed = false,
            b"facet" | b"outer" | b"endfacet" if !open => {}
            other => {
                return Err(at(Error::new(ErrorKind::Format, format!("{} is out of place", show(other)))
                    .advise("the file is damaged; export it again")));
            }
        }
    }
    if !closed {
        return Err(Error::new(
            ErrorKind::Format,
            format!(
                "truncated: the text ends without endsolid after {} triangles",
                corners.loaded.faces.len()
            ),
        )
        .advise("fetch the file again"));
    }
    Ok(corners.loaded)
}

/// Numbers positions in the order of their first appearance.
#[derive(Default)]
struct Corners {
    loaded: Loaded,
    seen: HashMap<[u64; 3], u32>,
}

impl Corners {
    fn add(&mut self, point: [f64; 3]) -> Result<u32, Error> {
        let next = u32::try_from(self.loaded.verts.len())
            .map_err(|_| Error::new(ErrorKind::Format, "more than 4294967296 vertices"))?;
        // Adding 0 turns -0 into 0, so that the two compare equal as bits.
        let index = *self.seen.entry(point.map(|x| (x + 0.0).to_bits())).or_insert(next);
        if index == next {
            self.loaded.verts.push(point);
        }
        Ok(index)
    }
}

/// The unit normal of a triangle; 0 if it has no area.
fn normal(corners: [[f32; 3]; 3]) -> [f32; 3] {
    let [a, b, c] = corners.map(wide);
    unit_vector(cross(sub(b, a), sub(c, a))).map_or([0.0; 3], |unit| unit.map(|x| x as f32))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tetrahedron() -> TriangleMesh {
        TriangleMesh {
            verts: vec![[0.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]],
            faces: vec![[0, 1, 2], [0, 2, 3], [2, 1, 3], [1, 0, 3]],
        }
    }

    fn binary() -> Vec<u8> {
        let mut out = Vec::new();
        write_binary(&mut out, &tetrahedron()).unwrap();
        out
    }

    #[test]
    fn both_encodings_come_back_with_merged_vertices() {
        let mut text = Vec::new();
        write_ascii(&mut text, &tetrahedron()).unwrap();
        for bytes in [binary(), text] {
            let loaded = read(&bytes, Want::Mesh).unwrap();
            assert_eq!(TriangleMesh { verts: loaded.verts, faces: loaded.faces }, tetrahedron().wide());
            assert!(looks_like_stl(&bytes));
        }
    }

    #[test]
    fn normals_are_unit_and_outward() {
        let bytes = binary();
        let row = |i: usize| &bytes[HEADER + ROW * i..][..12];
        let down: Vec<u8> = [0.0_f32, 0.0, -1.0].iter().flat_map(|x| x.to_le_bytes()).collect();
        assert_eq!(row(0), down);
        assert_eq!(normal([[1.0; 3]; 3]), [0.0; 3]);
    }

    #[test]
    fn a_binary_file_may_begin_with_solid_and_have_a_tail() {
        let mut bytes = binary();
        bytes[..6].copy_from_slice(b"solid ");
        assert_eq!(read(&bytes, Want::Mesh).unwrap().faces.len(), 4);
        let mut bytes = binary();
        bytes.extend([0; 7]);
        assert_eq!(read(&bytes, Want::Mesh).unwrap().notices, ["ignored 7 bytes behind the last triangle"]);
    }

    #[test]
    fn a_count_that_is_too_small_is_warned_of() {
        let counted = |count: u32, tail: usize| {
            let mut bytes = binary();
            bytes[80..HEADER].copy_from_slice(&count.to_le_bytes());
            bytes.resize(bytes.len() + tail, 7);
            let loaded = read(&bytes, Want::Mesh).unwrap();
            (loaded.faces.len(), loaded.warnings, loaded.notices)
        };
        let none = Vec::new;
        let few = "the header promises 1 triangles, 4 are there; the last 3 were not read".to_string();
        assert_eq!(counted(1, 0), (1, vec![few.clone()], none()));
        assert_eq!(counted(1, 49), (1, vec![few], none()));
        let zero = "the header promises 0 triangles, 4 are there; all were read".to_string();
        assert_eq!(counted(0, 0), (4, vec![zero.clone()], none()));
        let tail = "ignored 49 bytes behind the last triangle".to_string();
        assert_eq!(counted(0, 49), (4, vec![zero], vec![tail.clone()]));
        assert_eq!(counted(4, 49), (4, none(), vec![tail]));
        let mut empty = binary()[..HEADER].to_vec();
        empty[80..].fill(0);
        let loaded = read(&empty, Want::Mesh).unwrap();
        assert!(loaded.faces.is_empty() && loaded.warnings.is_empty());
    }

    #[test]
    fn zero_signs_do_not_split_vertices() {
        let text =
            b"SOLID x\nFACET NORMAL 0 0 0\nOUTER LOOP\nVERTEX 0 0 0\nvertex -0 0 -0\nvertex 1 0 0\nendloop\n\
            endfacet\nendsolid\n";
        assert_eq!(read(text, Want::Mesh).unwrap().faces, [[0, 0, 1]]);
    }

    #[test]
    fn errors_name_the_place() {
        let e = read(&binary()[..HEADER + ROW + 3], Want::Mesh).map(|l| l.verts).unwrap_err();
        assert!(e.to_string().contains("4 triangles promised, 1 are there"), "{e}");
        let e = read(b"nothing", Want::Mesh).map(|l| l.verts).unwrap_err();
        assert!(e.to_string().contains("84 bytes, 7 are there"), "{e}");
        let cases: [(&str, Option<u64>, &str); 6] = [
            ("solid\nfacet\nouter loop\nvertex 0 0\n", Some(4), "3 numbers expected, 2 found"),
            ("solid\nouter loop\nvertex 0 0 nan\n", Some(3), "not a finite"),
            ("solid\nouter loop\nvertex 0 0 1\nendloop\n", Some(4), "3 vertices expected, 1 found"),
            ("solid\nouter loop\nvertex 0 0 1\nendsolid\n", Some(4), "\"endsolid\" is out of place"),
            ("solid\nwhat\n", Some(2), "\"what\" is out of place"),
            ("solid\nfacet\n", None, "ends without endsolid after 0 triangles"),
        ];
        for (text, line, message) in cases {
            let e = read(text.as_bytes(), Want::Mesh).map(|l| l.verts).unwrap_err();
            assert_eq!(e.line(), line, "{text}: {e}");
            assert!(e.to_string().contains(message), "{text}: {e}");
        }
    }
}
