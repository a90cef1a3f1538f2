//! What holds for every format: round trips, damage, the choice of the format.

use super::*;
use crate::geometry::relative_to;
use proptest::prelude::*;

const TETRAHEDRON: [[f32; 3]; 4] = [[0.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.25]];
/// The same in 64 bits.
const WIDE: [[f64; 3]; 4] = [[0.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.25]];

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
    let encoding = ply_rs::ply::Encoding::BinaryBigEndian;
    ply::write_encoded(&mut big, &WIDE, encoding::Width::Single, &[], Some(&mesh.faces), encoding).unwrap();
    files.push((Format::Ply, big));
    files.push((Format::Obj, mesh_bytes(&mesh, Format::Obj, Encoding::Ascii)));
    files.push((Format::Xyz, cloud_bytes(&TETRAHEDRON, Format::Xyz, Encoding::Ascii)));
    files.push((Format::Csv, cloud_bytes(&TETRAHEDRON, Format::Csv, Encoding::Ascii)));
    files.push((Format::Npy, npy::tests::write(&TETRAHEDRON)));
    let rows = TETRAHEDRON.iter().flat_map(|p| [p[0], p[1], p[2], 0.5]);
    files.push((Format::Npz, npz::tests::archive(&[("points.npy", npy::tests::write(&TETRAHEDRON))])));
    let text = |separator: &str| {
        let rows: Vec<String> = TETRAHEDRON.iter().map(|p| format!("{} {} {}", p[0], p[1], p[2])).collect();
        rows.join(separator) + "\n"
    };
    let faces = mesh.faces.iter().map(|f| format!("3 {} {} {}\n", f[0], f[1], f[2])).collect::<String>();
    files.push((Format::Off, format!("OFF\n4 4 0\n{}{faces}", text("\n")).into_bytes()));
    let pcd = "FIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nWIDTH 4\nDATA ascii\n";
    files.push((Format::Pcd, format!("{pcd}{}", text("\n")).into_bytes()));
    let binary: Vec<u8> = TETRAHEDRON.as_flattened().iter().flat_map(|x| x.to_le_bytes()).collect();
    files.push((Format::Pcd, [pcd.replace("ascii", "binary").as_bytes(), &binary].concat()));
    let vtk = "# vtk DataFile Version 3.0\n\nASCII\nDATASET POLYDATA\nPOINTS 4 float\n";
    files.push((Format::Vtk, format!("{vtk}{}", text(" ")).into_bytes()));
    let swapped: Vec<u8> = TETRAHEDRON.as_flattened().iter().flat_map(|x| x.to_be_bytes()).collect();
    files.push((Format::Vtk, [vtk.replace("ASCII", "BINARY").as_bytes(), &swapped].concat()));
    let mut las = las::tests::header(2, 0, &[], 4);
    las[155..179].fill(0);
    let steps = |p: &[f32; 3]| [&p.map(|x| ((x / 0.25) as i32).to_le_bytes()).concat()[..], &[0; 8]].concat();
    las.extend(TETRAHEDRON.iter().flat_map(steps));
    files.push((Format::Las, las));
    // The origin is no place for a scan, so a place is moved there.
    let pose = "0 0 0\n1 0 0\n0 1 0\n0 0 1\n1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 -1 1\n";
    let moved = |p: &[f32; 3]| format!("{} {} {} 0.5\n", p[0], p[1], p[2] + 1.0);
    let moved: String = TETRAHEDRON.iter().map(moved).collect();
    files.push((Format::Ptx, format!("2\n2\n{pose}{moved}").into_bytes()));
    files.push((Format::Raw, rows.flat_map(f32::to_le_bytes).collect()));
    files
}

/// Whatever the bytes are, the answer is sound data or an error of one line that says where or what.
fn answers(bytes: &[u8], format: Option<Format>) {
    let kinds = [ErrorKind::Format, ErrorKind::Data];
    match read_cloud_bytes(bytes, format) {
        Ok(cloud) => {
            assert!(!cloud.points.is_empty());
            assert!(cloud.points.as_flattened().iter().all(|x| x.is_finite()));
            assert!(cloud.points.capacity() <= 4 * bytes.len() + 64, "{} reserved", cloud.points.capacity());
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
        assert_eq!(cloud.points, WIDE, "{format}");
        if format != Format::Raw {
            assert_eq!(read_cloud_bytes(&bytes, None).unwrap(), cloud, "{format}");
        }
        match read_mesh_bytes(&bytes, Some(format)) {
            Ok(mesh) => assert_eq!(mesh, tetrahedron().wide(), "{format}"),
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
    for (format, bytes) in samples()
        .into_iter()
        .filter(|(f, _)| matches!(f, Format::Npy | Format::Npz | Format::Las | Format::Raw))
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
            assert!(cloud.is_err() || (format == Format::Ply && cloud.unwrap().points == WIDE));
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
        assert_eq!(read_mesh(dir.join(name)).unwrap(), tetrahedron().wide());
        assert_eq!(read_cloud(dir.join(name)).unwrap().points, WIDE);
    }
    for name in ["b.ply", "b.xyz", "b.csv", "b.pts"] {
        write_cloud(dir.join(name), &TETRAHEDRON).unwrap();
        assert_eq!(read_cloud(dir.join(name)).unwrap().points, WIDE);
    }
    // The content counts where the name means nothing, or another format.
    for name in ["c", "c.bin"] {
        fs::write(dir.join(name), mesh_bytes(&tetrahedron(), Format::Ply, Encoding::Ascii)).unwrap();
        assert_eq!(read_cloud(dir.join(name)).unwrap().points, WIDE);
        assert_eq!(read_mesh(dir.join(name)).unwrap(), tetrahedron().wide());
    }
    assert!(read_cloud_bytes(&fs::read(dir.join("c")).unwrap(), Some(Format::Npy)).is_err());

    fs::write(dir.join("d.xyz"), "1 2 3\n4 5\n").unwrap();
    let e = read_cloud(dir.join("d.xyz")).unwrap_err();
    assert_eq!((e.file(), e.line()), (Some(dir.join("d.xyz").as_path()), Some(2)));
    assert!(
        e.to_string()
            .ends_with("d.xyz:2: point 1: 3 numbers expected, 2 found; complete the line or delete it")
    );
    let cases: [(&str, &[u8], ErrorKind, &str); 6] = [
        ("e.dat", b"\x00\x01\x02", ErrorKind::Format, "format is unknown; supported are ply (.ply), xyz"),
        ("e", b"", ErrorKind::Format, "the file is empty"),
        ("e.npy", b"", ErrorKind::Format, "the file is empty"),
        ("e.csv", b"x,y,z\n", ErrorKind::Data, "no points"),
        ("e.obj", b"# nothing\n", ErrorKind::Data, "no points"),
        ("e.ply", b"plywood\n", ErrorKind::Format, "does not begin with the line \"ply\""),
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
    assert!(e.to_string().starts_with("triangle 2: vertices 2, 1, 4 are named, but the file has 4"), "{e}");
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
        read_cloud_bytes(&cloud_bytes(p, Format::Ply, Encoding::Binary), None).unwrap().warnings
    };
    assert!(notices(&near).is_empty());
    assert!(notices(&far)[0].contains("export them in 64 bits"), "{:?}", notices(&far));
    // With more digits than 32 bits have, nothing is lost.
    let text = "400000.123 0 0.5\n400001 0.25 0\n400000 1 0\n400000.5 0 1\n";
    assert!(read_cloud_bytes(text.as_bytes(), Some(Format::Xyz)).unwrap().warnings.is_empty());
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
    mesh.faces.as_flattened().iter().map(|&i| mesh.verts[i as usize].map(|x| (x + 0.0).to_bits())).collect()
}

#[test]
fn digits_of_32_bits_mean_those_numbers_and_others_keep_64() {
    let read = |text: &str| read_cloud_bytes(text.as_bytes(), Some(Format::Xyz)).unwrap().points;
    let floats = [[0.1f32, -2.7, 1e-7], [0.33333334, 5.0, 1234.567], [0.25, 1.0, -0.1], [7.5, -3.1, 0.7]];
    let text =
        |points: &[[f32; 3]]| String::from_utf8(cloud_bytes(points, Format::Xyz, Encoding::Ascii)).unwrap();
    assert_eq!(read(&text(&floats)), floats.map(|p| p.map(f64::from)));
    // One number with more digits, and all are taken as they stand.
    let finer = text(&floats) + "0.123456789012 1 2\n";
    assert_eq!((read(&finer)[0][0], read(&finer)[4][0]), (0.1, 0.123456789012));
    // Map coordinates with a decimal would fit 32 bits by their digits, but not by their detail.
    assert_eq!(read("450123.4 0.5 1\n450124.1 1.5 2\n450120.3 3.5 3\n450119.9 1 1\n")[0][0], 450_123.4);
    // What a PLY file declares counts, whatever its digits.
    let ply = |number: &str| {
        let head =
            format!("ply\nformat ascii 1.0\nelement vertex 1\nproperty {number} x\nproperty {number} y\n");
        let text = format!("{head}property {number} z\nend_header\n0.123456789012 1 2\n");
        read_cloud_bytes(text.as_bytes(), None).unwrap().points[0][0]
    };
    assert_eq!((ply("double"), ply("float")), (0.123456789012, f64::from(0.123_456_79_f32)));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn clouds_come_back_to_the_bit(points in prop::collection::vec(prop::array::uniform3(finite()), 1..12)) {
        // Random numbers may look like anything.
        let options = |format| ReadOptions { format, assume: true, every_row: true, ..Default::default() };
        for format in [Format::Ply, Format::Xyz, Format::Csv] {
            for encoding in [Encoding::Binary, Encoding::Ascii] {
                let cloud = read_cloud_with(&cloud_bytes(&points, format, encoding), &options(Some(format))).unwrap();
                prop_assert_eq!(bits(&relative_to(&cloud.points, [0.0; 3])), bits(&points), "{}", format);
            }
        }
        let cloud = read_cloud_with(&npy::tests::write(&points), &options(None)).unwrap();
        prop_assert_eq!(bits(&relative_to(&cloud.points, [0.0; 3])), bits(&points));
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
                prop_assert_eq!(bits(&back.relative_to([0.0; 3]).verts), bits(&mesh.verts), "{}", format);
                prop_assert_eq!(&back.faces, &mesh.faces, "{}", format);
            }
            let back = read_mesh_bytes(&mesh_bytes(&mesh, Format::Stl, encoding), Some(Format::Stl)).unwrap();
            prop_assert_eq!(corners(&back.relative_to([0.0; 3])), corners(&mesh));
        }
    }

    #[test]
    fn any_bytes_are_answered(bytes in prop::collection::vec(any::<u8>(), 0..200), which in 0..8_usize) {
        answers(&bytes, Format::ALL.get(which).copied());
    }
}
