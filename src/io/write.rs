//! Writing clouds and meshes: what is checked first, and which format does it.

use std::io::{self, Write};
use std::path::Path;

use super::encoding::{Encoding, Width};
use super::precision::check_point;
use super::{Format, Want, glb, obj, off, ply, stl, table, write_atomic};
use crate::geometry::{Attribute, COLOUR, Number, Position, TriangleMesh, colours, widened};
use crate::{Error, ErrorKind};

/// Writes a mesh in the format that the extension of `path` means: `ply`, `stl` and `glb` in binary, `obj` and `off` as
/// text.
///
/// The file appears whole or not at all, see [`write_atomic`]. Coordinates are written in 32 bits where that loses
/// nothing that matters (the mesh's [`offset`](TriangleMesh::offset) is 0), else in 64. STL has 32 only: see
/// [`offset_left_out`].
///
/// # Errors
///
/// As [`write_mesh_to`]; [`ErrorKind::Format`] also if the extension means no format.
pub fn write_mesh<P: Position>(path: impl AsRef<Path>, mesh: &TriangleMesh<P>) -> Result<(), Error> {
    let (path, mesh) = (path.as_ref(), mesh.wide());
    let format = by_extension(path, "ply, obj, stl, off, glb")?;
    check_mesh(&mesh, format).map_err(|e| e.in_file(path))?;
    write_atomic(path, |out| {
        emit_mesh(out, &mesh, &[], format, Encoding::Binary).map_err(|e| Error::cannot_write(path, e))
    })
}

/// Writes a mesh to any writer; nothing is written unless the mesh passes the checks. Give a buffered writer, such as
/// that of [`write_atomic`] for a file in a format that its name does not mean.
///
/// # Errors
///
/// [`ErrorKind::Format`] for a format that holds no meshes, [`ErrorKind::Data`] for a mesh without faces, with an index
/// out of range or a coordinate that is not finite, [`ErrorKind::Io`] if writing fails.
pub fn write_mesh_to<P: Position>(
    mut out: impl Write,
    mesh: &TriangleMesh<P>,
    format: Format,
    encoding: Encoding,
) -> Result<(), Error> {
    let mesh = mesh.wide();
    check_mesh(&mesh, format)?;
    emit_mesh(&mut out, &mesh, &[], format, encoding).and_then(|()| out.flush()).map_err(failed)
}

/// Writes a mesh with attributes of its vertices to any writer; nothing is written unless all passes the checks. Give a
/// buffered writer.
///
/// PLY has a property for each; OBJ and GLB hold the colours `red`, `green` and `blue` only, from 0 to 1 (bytes are
/// parts of 255).
///
/// ```
/// use bijective_sdf::geometry::{Attribute, Number, TriangleMesh};
/// use bijective_sdf::io::{Encoding, Format, write_mesh_with_to};
///
/// let mesh = TriangleMesh { verts: vec![[0.0f32; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], faces: vec![[0, 1, 2]] };
/// let height = Attribute { name: "height".into(), number: Number::F32, values: vec![0.5, 1.5, 2.0] };
/// let mut out = Vec::new();
/// write_mesh_with_to(&mut out, &mesh, &[height], Format::Ply, Encoding::Ascii)?;
/// assert!(String::from_utf8_lossy(&out).contains("property float height"));
/// # Ok::<(), bijective_sdf::Error>(())
/// ```
///
/// # Errors
///
/// As [`write_mesh_to`]; [`ErrorKind::Format`] also for an attribute that the format does not hold
/// ([`Format::holds_attribute`]), [`ErrorKind::Config`] for one whose name is that of a coordinate or of another, or
/// has other characters than letters, digits and marks of ASCII.
///
/// # Panics
///
/// If an attribute has not one value a vertex.
#[track_caller]
pub fn write_mesh_with_to<P: Position>(
    mut out: impl Write,
    mesh: &TriangleMesh<P>,
    attributes: &[Attribute],
    format: Format,
    encoding: Encoding,
) -> Result<(), Error> {
    let v = mesh.verts.len();
    for Attribute { name, values, .. } in attributes {
        assert!(values.len() == v, "write_mesh_with_to: {} values of {name}, {v} vertices", values.len());
    }
    check_attributes(attributes, format)?;
    let mesh = mesh.wide();
    check_mesh(&mesh, format)?;
    emit_mesh(&mut out, &mesh, attributes, format, encoding).and_then(|()| out.flush()).map_err(failed)
}

/// Writes points, n x 3, in the format that the extension of `path` means: `ply` in binary, `xyz` or `csv` as text; in
/// 32 bits if these hold all coordinates exactly, else in 64.
///
/// # Errors
///
/// As [`write_cloud_to`]; [`ErrorKind::Format`] also if the extension means no format.
pub fn write_cloud<P: Position>(path: impl AsRef<Path>, points: &[P]) -> Result<(), Error> {
    let (path, points) = (path.as_ref(), widened(points));
    let format = by_extension(path, "ply, xyz, csv")?;
    check_cloud(&points, format).map_err(|e| e.in_file(path))?;
    write_atomic(path, |out| {
        emit_cloud(out, &points, format, Encoding::Binary).map_err(|e| Error::cannot_write(path, e))
    })
}

/// Writes points, n x 3, to any writer; nothing is written unless they pass the checks. Give a buffered writer, such as
/// that of [`write_atomic`] for a file in a format that its name does not mean.
///
/// # Errors
///
/// [`ErrorKind::Format`] for a format this crate does not write clouds in, [`ErrorKind::Data`] for no points or a
/// coordinate that is not finite, [`ErrorKind::Io`] if writing fails.
pub fn write_cloud_to<P: Position>(
    mut out: impl Write,
    points: &[P],
    format: Format,
    encoding: Encoding,
) -> Result<(), Error> {
    let points = widened(points);
    check_cloud(&points, format)?;
    emit_cloud(&mut out, &points, format, encoding).and_then(|()| out.flush()).map_err(failed)
}

/// Writes points, n x 3, with a colour each (n x 3: red, green, blue), as PLY with the properties `red`, `green` and
/// `blue` of a byte each, to any writer; nothing is written unless they pass the checks. Give a buffered writer.
///
/// # Errors
///
/// [`ErrorKind::Data`] for no points or a coordinate that is not finite, [`ErrorKind::Io`] if writing fails.
///
/// # Panics
///
/// If there is not one colour a point.
#[track_caller]
pub fn write_coloured_cloud_to<P: Position>(
    out: impl Write,
    points: &[P],
    colours: &[[u8; 3]],
    encoding: Encoding,
) -> Result<(), Error> {
    assert!(points.len() == colours.len(), "{} points with {} colours", points.len(), colours.len());
    let part = |(axis, name): (usize, &str)| Attribute {
        name: name.into(),
        number: Number::U8,
        values: colours.iter().map(|c| f64::from(c[axis])).collect(),
    };
    let colours: Vec<Attribute> = COLOUR.into_iter().enumerate().map(part).collect();
    write_cloud_with_to(out, points, &colours, encoding)
}

/// Writes points, n x 3, with attributes, such as the normals `nx`, `ny` and `nz`, as PLY to any writer; nothing is
/// written unless they pass the checks. Give a buffered writer.
///
/// # Errors
///
/// [`ErrorKind::Data`] for no points or a coordinate that is not finite, [`ErrorKind::Config`] for an attribute whose
/// name is that of a coordinate or of another, or has other characters than letters, digits and marks of ASCII,
/// [`ErrorKind::Io`] if writing fails.
///
/// # Panics
///
/// If an attribute has not one value a point.
#[track_caller]
pub fn write_cloud_with_to<P: Position>(
    mut out: impl Write,
    points: &[P],
    attributes: &[Attribute],
    encoding: Encoding,
) -> Result<(), Error> {
    for Attribute { name, values, .. } in attributes {
        let n = points.len();
        assert!(values.len() == n, "write_cloud_with_to: {} values of {name}, {n} points", values.len());
    }
    let points = widened(points);
    check_attributes(attributes, Format::Ply)?;
    check_cloud(&points, Format::Ply)?;
    ply::write(&mut out, &points, Width::of_cloud(&points), attributes, None, encoding)
        .and_then(|()| out.flush())
        .map_err(failed)
}

/// What a format leaves out of the coordinates of a mesh because it has 32 bits only and the detail of the mesh needs
/// more: its [`offset`](TriangleMesh::offset) in STL, to be added again by who reads the file; else `None`.
pub fn offset_left_out<P: Position>(mesh: &TriangleMesh<P>, format: Format) -> Option<[f64; 3]> {
    if format == Format::Stl { stl::offset_left_out(mesh) } else { None }
}

fn emit_mesh(
    out: &mut dyn Write,
    mesh: &TriangleMesh<[f64; 3]>,
    attributes: &[Attribute],
    format: Format,
    encoding: Encoding,
) -> io::Result<()> {
    let width = Width::of_mesh(&mesh.verts);
    let colours = || colours(attributes);
    match format {
        Format::Ply => ply::write(out, &mesh.verts, width, attributes, Some(&mesh.faces), encoding),
        Format::Stl => stl::write(out, mesh, encoding),
        Format::Obj => obj::write(out, mesh, width, colours().as_deref()),
        Format::Off => off::write(out, mesh, width),
        Format::Glb => glb::write(out, mesh, colours().as_deref()),
        _ => Err(io::Error::new(io::ErrorKind::Unsupported, "not a mesh format")),
    }
}

fn emit_cloud(
    out: &mut dyn Write,
    points: &[[f64; 3]],
    format: Format,
    encoding: Encoding,
) -> io::Result<()> {
    let width = Width::of_cloud(points);
    match format {
        Format::Ply => ply::write(out, points, width, &[], None, encoding),
        Format::Xyz => table::write(out, points, width, " "),
        Format::Csv => table::write(out, points, width, ","),
        _ => Err(io::Error::new(io::ErrorKind::Unsupported, "not a cloud format")),
    }
}

fn by_extension(path: &Path, writable: &str) -> Result<Format, Error> {
    Format::from_path(path).ok_or_else(|| {
        Error::new(ErrorKind::Format, "the file name's extension means no known format")
            .in_file(path)
            .advise(format!("name the file with one of {writable}"))
    })
}

fn check_mesh(mesh: &TriangleMesh<[f64; 3]>, format: Format) -> Result<(), Error> {
    if !format.holds_faces() {
        return Err(Error::new(ErrorKind::Format, format!("meshes are not written as {format}"))
            .advise("choose one of ply, obj, stl, off, glb"));
    }
    let (v, f) = (mesh.verts.len(), mesh.faces.len());
    if f == 0 {
        return Err(Error::new(ErrorKind::Data, "the mesh has no faces, so there is nothing to write"));
    }
    // PLY face lists are signed and STL counts its triangles in 32 bits.
    if v > i32::MAX as usize || f > u32::MAX as usize {
        return Err(Error::new(
            ErrorKind::Data,
            format!("{v} vertices and {f} faces are too many for {format}"),
        )
        .advise("write the mesh in parts"));
    }
    for (i, &p) in mesh.verts.iter().enumerate() {
        check_point(p, Want::Mesh, "vertex", i)?;
    }
    if let Some(i) = mesh.faces.iter().position(|face| face.iter().any(|&c| c as usize >= v)) {
        return Err(Error::new(
            ErrorKind::Data,
            format!("{:?} names a vertex beyond the {v} vertices", mesh.faces[i]),
        )
        .at_element(format!("face {i}")));
    }
    Ok(())
}

fn check_attributes(attributes: &[Attribute], format: Format) -> Result<(), Error> {
    for (i, attribute) in attributes.iter().enumerate() {
        let name = attribute.name.as_str();
        if !format.holds_attribute(name) {
            return Err(Error::new(ErrorKind::Format, format!("{format} files have no place for {name:?}"))
                .advise("write ply"));
        }
        let taken = ["x", "y", "z"].contains(&name) || attributes[..i].iter().any(|a| a.name == name);
        if taken || name.is_empty() || !name.bytes().all(|b| b.is_ascii_graphic()) {
            return Err(Error::new(ErrorKind::Config, format!("an attribute cannot be named {name:?}"))
                .advise("give each a name of its own, of letters and digits"));
        }
    }
    Ok(())
}

fn check_cloud(points: &[[f64; 3]], format: Format) -> Result<(), Error> {
    if !matches!(format, Format::Ply | Format::Xyz | Format::Csv) {
        return Err(Error::new(ErrorKind::Format, format!("point clouds are not written as {format}"))
            .advise("choose one of ply, xyz, csv"));
    }
    if points.is_empty() {
        return Err(Error::new(ErrorKind::Data, "there are no points to write"));
    }
    points.iter().enumerate().try_for_each(|(i, &p)| check_point(p, Want::Mesh, "point", i))
}

/// The error of a writer that may write to anything.
pub(super) fn failed(e: io::Error) -> Error {
    Error::new(ErrorKind::Io, "writing failed").caused_by(e)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::relative_to;

    fn mesh() -> TriangleMesh {
        TriangleMesh { verts: vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], faces: vec![[0, 1, 2]] }
    }

    #[test]
    fn refuses_what_it_cannot_write_before_writing() {
        let good = mesh();
        let mut far = mesh();
        far.faces[0][2] = 3;
        let mut nan = mesh();
        nan.verts[1][2] = f32::NAN;
        let bare = TriangleMesh { faces: vec![], ..mesh() };
        let cases = [
            (&good, Format::Xyz, ErrorKind::Format, "meshes are not written as xyz"),
            (&far, Format::Ply, ErrorKind::Data, "beyond the 3 vertices"),
            (&nan, Format::Obj, ErrorKind::Data, "vertex 1: z is NaN"),
            (&bare, Format::Stl, ErrorKind::Data, "no faces"),
        ];
        for (mesh, format, kind, message) in cases {
            let mut out = Vec::new();
            let e = write_mesh_to(&mut out, mesh, format, Encoding::Binary).unwrap_err();
            assert_eq!(e.kind(), kind, "{e}");
            assert!(e.to_string().contains(message), "{e}");
            assert!(out.is_empty());
        }
        let mut out = Vec::new();
        let e = write_cloud_to(&mut out, &[[0.0; 3]], Format::Npy, Encoding::Binary).unwrap_err();
        assert!(e.to_string().contains("choose one of ply, xyz, csv"), "{e}");
        let e = write_cloud_to(&mut out, &[[0.0f32; 3]; 0], Format::Ply, Encoding::Binary).unwrap_err();
        assert_eq!(e.kind(), ErrorKind::Data);
        let e = write_mesh("mesh.las", &good).unwrap_err();
        assert!(e.to_string().contains("ply, obj, stl"), "{e}");
    }

    #[test]
    fn colours_stand_beside_the_points_and_do_not_disturb_a_reader() {
        let points = [[0.5f32, -1.0, 2.25], [1e-3, 0.0, 7.0]];
        let colours = [[0, 128, 255], [13, 10, 32]];
        for encoding in [Encoding::Ascii, Encoding::Binary] {
            let mut out = Vec::new();
            write_coloured_cloud_to(&mut out, &points, &colours, encoding).unwrap();
            let read = crate::io::read_cloud_bytes(&out, None).unwrap();
            assert_eq!(relative_to(&read.points, [0.0; 3]), points);
            assert!(read.notices[0].contains("red, green, blue"), "{:?}", read.notices);
            match encoding {
                Encoding::Ascii => assert!(out.ends_with(b" 0 128 255\n0.001 0 7 13 10 32\n")),
                Encoding::Binary => assert!(out.ends_with(&[13, 10, 32])),
            }
        }
        let error =
            write_coloured_cloud_to(Vec::new(), &[[0.0f32; 3]; 0], &[], Encoding::Binary).unwrap_err();
        assert_eq!(error.kind(), ErrorKind::Data);
    }

    #[test]
    fn attributes_come_back_as_they_were_and_are_refused_where_there_is_no_place() {
        let numbers = [
            ("a", Number::I8, [-128.0, 127.0, 0.0]),
            ("b", Number::U8, [255.0, 0.0, 1.0]),
            ("c", Number::I16, [-32_768.0, 5.0, 6.0]),
            ("d", Number::U16, [65_535.0, 5.0, 6.0]),
            ("e", Number::I32, [-2e9, 5.0, 6.0]),
            ("f", Number::U32, [4e9, 5.0, 6.0]),
            ("g", Number::F32, [0.5, -0.25, f64::from(0.1f32)]),
            ("h", Number::F64, [1e300, 0.1, -7.0]),
        ];
        let of = |(name, number, values): (&str, Number, [f64; 3])| Attribute {
            name: name.into(),
            number,
            values: values.into(),
        };
        let attributes: Vec<Attribute> = numbers.into_iter().map(of).collect();
        let options = crate::io::ReadOptions { attributes: true, ..Default::default() };
        for encoding in [Encoding::Ascii, Encoding::Binary] {
            let mut out = Vec::new();
            write_mesh_with_to(&mut out, &mesh(), &attributes, Format::Ply, encoding).unwrap();
            assert_eq!(crate::io::read_mesh_bytes(&out, None).unwrap(), mesh().wide());
            assert_eq!(crate::io::read_cloud_with(&out, &options).unwrap().attributes, attributes);
            assert!(crate::io::read_cloud_bytes(&out, None).unwrap().attributes.is_empty());
        }
        let colour = |name| of((name, Number::U8, [255.0, 0.0, 51.0]));
        let colours = COLOUR.map(colour);
        let mut out = Vec::new();
        write_mesh_with_to(&mut out, &mesh(), &colours, Format::Obj, Encoding::Binary).unwrap();
        assert!(out.starts_with(b"v 0 0 0 1 1 1\nv 1 0 0 0 0 0\nv 0 1 0 0.2 0.2 0.2\nf 1 2 3"));
        let read = crate::io::read_cloud_with(&out, &options).unwrap().attributes;
        assert!(read.len() == 3 && read[2].name == "blue" && read[2].values == [1.0, 0.0, 0.2]);
        for (format, attribute, message) in [
            (Format::Obj, "a", "no place for \"a\""),
            (Format::Stl, "red", "no place for \"red\""),
            (Format::Ply, "y", "cannot be named \"y\""),
            (Format::Ply, "a b", "cannot be named"),
            (Format::Ply, "", "cannot be named"),
        ] {
            let attribute = [colour(attribute)];
            let mut out = Vec::new();
            let e = write_mesh_with_to(&mut out, &mesh(), &attribute, format, Encoding::Ascii).unwrap_err();
            assert!(e.to_string().contains(message) && out.is_empty(), "{e}");
        }
    }

    #[test]
    fn large_coordinates_keep_their_digits_where_the_format_has_room() {
        let at = [450_123.4, 5_411_234.6, 320.0];
        let place = |p: [f64; 3]| -> [f64; 3] { std::array::from_fn(|a| p[a] + at[a]) };
        let far =
            TriangleMesh { verts: mesh().wide().verts.into_iter().map(place).collect(), ..mesh().wide() };
        for format in [Format::Ply, Format::Obj, Format::Off] {
            for encoding in [Encoding::Binary, Encoding::Ascii] {
                let mut out = Vec::new();
                write_mesh_to(&mut out, &far, format, encoding).unwrap();
                assert_eq!(crate::io::read_mesh_bytes(&out, Some(format)).unwrap(), far, "{format}");
            }
            assert_eq!(offset_left_out(&far, format), None);
        }
        let offset = offset_left_out(&far, Format::Stl).unwrap();
        let mut out = Vec::new();
        write_mesh_to(&mut out, &far, Format::Stl, Encoding::Binary).unwrap();
        let read = crate::io::read_mesh_bytes(&out, None).unwrap();
        for (v, wanted) in read.verts.iter().zip(&far.verts) {
            assert!((0..3).all(|a| (v[a] + offset[a] - wanted[a]).abs() < 1e-5), "{v:?} {wanted:?}");
        }
        // What is of 32 bits anyway, and what is near, is left as it is.
        assert_eq!(offset_left_out(&mesh(), Format::Stl), None);
        for format in [Format::Ply, Format::Xyz, Format::Csv] {
            let mut out = Vec::new();
            write_cloud_to(&mut out, &far.verts, format, Encoding::Binary).unwrap();
            let options = crate::io::ReadOptions { format: Some(format), assume: true, ..Default::default() };
            assert_eq!(crate::io::read_cloud_with(&out, &options).unwrap().points, far.verts, "{format}");
        }
    }

    #[test]
    fn a_writer_that_fails_gives_an_io_error() {
        struct Full;
        impl Write for Full {
            fn write(&mut self, _: &[u8]) -> io::Result<usize> {
                Err(io::Error::other("disk full"))
            }
            fn flush(&mut self) -> io::Result<()> {
                Ok(())
            }
        }
        for format in [Format::Ply, Format::Obj, Format::Stl] {
            let e = write_mesh_to(Full, &mesh(), format, Encoding::Binary).unwrap_err();
            assert_eq!(e.kind(), ErrorKind::Io);
            let cause = std::error::Error::source(&e).unwrap().to_string();
            assert!(cause.contains("disk full"), "{e}: {cause}");
        }
    }
}
