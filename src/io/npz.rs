//! NPZ, an archive of NumPy arrays: the one that holds points is read.

use super::options::ReadOptions;
use super::{Loaded, MAX_ATTRIBUTES, Want, npy, zip};
use crate::{Error, ErrorKind};

/// Names that arrays of points go by, the likeliest first.
const NAMES: [&str; 16] = [
    "points",
    "xyz",
    "pos",
    "positions",
    "coords",
    "coord",
    "pc",
    "pcl",
    "cloud",
    "pointcloud",
    "point_cloud",
    "vertices",
    "verts",
    "pts",
    "data",
    "arr_0",
];

/// Those of the names that do not say what is in the array.
const GENERAL: [&str; 2] = ["data", "arr_0"];

/// Names of arrays of three columns that hold no points.
const OTHERS: [&str; 13] = [
    "normals",
    "normal",
    "rgb",
    "color",
    "colors",
    "colour",
    "colours",
    "faces",
    "face",
    "triangles",
    "tris",
    "cells",
    "indices",
];

/// Whether an array beside the chosen one may hold the points as well: n x 3 numbers under a name that does not say
/// what they are. Whole numbers beside floats are triangles or colours.
fn has_rival(name: &str, chosen: &[u8], arrays: &[(&str, &zip::Entry<'_>)]) -> bool {
    let Some(floats) = npy::floats_of_points(chosen) else { return false };
    let silent = |other: &str| other != name && !OTHERS.iter().any(|n| other.eq_ignore_ascii_case(n));
    // An array that cannot be unpacked is nobody's rival.
    let alike = |entry: &zip::Entry<'_>| {
        let own = entry.bytes().ok().and_then(|bytes| npy::floats_of_points(&bytes));
        own.is_some_and(|own| own || !floats)
    };
    arrays.iter().any(|(other, entry)| silent(other) && alike(entry))
}

/// Reads n x 3 points and, if there is an array of them, their normals.
pub(super) fn read(bytes: &[u8], options: &ReadOptions, want: Want) -> Result<Loaded, Error> {
    let entries = zip::entries(bytes)?;
    let arrays: Vec<(&str, &zip::Entry<'_>)> =
        entries.iter().filter_map(|e| Some((e.name.strip_suffix(".npy")?, e))).collect();
    if arrays.is_empty() {
        return Err(zip::what(&entries));
    }
    let known = |name: &str| arrays.iter().find(|(n, _)| n.eq_ignore_ascii_case(name));
    let uncertain = |advice: &str| {
        let names: Vec<&str> = arrays.iter().take(8).map(|(n, _)| *n).collect();
        Error::new(
            ErrorKind::Format,
            format!("it is not certain which array holds the points: {}", names.join(", ")),
        )
        .advise(advice)
    };
    let alone = "save the one of the points alone, with numpy.save(path, points)";
    let (name, entry) = match arrays[..] {
        [one] => one,
        _ => *NAMES.iter().find_map(|n| known(n)).ok_or_else(|| uncertain(alone))?,
    };
    let array = entry.bytes()?;
    if GENERAL.iter().any(|n| name.eq_ignore_ascii_case(n))
        && !options.assume
        && has_rival(name, &array, &arrays)
    {
        return Err(uncertain(&format!("{alone}, or give --assume if they are in {name}")));
    }
    let mut loaded = npy::read(&array, options, want).map_err(|e| e.at_element(format!("array {name}")))?;
    drop(array);
    if arrays.len() > 1 {
        loaded.notices.push(format!("read the array {name} of {}", arrays.len()));
    }
    if let Some((_, entry)) = known("normals").filter(|(n, _)| *n != name)
        && want != Want::Mesh
        && let Ok(normals) =
            npy::read(&entry.bytes()?, &ReadOptions { assume: true, ..ReadOptions::default() }, want)
        && normals.verts.len() == loaded.verts.len()
    {
        loaded.normals = normals.verts.iter().map(|n| n.map(|x| x as f32)).collect();
    }
    if want == Want::Attributes {
        for (other, entry) in &arrays {
            let points = loaded.verts.len();
            if *other == name || other.eq_ignore_ascii_case("normals") {
                continue;
            }
            // Arrays of anything but one row a point say nothing about the points.
            let columns = entry.bytes().and_then(|bytes| npy::columns(&bytes, other)).unwrap_or_default();
            let room = MAX_ATTRIBUTES.saturating_sub(loaded.attributes.len());
            loaded.attributes.extend(columns.into_iter().filter(|c| c.values.len() == points).take(room));
        }
    }
    if known("occupancies").is_some() || known("sdf").is_some() {
        loaded.warnings.push(
            "the archive has values inside and outside: its points may fill a volume instead of lying on a surface"
                .into(),
        );
    }
    Ok(loaded)
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    /// An archive of files, not packed.
    pub fn archive(files: &[(&str, Vec<u8>)]) -> Vec<u8> {
        let (mut out, mut directory) = (Vec::new(), Vec::new());
        for (name, bytes) in files {
            let sizes =
                [&[0; 4][..], &(bytes.len() as u32).to_le_bytes(), &(bytes.len() as u32).to_le_bytes()];
            let sizes = [sizes.concat(), (name.len() as u16).to_le_bytes().to_vec(), vec![0; 2]].concat();
            let local = (out.len() as u32).to_le_bytes();
            out.extend([&b"PK\x03\x04\x14\0\0\0\0\0\0\0\0\0"[..], &sizes, name.as_bytes(), bytes].concat());
            let head = [&b"PK\x01\x02\x14\0\x14\0\0\0\0\0\0\0\0\0"[..], &sizes, &[0; 10], &local].concat();
            directory.extend([&head[..], name.as_bytes()].concat());
        }
        let (count, at) = ((files.len() as u16).to_le_bytes(), (out.len() as u32).to_le_bytes());
        let size = (directory.len() as u32).to_le_bytes();
        out.extend(directory);
        out.extend([&b"PK\x05\x06\0\0\0\0"[..], &count, &count, &size, &at, &[0; 2]].concat());
        out
    }

    fn plain(bytes: &[u8]) -> Result<Loaded, Error> {
        read(bytes, &ReadOptions::default(), Want::Cloud)
    }

    #[test]
    fn the_array_of_points_is_read() {
        let points = npy::tests::write(&[[1.0, 2.0, 3.0], [4.0, 5.0, 6.5]]);
        let normals = npy::tests::write(&[[0.0, 0.0, 1.0], [0.0, 1.0, 0.0]]);
        let one = plain(&archive(&[("anything.npy", points.clone())])).unwrap();
        assert_eq!((one.verts, one.notices.len()), (vec![[1.0, 2.0, 3.0], [4.0, 5.0, 6.5]], 0));
        let loaded =
            plain(&archive(&[("normals.npy", normals.clone()), ("points.npy", points.clone())])).unwrap();
        assert_eq!((loaded.verts[1], loaded.normals[1]), ([4.0, 5.0, 6.5], [0.0, 1.0, 0.0]));
        assert_eq!(loaded.notices, ["read the array points of 2"]);
        let e = plain(&archive(&[("pos.a.npy", points.clone()), ("neg.npy", normals)])).map(|l| l.verts);
        assert!(e.unwrap_err().to_string().contains("which array holds the points: pos.a, neg"));
        let filled = plain(&archive(&[("points.npy", points), ("occupancies.npy", vec![])])).unwrap();
        assert!(filled.warnings[0].contains("fill a volume"));
        for (name, what) in [("xl/workbook.xml", "Excel"), ("doc.kml", "KMZ"), ("a.txt", "a zip archive")] {
            let e = plain(&archive(&[(name, vec![1])])).map(|l| l.verts).unwrap_err().to_string();
            assert!(e.contains(what), "{e}");
        }
    }

    #[test]
    fn arrays_without_telling_names_are_not_chosen_from() {
        let points = npy::tests::write(&[[1.0, 2.0, 3.0], [4.0, 5.0, 6.5]]);
        let whole = npy::tests::file(
            1,
            "{'descr': '<i2', 'fortran_order': False, 'shape': (1, 3), }",
            &[0, 0, 1, 0, 1, 0],
        );
        let flat = npy::tests::file(1, "{'descr': '|u1', 'fortran_order': False, 'shape': (2,), }", &[0, 9]);
        let of = |first: (&str, &Vec<u8>), second: (&str, &Vec<u8>), options: &ReadOptions| {
            let files = [first, second].map(|(name, bytes)| (format!("{name}.npy"), bytes.clone()));
            let files = files.each_ref().map(|(name, bytes)| (name.as_str(), bytes.clone()));
            read(&archive(&files), options, Want::Cloud).map(|l| l.verts.len())
        };
        let default = ReadOptions::default();
        let assume = ReadOptions { assume: true, ..Default::default() };
        for (first, second) in [
            (("arr_0", &points), ("arr_1", &points)),
            (("arr_1", &points), ("arr_0", &points)),
            (("data", &points), ("target", &points)),
            (("arr_0", &whole), ("arr_1", &points)),
            (("arr_0", &whole), ("arr_1", &whole)),
        ] {
            let e = of(first, second, &default).unwrap_err().to_string();
            assert!(e.contains(&format!("which array holds the points: {}, {}", first.0, second.0)), "{e}");
            assert!(e.contains("--assume"), "{e}");
            assert!(of(first, second, &assume).is_ok());
        }
        for (first, second) in [
            (("arr_0", &points), ("normals", &points)),
            (("arr_0", &points), ("Colors", &points)),
            (("arr_0", &points), ("arr_1", &whole)),
            (("arr_0", &points), ("arr_1", &flat)),
            (("points", &points), ("arr_0", &points)),
            (("vertices", &points), ("other", &points)),
        ] {
            assert_eq!(of(first, second, &default).unwrap(), 2, "{first:?} {second:?}");
        }
    }

    #[test]
    fn arrays_with_a_row_for_each_point_are_attributes() {
        let points = npy::tests::write(&[[1.0, 2.0, 3.0], [4.0, 5.0, 6.5]]);
        let colours = npy::tests::write(&[[0.5, 0.25, 1.0], [0.0, 1.0, 0.75]]);
        let bytes = |descr: &str, shape: &str, data: &[u8]| {
            let header = format!("{{'descr': '{descr}', 'fortran_order': False, 'shape': {shape}, }}");
            npy::tests::file(1, &header, data)
        };
        let files = archive(&[
            ("xyz.npy", points),
            ("colors.npy", colours),
            ("label.npy", bytes("|u1", "(2,)", &[7, 9])),
            ("flow.npy", bytes("<i2", "(2, 2)", &[1, 0, 2, 0, 255, 255, 4, 0])),
            ("other.npy", bytes("|u1", "(3,)", &[1, 2, 3])),
            ("scale.npy", bytes("|u1", "()", &[1])),
            ("note.npy", vec![1, 2, 3]),
        ]);
        let loaded = read(&files, &ReadOptions::default(), Want::Attributes).unwrap();
        let found: Vec<(&str, &[f64])> =
            loaded.attributes.iter().map(|a| (a.name.as_str(), &a.values[..])).collect();
        let want: [(&str, &[f64]); 6] = [
            ("red", &[0.5, 0.0]),
            ("green", &[0.25, 1.0]),
            ("blue", &[1.0, 0.75]),
            ("label", &[7.0, 9.0]),
            ("flow_1", &[1.0, -1.0]),
            ("flow_2", &[2.0, 4.0]),
        ];
        assert_eq!(found, want);
        assert!(plain(&files).unwrap().attributes.is_empty());
    }

    #[test]
    fn every_truncation_is_refused() {
        let bytes = archive(&[("points.npy", npy::tests::write(&[[1.0, 2.0, 3.0]; 4]))]);
        for end in 0..bytes.len() {
            assert!(plain(&bytes[..end]).is_err(), "{end}");
        }
    }
}
