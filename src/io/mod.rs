//! Readers and writers of point clouds and triangle meshes.
//!
//! The format is chosen by the file name's extension, else by the content, or named outright. Every reader checks what
//! a file promises against the bytes at hand before it reserves memory, and refuses coordinates that are not finite,
//! so what comes out can be used as it is. Errors carry the file, the line of a text and the element (`point 17`,
//! `face 3`, counted from 0).
//!
//! | Format | read cloud | read mesh | write cloud | write mesh |
//! |---|---|---|---|---|
//! | PLY (text, binary) | yes | yes | yes | yes |
//! | XYZ, TXT, PTS, ASC | yes | | yes | |
//! | CSV | yes | | yes | |
//! | OBJ | yes | yes | | yes |
//! | STL (text, binary) | yes | yes | | yes |
//! | NPY | yes | | | |
//! | KITTI `.bin` | yes | | | |
//!
//! Adding a format takes one file with `read` and `write`, a variant of [`Format`] and a line in each of the
//! matches below.

use std::fs;
use std::path::Path;

use crate::geometry::TriangleMesh;
use crate::{Error, ErrorKind};

mod format;
mod kitti;
mod npy;
mod obj;
mod ply;
mod stl;
mod text;
mod write;
mod xyz;

pub use crate::atomic::write_atomic;
pub use format::Format;
pub use write::{
    Encoding, write_cloud, write_cloud_as, write_cloud_to, write_coloured_cloud_to, write_mesh,
    write_mesh_as, write_mesh_to,
};

use text::float;

/// The points of a file and what the reader left out.
#[derive(Clone, Debug, Default, PartialEq)]
#[non_exhaustive]
pub struct PointCloud {
    /// Positions, n x 3, all finite, in the order and units of the file.
    pub points: Vec<[f32; 3]>,
    /// Normals, n x 3, all finite and of the file's lengths, if there are columns or properties `nx`, `ny` and `nz`
    /// (PLY, XYZ and CSV). The reconstruction does not use them.
    pub normals: Option<Vec<[f32; 3]>>,
    /// One sentence for each thing worth telling the user, such as `ignored 2 extra columns`.
    pub notices: Vec<String>,
}

/// Reads the points of a file, n x 3; of a mesh file, its vertices.
///
/// # Errors
///
/// [`ErrorKind::Io`] if the file cannot be read, [`ErrorKind::Format`] if the format is unknown or the bytes do not
/// follow it, [`ErrorKind::Data`] for a file without points or with a coordinate that is not finite.
pub fn read_cloud(path: impl AsRef<Path>) -> Result<PointCloud, Error> {
    read_cloud_path(path.as_ref(), None)
}

/// Reads the points of a file whose name does not tell its format.
///
/// # Errors
///
/// As [`read_cloud`].
pub fn read_cloud_as(path: impl AsRef<Path>, format: Format) -> Result<PointCloud, Error> {
    read_cloud_path(path.as_ref(), Some(format))
}

/// Reads points, n x 3, from the bytes of a file, for example from a pipe; without a format the content decides.
///
/// # Errors
///
/// As [`read_cloud`], without a file name and without [`ErrorKind::Io`].
pub fn read_cloud_bytes(bytes: &[u8], format: Option<Format>) -> Result<PointCloud, Error> {
    let loaded = load(bytes, choose(bytes, format)?, Want::Cloud)?;
    if loaded.verts.is_empty() {
        return Err(
            Error::new(ErrorKind::Data, "there are no points").advise("give a file with at least 4 points")
        );
    }
    let mut notices = loaded.notices;
    notices.extend(coarse_floats(&loaded.verts));
    let mut normals = Some(loaded.normals).filter(|n| !n.is_empty());
    if let Some(i) = normals.iter().flatten().position(|n| n.iter().any(|x| !x.is_finite())) {
        notices.push(format!("ignored the normals: that of point {i} is not finite"));
        normals = None;
    }
    Ok(PointCloud { points: loaded.verts, normals, notices })
}

/// Reads a triangle mesh from a PLY, OBJ or STL file; polygons become fans of triangles.
///
/// Every face index is below the number of vertices. Vertices and faces keep the order of the file; STL, which repeats
/// each vertex, gets equal positions merged.
///
/// # Errors
///
/// [`ErrorKind::Io`] if the file cannot be read, [`ErrorKind::Format`] if the format is unknown or holds no faces or
/// the bytes do not follow it, [`ErrorKind::Data`] for a file without vertices or faces or with a coordinate that is
/// not finite.
pub fn read_mesh(path: impl AsRef<Path>) -> Result<TriangleMesh, Error> {
    read_mesh_path(path.as_ref(), None)
}

/// Reads a triangle mesh from a file whose name does not tell its format.
///
/// # Errors
///
/// As [`read_mesh`].
pub fn read_mesh_as(path: impl AsRef<Path>, format: Format) -> Result<TriangleMesh, Error> {
    read_mesh_path(path.as_ref(), Some(format))
}

/// Reads a triangle mesh from the bytes of a file; without a format the content decides.
///
/// # Errors
///
/// As [`read_mesh`], without a file name and without [`ErrorKind::Io`].
pub fn read_mesh_bytes(bytes: &[u8], format: Option<Format>) -> Result<TriangleMesh, Error> {
    let loaded = load(bytes, choose(bytes, format)?, Want::Mesh)?;
    if loaded.verts.is_empty() || loaded.faces.is_empty() {
        let what = if loaded.verts.is_empty() { "vertices" } else { "faces" };
        return Err(Error::new(ErrorKind::Data, format!("there are no {what}"))
            .advise("give a triangle mesh; if the file is a point cloud, reconstruct its surface first"));
    }
    let v = loaded.verts.len();
    if let Some(i) = loaded.faces.iter().position(|f| f.iter().any(|&c| c as usize >= v)) {
        let [a, b, c] = loaded.faces[i];
        return Err(Error::new(
            ErrorKind::Format,
            format!("vertices {a}, {b}, {c} are named, but the file has {v} vertices (counted from 0)"),
        )
        .at_element(format!("triangle {i}"))
        .advise("the file is truncated or its indices are wrong; export it again"));
    }
    Ok(TriangleMesh { verts: loaded.verts, faces: loaded.faces })
}

/// Whether faces are of interest.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Want {
    Cloud,
    Mesh,
}

/// The names of a normal's components.
const NORMAL: [&str; 3] = ["nx", "ny", "nz"];

/// What a reader hands back: v x 3 finite positions, v x 3 normals or none (finite or not), f x 3 indices (not yet
/// checked against v), and notices.
#[derive(Default)]
struct Loaded {
    verts: Vec<[f32; 3]>,
    normals: Vec<[f32; 3]>,
    faces: Vec<[u32; 3]>,
    notices: Vec<String>,
}

fn read_cloud_path(path: &Path, format: Option<Format>) -> Result<PointCloud, Error> {
    let bytes = read_file(path)?;
    read_cloud_bytes(&bytes, format.or_else(|| Format::from_path(path))).map_err(|e| e.in_file(path))
}

fn read_mesh_path(path: &Path, format: Option<Format>) -> Result<TriangleMesh, Error> {
    let bytes = read_file(path)?;
    read_mesh_bytes(&bytes, format.or_else(|| Format::from_path(path))).map_err(|e| e.in_file(path))
}

fn read_file(path: &Path) -> Result<Vec<u8>, Error> {
    fs::read(path).map_err(|e| Error::new(ErrorKind::Io, "cannot read the file").in_file(path).caused_by(e))
}

fn choose(bytes: &[u8], format: Option<Format>) -> Result<Format, Error> {
    format.or_else(|| Format::from_content(bytes)).ok_or_else(|| {
        let what = if bytes.is_empty() { "the file is empty" } else { "the file format is unknown" };
        Error::new(ErrorKind::Format, what).advise(format!("supported are {}", Format::list()))
    })
}

fn load(bytes: &[u8], format: Format, want: Want) -> Result<Loaded, Error> {
    let holds_faces = matches!(format, Format::Ply | Format::Obj | Format::Stl);
    if want == Want::Mesh && !holds_faces {
        return Err(Error::new(ErrorKind::Format, format!("{format} files hold points without faces"))
            .advise("give a mesh as ply, obj or stl"));
    }
    if bytes.is_empty() {
        return Err(Error::new(ErrorKind::Format, "the file is empty").advise("check how it was written"));
    }
    match format {
        Format::Ply => ply::read(bytes, want),
        Format::Xyz | Format::Csv => xyz::read(bytes),
        Format::Obj => obj::read(bytes, want),
        Format::Stl => stl::read(bytes),
        Format::Npy => npy::read(bytes),
        Format::Kitti => kitti::read(bytes),
    }
}

/// Refuses NaN, infinities and what overflowed `f32`, before anything downstream can hide them.
fn check_point(point: [f32; 3], noun: &str, index: usize) -> Result<(), Error> {
    match point.iter().position(|x| !x.is_finite()) {
        None => Ok(()),
        Some(axis) => Err(Error::new(
            ErrorKind::Data,
            format!("{} is {}, not a finite 32-bit number", ["x", "y", "z"][axis], point[axis]),
        )
        .at_element(format!("{noun} {index}"))
        .advise("remove or repair it (elements are counted from 0)")),
    }
}

/// Cuts a polygon into triangles that share its first corner.
fn push_fan(faces: &mut Vec<[u32; 3]>, polygon: &[i64]) -> Result<(), Error> {
    if polygon.len() < 3 {
        return Err(Error::new(
            ErrorKind::Format,
            format!("at least 3 corners expected, {} found", polygon.len()),
        )
        .advise("remove the face or export the file again"));
    }
    let index = |i: i64| {
        u32::try_from(i).map_err(|_| {
            Error::new(ErrorKind::Format, format!("vertex {i} is named, which is not a possible index"))
                .advise("the file is damaged; export it again")
        })
    };
    let first = index(polygon[0])?;
    let mut previous = index(polygon[1])?;
    for &corner in &polygon[2..] {
        let next = index(corner)?;
        faces.push([first, previous, next]);
        previous = next;
    }
    Ok(())
}

/// A notice where the coordinates are so large against the cloud's size that 32-bit floats lose its detail, as with
/// map coordinates.
fn coarse_floats(points: &[[f32; 3]]) -> Option<String> {
    let (mut low, mut high) = ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]);
    for p in points {
        for axis in 0..3 {
            low[axis] = low[axis].min(p[axis]);
            high[axis] = high[axis].max(p[axis]);
        }
    }
    let widest = (0..3).map(|a| f64::from(high[a]) - f64::from(low[a])).fold(0.0, f64::max);
    let largest = (0..3).map(|a| f64::from(high[a].max(-low[a]))).fold(0.0, f64::max);
    let step = largest * f64::from(f32::EPSILON);
    (widest > 0.0 && step > 1e-4 * widest).then(|| {
        format!(
            "coordinates near {largest:.3e} are kept to steps of {step:.1e} only, and the cloud measures \
             {widest:.3e}; subtract a common offset from the file to keep its detail"
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const TETRAHEDRON: [[f32; 3]; 4] = [[0.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.25]];

    fn tetrahedron() -> TriangleMesh {
        TriangleMesh { verts: TETRAHEDRON.to_vec(), faces: vec![[0, 1, 2], [0, 2, 3], [2, 1, 3], [1, 0, 3]] }
    }

    fn mesh_bytes(mesh: &TriangleMesh, format: Format, encoding: Encoding) -> Vec<u8> {
        let mut out = Vec::new();
        write_mesh_to(&mut out, mesh, format, encoding).unwrap();
        out
    }

    fn cloud_bytes(points: &[[f32; 3]], format: Format, encoding: Encoding) -> Vec<u8> {
        let mut out = Vec::new();
        write_cloud_to(&mut out, points, format, encoding).unwrap();
        out
    }

    /// A small file of every format and encoding.
    fn samples() -> Vec<(Format, Vec<u8>)> {
        let mut files = Vec::new();
        for encoding in [Encoding::Binary, Encoding::Ascii] {
            for format in [Format::Ply, Format::Stl] {
                files.push((format, mesh_bytes(&tetrahedron(), format, encoding)));
            }
        }
        let mut big = Vec::new();
        let mesh = tetrahedron();
        ply::write(&mut big, &mesh.verts, Some(&mesh.faces), ply_rs::ply::Encoding::BinaryBigEndian).unwrap();
        files.push((Format::Ply, big));
        files.push((Format::Obj, mesh_bytes(&mesh, Format::Obj, Encoding::Ascii)));
        files.push((Format::Xyz, cloud_bytes(&TETRAHEDRON, Format::Xyz, Encoding::Ascii)));
        files.push((Format::Csv, cloud_bytes(&TETRAHEDRON, Format::Csv, Encoding::Ascii)));
        files.push((Format::Npy, npy::tests::write(&TETRAHEDRON)));
        let rows = TETRAHEDRON.iter().flat_map(|p| [p[0], p[1], p[2], 0.5]);
        files.push((Format::Kitti, rows.flat_map(f32::to_le_bytes).collect()));
        files
    }

    /// Whatever the bytes are, the answer is sound data or an error of one line that says where or what.
    fn answers(bytes: &[u8], format: Option<Format>) {
        let kinds = [ErrorKind::Format, ErrorKind::Data];
        match read_cloud_bytes(bytes, format) {
            Ok(cloud) => {
                assert!(!cloud.points.is_empty());
                assert!(cloud.points.as_flattened().iter().all(|x| x.is_finite()));
                assert!(
                    cloud.points.capacity() <= 4 * bytes.len() + 64,
                    "{} reserved",
                    cloud.points.capacity()
                );
                assert!(cloud.notices.iter().all(|n| !n.contains('\n')));
                if let Some(normals) = &cloud.normals {
                    assert!(normals.len() == cloud.points.len());
                    assert!(normals.as_flattened().iter().all(|x| x.is_finite()));
                }
            }
            Err(e) => assert!(kinds.contains(&e.kind()) && !e.to_string().contains('\n'), "{e}"),
        }
        match read_mesh_bytes(bytes, format) {
            Ok(mesh) => {
                assert!(mesh.verts.as_flattened().iter().all(|x| x.is_finite()));
                assert!(mesh.faces.as_flattened().iter().all(|&i| (i as usize) < mesh.verts.len()));
            }
            Err(e) => assert!(kinds.contains(&e.kind()) && !e.to_string().contains('\n'), "{e}"),
        }
    }

    #[test]
    fn samples_are_read_by_name_and_by_content() {
        for (format, bytes) in samples() {
            let cloud = read_cloud_bytes(&bytes, Some(format)).unwrap_or_else(|e| panic!("{format}: {e}"));
            assert_eq!(cloud.points, TETRAHEDRON, "{format}");
            if format != Format::Kitti {
                assert_eq!(read_cloud_bytes(&bytes, None).unwrap(), cloud, "{format}");
            }
            match read_mesh_bytes(&bytes, Some(format)) {
                Ok(mesh) => assert_eq!(mesh, tetrahedron(), "{format}"),
                Err(e) => assert!(e.to_string().contains("points without faces"), "{format}: {e}"),
            }
        }
    }

    #[test]
    fn every_truncation_is_answered() {
        for (format, bytes) in samples() {
            for end in 0..bytes.len() {
                answers(&bytes[..end], Some(format));
                answers(&bytes[..end], None);
            }
        }
    }

    #[test]
    fn a_binary_truncation_is_never_taken_for_the_whole() {
        for (format, bytes) in samples().into_iter().filter(|(f, _)| matches!(f, Format::Npy | Format::Kitti))
        {
            for end in 0..bytes.len() {
                let whole = read_cloud_bytes(&bytes[..end], Some(format)).is_ok_and(|c| c.points.len() == 4);
                assert!(!whole, "{format} at {end}");
            }
        }
        for format in [Format::Ply, Format::Stl] {
            let bytes = mesh_bytes(&tetrahedron(), format, Encoding::Binary);
            for end in 0..bytes.len() {
                assert!(read_mesh_bytes(&bytes[..end], Some(format)).is_err(), "{format} at {end}");
                // The points of a PLY mesh are whole once its vertices are.
                let cloud = read_cloud_bytes(&bytes[..end], Some(format));
                assert!(cloud.is_err() || (format == Format::Ply && cloud.unwrap().points == TETRAHEDRON));
            }
        }
    }

    #[test]
    fn every_flipped_byte_is_answered() {
        for (format, bytes) in samples() {
            for at in 0..bytes.len() {
                for flip in [0x01, 0x02, 0x10, 0x20, 0x80, 0xff] {
                    let mut damaged = bytes.clone();
                    damaged[at] ^= flip;
                    answers(&damaged, Some(format));
                }
            }
        }
    }

    #[test]
    fn paths_choose_formats_and_errors_name_the_file() {
        let dir = std::env::temp_dir().join(format!("bijective-sdf-io-{}", std::process::id()));
        fs::create_dir_all(&dir).unwrap();
        for name in ["a.ply", "a.OBJ", "a.stl"] {
            write_mesh(dir.join(name), &tetrahedron()).unwrap();
            assert_eq!(read_mesh(dir.join(name)).unwrap(), tetrahedron());
            assert_eq!(read_cloud(dir.join(name)).unwrap().points, TETRAHEDRON);
        }
        for name in ["b.ply", "b.xyz", "b.csv", "b.pts"] {
            write_cloud(dir.join(name), &TETRAHEDRON).unwrap();
            assert_eq!(read_cloud(dir.join(name)).unwrap().points, TETRAHEDRON);
        }
        write_cloud_as(dir.join("c"), &TETRAHEDRON, Format::Ply, Encoding::Ascii).unwrap();
        assert_eq!(read_cloud(dir.join("c")).unwrap().points, TETRAHEDRON);
        write_mesh_as(dir.join("c.bin"), &tetrahedron(), Format::Ply, Encoding::Ascii).unwrap();
        assert_eq!(read_mesh_as(dir.join("c.bin"), Format::Ply).unwrap(), tetrahedron());
        assert!(read_cloud_as(dir.join("c"), Format::Npy).is_err());

        fs::write(dir.join("d.xyz"), "1 2 3\n4 5\n").unwrap();
        let e = read_cloud(dir.join("d.xyz")).unwrap_err();
        assert_eq!((e.file(), e.line()), (Some(dir.join("d.xyz").as_path()), Some(2)));
        assert!(
            e.to_string()
                .ends_with("d.xyz:2: point 1: 3 numbers expected, 2 found; complete the line or delete it")
        );
        let cases: [(&str, &[u8], ErrorKind, &str); 6] = [
            ("e.las", b"LASF\x00", ErrorKind::Format, "format is unknown; supported are ply (.ply), xyz"),
            ("e", b"", ErrorKind::Format, "the file is empty"),
            ("e.npy", b"", ErrorKind::Format, "the file is empty"),
            ("e.csv", b"x,y,z\n", ErrorKind::Data, "no points"),
            ("e.obj", b"# nothing\n", ErrorKind::Data, "no points"),
            ("e.ply", b"solid\n", ErrorKind::Format, "does not begin with the line \"ply\""),
        ];
        for (name, bytes, kind, message) in cases {
            fs::write(dir.join(name), bytes).unwrap();
            let e = read_cloud(dir.join(name)).unwrap_err();
            assert_eq!((e.kind(), e.file()), (kind, Some(dir.join(name).as_path())), "{e}");
            assert!(e.to_string().contains(message), "{e}");
        }
        let e = read_cloud(dir.join("none.ply")).unwrap_err();
        assert_eq!(e.kind(), ErrorKind::Io);
        let e = read_mesh(dir.join("b.csv")).unwrap_err();
        assert!(e.to_string().contains("csv files hold points without faces"), "{e}");
        fs::remove_dir_all(&dir).unwrap();
    }

    #[test]
    fn meshes_need_faces_with_vertices_that_exist() {
        let e = read_mesh_bytes(b"v 0 0 0\n", Some(Format::Obj)).unwrap_err();
        assert!(e.to_string().contains("there are no faces; give a triangle mesh"), "{e}");
        let text = String::from_utf8(mesh_bytes(&tetrahedron(), Format::Ply, Encoding::Ascii)).unwrap();
        let e = read_mesh_bytes(text.replace("3 2 1 3", "3 2 1 4").as_bytes(), None).unwrap_err();
        assert!(
            e.to_string().starts_with("triangle 2: vertices 2, 1, 4 are named, but the file has 4"),
            "{e}"
        );
    }

    #[test]
    fn odd_normals_are_left_out_with_a_notice() {
        let read = |z: &str| {
            let text = format!("x,y,z,nx,ny,nz\n0,0,0,0,0,1\n1,0,0,0,0,{z}\n");
            read_cloud_bytes(text.as_bytes(), Some(Format::Csv)).unwrap()
        };
        assert_eq!(read("-2").normals, Some(vec![[0.0, 0.0, 1.0], [0.0, 0.0, -2.0]]));
        for odd in ["nan", "", "word"] {
            let cloud = read(odd);
            assert!(cloud.normals.is_none() && cloud.points.len() == 2);
            assert!(cloud.notices[0].contains("that of point 1"), "{:?}", cloud.notices);
        }
    }

    #[test]
    fn map_coordinates_are_noticed() {
        let near: Vec<[f32; 3]> = TETRAHEDRON.to_vec();
        let far: Vec<[f32; 3]> = near.iter().map(|p| p.map(|x| x + 4e5)).collect();
        let notices = |p: &[[f32; 3]]| {
            read_cloud_bytes(&cloud_bytes(p, Format::Ply, Encoding::Binary), None).unwrap().notices
        };
        assert!(notices(&near).is_empty());
        assert!(notices(&far)[0].contains("subtract a common offset"), "{:?}", notices(&far));
    }

    fn finite() -> impl Strategy<Value = f32> {
        prop_oneof![
            -10.0_f32..10.0,
            any::<u32>().prop_map(f32::from_bits).prop_filter("finite", |x| x.is_finite())
        ]
    }

    fn bits(points: &[[f32; 3]]) -> Vec<[u32; 3]> {
        points.iter().map(|p| p.map(f32::to_bits)).collect()
    }

    /// The corners of every triangle, with -0 as 0.
    fn corners(mesh: &TriangleMesh) -> Vec<[u32; 3]> {
        mesh.faces
            .as_flattened()
            .iter()
            .map(|&i| mesh.verts[i as usize].map(|x| (x + 0.0).to_bits()))
            .collect()
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]

        #[test]
        fn clouds_come_back_to_the_bit(points in prop::collection::vec(prop::array::uniform3(finite()), 1..12)) {
            for format in [Format::Ply, Format::Xyz, Format::Csv] {
                for encoding in [Encoding::Binary, Encoding::Ascii] {
                    let cloud = read_cloud_bytes(&cloud_bytes(&points, format, encoding), Some(format)).unwrap();
                    prop_assert_eq!(bits(&cloud.points), bits(&points), "{}", format);
                }
            }
            let cloud = read_cloud_bytes(&npy::tests::write(&points), None).unwrap();
            prop_assert_eq!(bits(&cloud.points), bits(&points));
        }

        #[test]
        fn meshes_come_back_to_the_bit(
            verts in prop::collection::vec(prop::array::uniform3(finite()), 1..12),
            picks in prop::collection::vec(prop::array::uniform3(0_u32..1000), 1..12),
        ) {
            let faces = picks.iter().map(|f| f.map(|i| i % verts.len() as u32)).collect();
            let mesh = TriangleMesh { verts, faces };
            for encoding in [Encoding::Binary, Encoding::Ascii] {
                for format in [Format::Ply, Format::Obj] {
                    let back = read_mesh_bytes(&mesh_bytes(&mesh, format, encoding), Some(format)).unwrap();
                    prop_assert_eq!(bits(&back.verts), bits(&mesh.verts), "{}", format);
                    prop_assert_eq!(&back.faces, &mesh.faces, "{}", format);
                }
                let back = read_mesh_bytes(&mesh_bytes(&mesh, Format::Stl, encoding), Some(Format::Stl)).unwrap();
                prop_assert_eq!(corners(&back), corners(&mesh));
            }
        }

        #[test]
        fn any_bytes_are_answered(bytes in prop::collection::vec(any::<u8>(), 0..200), which in 0..8_usize) {
            answers(&bytes, Format::ALL.get(which).copied());
        }
    }
}
