//! What must hold for any bytes: sound data or a typed error, and what was read can be written and read again.
#![allow(dead_code)]

use bijective_sdf::io::{
    Encoding, Format, ReadOptions, read_cloud_with, read_mesh_bytes, write_cloud_to, write_mesh_to,
};
use bijective_sdf::{Error, ErrorKind, geometry};

/// Reads the bytes as a cloud.
pub fn cloud(bytes: &[u8], format: Option<Format>) {
    let mut options = ReadOptions::default();
    options.format = format;
    cloud_with(bytes, &options);
    // What was doubted is read, too.
    options.assume = true;
    cloud_with(bytes, &options);
    // And what stands beside the coordinates.
    options.assume = false;
    options.attributes = true;
    cloud_with(bytes, &options);
}

/// Reads the bytes as a cloud, as the options say.
pub fn cloud_with(bytes: &[u8], options: &ReadOptions) {
    let cloud = match read_cloud_with(bytes, options) {
        Ok(cloud) => cloud,
        Err(e) => return check_error(&e),
    };
    assert!(!cloud.points.is_empty() && cloud.warnings.iter().all(|w| !w.contains('\n')));
    assert!(cloud.points.as_flattened().iter().all(|x| x.is_finite()));
    assert!(cloud.attributes.iter().all(|a| a.values.len() == cloud.points.len()));
    assert!(cloud.normals.iter().all(|n| n.len() == cloud.points.len()));
    assert!(cloud.viewpoints.as_flattened().iter().all(|x| x.is_finite()));
    if let Err(e) = geometry::clean_cloud(&cloud.points) {
        check_error(&e);
    }
    for (format, encoding) in [
        (Format::Ply, Encoding::Binary),
        (Format::Ply, Encoding::Ascii),
        (Format::Xyz, Encoding::Ascii),
        (Format::Csv, Encoding::Ascii),
    ] {
        let mut out = Vec::new();
        write_cloud_to(&mut out, &cloud.points, format, encoding).expect("what was read can be written");
        // Every row, whatever it looks like: random numbers may look like fillers.
        let mut options = ReadOptions::default();
        options.format = Some(format);
        (options.assume, options.every_row) = (true, true);
        let again = read_cloud_with(&out, &options).expect("what was written can be read");
        assert_same(&again.points, &cloud.points);
    }
}

/// Reads the bytes as a mesh.
pub fn mesh(bytes: &[u8], format: Option<Format>) {
    let mesh = match read_mesh_bytes(bytes, format) {
        Ok(mesh) => mesh,
        Err(e) => return check_error(&e),
    };
    assert!(mesh.verts.as_flattened().iter().all(|x| x.is_finite()));
    assert!(mesh.faces.as_flattened().iter().all(|&i| (i as usize) < mesh.verts.len()));
    for (format, encoding) in [
        (Format::Ply, Encoding::Binary),
        (Format::Ply, Encoding::Ascii),
        (Format::Obj, Encoding::Ascii),
        (Format::Stl, Encoding::Binary),
        (Format::Stl, Encoding::Ascii),
    ] {
        let mut out = Vec::new();
        write_mesh_to(&mut out, &mesh, format, encoding).expect("what was read can be written");
        let again = read_mesh_bytes(&out, Some(format)).expect("what was written can be read");
        assert_eq!(again.faces.len(), mesh.faces.len());
        if format != Format::Stl {
            // Of 32 bits where these do.
            assert_eq!(bits(&again.verts), bits(&mesh.verts));
            assert_eq!(again.faces, mesh.faces);
        }
    }
}

fn check_error(e: &Error) {
    assert!(matches!(e.kind(), ErrorKind::Format | ErrorKind::Data), "{e}");
    assert!(!e.to_string().contains('\n'), "{e}");
}

/// To the bit; of numbers of 32 bits in those, as texts have the shortest digits of them.
fn assert_same(again: &[[f64; 3]], written: &[[f64; 3]]) {
    if geometry::are_f32(written) {
        assert_eq!(bits(again), bits(written));
    } else {
        let wide = |points: &[[f64; 3]]| points.iter().map(|p| p.map(f64::to_bits)).collect::<Vec<_>>();
        assert_eq!(wide(again), wide(written));
    }
}

fn bits(points: &[[f64; 3]]) -> Vec<[u32; 3]> {
    points.iter().map(|p| p.map(|x| (x as f32).to_bits())).collect()
}
