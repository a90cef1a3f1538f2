//! E57, scans of terrestrial lasers, read by the crate `e57`: all scans, each moved to its place.

use super::{Loaded, Want};
use crate::Error;
use crate::ErrorKind;
#[cfg(feature = "formats")]
use crate::geometry::{Attribute, COLOUR, Number};

/// Whether the bytes begin like an E57 file.
pub(super) fn looks_like_e57(bytes: &[u8]) -> bool {
    bytes.starts_with(b"ASTM-E57")
}

/// Reads the points of all scans in their common frame; places from where nothing came back are left out.
#[cfg(feature = "formats")]
pub(super) fn read(bytes: &[u8], want: Want) -> Result<Loaded, Error> {
    use std::panic::{AssertUnwindSafe, catch_unwind};
    // Damage that its checks do not see may break the decoder; that is no reason for the program to end.
    catch_unwind(AssertUnwindSafe(|| scans(bytes, want)))
        .unwrap_or_else(|_| Err(damaged("the decoder gave up")))
}

/// Without the feature `formats`: the error that says how to convert the file.
#[cfg(not(feature = "formats"))]
pub(super) fn read(_: &[u8], _: Want) -> Result<Loaded, Error> {
    Err(Error::new(ErrorKind::Format, "the file is an E57 file, which this build does not read")
        .advise("convert it to PLY or LAS, or build with the feature `formats`"))
}

/// The most packets in a row that may complete no point; with more the file counts as damaged.
#[cfg(feature = "formats")]
const MAX_EMPTY: usize = 1000;

#[cfg(feature = "formats")]
fn damaged(cause: impl std::fmt::Display) -> Error {
    Error::new(ErrorKind::Format, "the E57 file cannot be decoded")
        .caused_by(cause.to_string())
        .advise("fetch the file again; if it is whole, convert it to PLY or LAS")
}

#[cfg(feature = "formats")]
fn scans(bytes: &[u8], want: Want) -> Result<Loaded, Error> {
    use super::precision::check_point;
    use e57::{CartesianCoordinate, E57Reader, RecordDataType};

    let mut reader = E57Reader::new(std::io::Cursor::new(bytes)).map_err(damaged)?;
    let mut loaded = Loaded::default();
    let (mut none, mut total) = (0_usize, 0_usize);
    let (mut intensity, mut colour) = (Vec::new(), [const { Vec::new() }; 3]);
    let scans = reader.pointclouds();
    for (s, scan) in scans.iter().enumerate() {
        let name = format!("scan {}", s + 1);
        // The scanner stood at the origin of the scan's own frame. Without a pose the points may already be in the
        // common frame, and the scanner's place is not known.
        if let Some(e57::Transform { translation: t, .. }) = &scan.transform
            && [t.x, t.y, t.z].iter().all(|x| x.is_finite())
        {
            loaded.viewpoints.push([t.x, t.y, t.z]);
        }
        // Numbers that are all the same take no bits. If there are no others, any count would fit the file.
        let takes_bits = scan.prototype.iter().any(|r| match r.data_type {
            RecordDataType::Integer { min, max } | RecordDataType::ScaledInteger { min, max, .. } => {
                min < max
            }
            _ => true,
        });
        if scan.records > 8 * bytes.len() as u64 || (!takes_bits && scan.records > 0) {
            let what = format!("{} points promised, more than {} bytes can hold", scan.records, bytes.len());
            return Err(damaged(what).at_element(name));
        }
        let mut points = reader.pointcloud_simple(scan).map_err(damaged)?;
        let (mut read, mut empty) = (0, 0);
        while read < scan.records {
            let point = match points.next() {
                Some(Ok(point)) => point,
                // A packet that completes no point, such as an index, is an error of the crate; the next one may.
                Some(Err(e57::Error::Internal { .. })) if empty < MAX_EMPTY => {
                    empty += 1;
                    continue;
                }
                Some(Err(e)) => return Err(damaged(e).at_element(format!("{name}, point {read}"))),
                None => return Err(damaged("truncated").at_element(format!("{name}, point {read}"))),
            };
            (read, empty, total) = (read + 1, 0, total + 1);
            match point.cartesian {
                CartesianCoordinate::Valid { x, y, z } => {
                    check_point([x, y, z], want, "point", total - 1)?;
                    loaded.verts.push([x, y, z]);
                    if want == Want::Attributes {
                        intensity.push(point.intensity.map_or(f64::NAN, f64::from));
                        let parts = point.color.map(|c| [c.red, c.green, c.blue].map(f64::from));
                        let parts = parts.unwrap_or([f64::NAN; 3]);
                        colour.iter_mut().zip(parts).for_each(|(all, x)| all.push(x));
                    }
                }
                _ if want == Want::EveryRow => {
                    check_point([f64::NAN; 3], want, "point", total - 1)?;
                }
                _ => none += 1,
            }
        }
    }
    loaded.attributes = attributes(intensity, colour);
    loaded.left_out = none;
    if none > 0 {
        loaded.notices.push(format!("left out {none} of {total} points: nothing came back from there"));
    }
    if scans.len() > 1 {
        loaded.notices.push(format!("joined {} scans, each moved to its place", scans.len()));
    }
    Ok(loaded)
}

/// The attributes that any point has a value of: the intensity from 0 to 1, and the colour in bytes, black where there
/// is none.
#[cfg(feature = "formats")]
fn attributes(intensity: Vec<f64>, colour: [Vec<f64>; 3]) -> Vec<Attribute> {
    let any = |values: &[f64]| values.iter().any(|x| !x.is_nan());
    let mut all = Vec::new();
    if any(&intensity) {
        all.push(Attribute { name: "intensity".into(), number: Number::F32, values: intensity });
    }
    if any(&colour[0]) {
        let byte = |x: f64| if x.is_nan() { 0.0 } else { (255.0 * x).round().clamp(0.0, 255.0) };
        all.extend(COLOUR.into_iter().zip(colour).map(|(name, part)| Attribute {
            name: name.into(),
            number: Number::U8,
            values: part.into_iter().map(byte).collect(),
        }));
    }
    all
}

#[cfg(all(test, feature = "formats"))]
pub(super) mod tests {
    use super::*;
    use e57::{E57Writer, Record, RecordValue};

    /// A file of two scans of two points, the second moved, and each with a place without a return.
    pub fn sample() -> Vec<u8> {
        let path = std::env::temp_dir().join(format!(
            "bijective-sdf-{}-{:?}.e57",
            std::process::id(),
            std::thread::current().id()
        ));
        let mut writer = E57Writer::from_file(&path, "file").unwrap();
        for moved in [0.0, 10.0] {
            let invalid = Record {
                name: e57::RecordName::CartesianInvalidState,
                data_type: e57::RecordDataType::Integer { min: 0, max: 2 },
            };
            let prototype =
                vec![Record::CARTESIAN_X_F64, Record::CARTESIAN_Y_F64, Record::CARTESIAN_Z_F64, invalid];
            let mut scan = writer.add_pointcloud("scan", prototype).unwrap();
            scan.set_transform(Some(e57::Transform {
                translation: e57::Translation { x: moved, y: 0.0, z: 0.0 },
                rotation: e57::Quaternion { w: 1.0, x: 0.0, y: 0.0, z: 0.0 },
            }));
            for (p, state) in [([1.0, 2.0, 3.0], 0), ([0.0; 3], 2), ([4.0, 5.0, 6.5], 0)] {
                let [x, y, z] = p.map(RecordValue::Double);
                scan.add_point(vec![x, y, z, RecordValue::Integer(state)]).unwrap();
            }
            scan.finalize().unwrap();
        }
        writer.finalize().unwrap();
        drop(writer);
        let bytes = std::fs::read(&path).unwrap();
        std::fs::remove_file(&path).unwrap();
        bytes
    }

    #[test]
    fn intensity_and_colour_are_read_if_asked_for() {
        let path = std::env::temp_dir().join(format!("bijective-sdf-colours-{}.e57", std::process::id()));
        let mut writer = E57Writer::from_file(&path, "file").unwrap();
        let prototype = vec![
            Record::CARTESIAN_X_F64,
            Record::CARTESIAN_Y_F64,
            Record::CARTESIAN_Z_F64,
            Record::COLOR_RED_U8,
            Record::COLOR_GREEN_U8,
            Record::COLOR_BLUE_U8,
            Record::INTENSITY_UNIT_F32,
        ];
        let mut scan = writer.add_pointcloud("scan", prototype).unwrap();
        for (i, shade) in [(0.0, 255), (1.0, 51)] {
            let place = [i, 2.0 * i, 3.0].map(RecordValue::Double);
            let colour = [shade, 7, 0].map(RecordValue::Integer);
            let row = place.into_iter().chain(colour).chain([RecordValue::Single(0.25)]);
            scan.add_point(row.collect()).unwrap();
        }
        scan.finalize().unwrap();
        writer.finalize().unwrap();
        drop(writer);
        let bytes = std::fs::read(&path).unwrap();
        std::fs::remove_file(&path).unwrap();
        let found = read(&bytes, Want::Attributes).unwrap().attributes;
        let found: Vec<(&str, &[f64])> = found.iter().map(|a| (a.name.as_str(), &a.values[..])).collect();
        let want: [(&str, &[f64]); 4] = [
            ("intensity", &[0.25, 0.25]),
            ("red", &[255.0, 51.0]),
            ("green", &[7.0, 7.0]),
            ("blue", &[0.0, 0.0]),
        ];
        assert_eq!(found, want);
        assert!(read(&bytes, Want::Cloud).unwrap().attributes.is_empty());
        assert!(read(&sample(), Want::Attributes).unwrap().attributes.is_empty());
    }

    #[test]
    fn scans_are_joined_and_damage_is_answered() {
        let bytes = sample();
        assert!(looks_like_e57(&bytes));
        let loaded = read(&bytes, Want::Cloud).unwrap();
        assert_eq!(loaded.verts, [[1.0, 2.0, 3.0], [4.0, 5.0, 6.5], [11.0, 2.0, 3.0], [14.0, 5.0, 6.5]]);
        assert_eq!((loaded.left_out, &loaded.viewpoints), (2, &vec![[0.0; 3], [10.0, 0.0, 0.0]]));
        assert!(
            loaded.notices[0].contains("left out 2 of 6") && loaded.notices[1].contains("joined 2 scans")
        );
        assert!(read(&bytes, Want::EveryRow).is_err());
        for at in (0..bytes.len()).step_by(7) {
            let mut damaged = bytes.clone();
            damaged[at] ^= 0x41;
            // Every page has a checksum.
            let _ = read(&damaged, Want::Cloud);
            let _ = read(&bytes[..at], Want::Cloud);
        }
    }
}
