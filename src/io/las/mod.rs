//! LAS, the format of laser scans from the air, versions 1.0 to 1.4, and LAZ, the same packed.
//!
//! Offsets are those of the public header block of the LAS 1.4 specification (R15, ASPRS 2019).

use super::{Loaded, Want};
use crate::Error;
#[cfg(not(feature = "formats"))]
use crate::ErrorKind;
use crate::geometry::{Attribute, Number};

mod header;
#[cfg(feature = "formats")]
mod laz;

pub(super) use header::looks_like_las;
use header::{Header, wrong};

/// Reads n x 3 points, scaled and moved as the header says.
pub(super) fn read(bytes: &[u8], want: Want) -> Result<Loaded, Error> {
    let header = Header::parse(bytes)?;
    let mut loaded = Loaded::default();
    if want == Want::Attributes {
        loaded.attributes = header.attributes();
    }
    if header.packed {
        packed(bytes, &header, want, &mut loaded)?;
    } else {
        let body = &bytes[header.start..];
        let needed = header.count.checked_mul(header.record as u64);
        if needed.is_none_or(|n| n > body.len() as u64) {
            return Err(wrong(format!(
                "truncated: {} points of {} bytes promised, {} are there",
                header.count,
                header.record,
                body.len() / header.record
            )));
        }
        loaded.verts.reserve_exact(header.count as usize);
        for row in body.chunks_exact(header.record).take(header.count as usize) {
            header.push(row, want, &mut loaded)?;
        }
        let found = header.records_end(bytes).saturating_sub(header.start) / header.record;
        loaded.warn_of_rest("points", header.count, found as u64);
    }
    short_colours(&mut loaded.attributes);
    loaded.warnings.extend(header.outside(&loaded.verts));
    Ok(loaded)
}

/// Makes bytes of the parts of colours. They have 16 bits, but many programs fill 8 of them only.
fn short_colours(attributes: &mut [Attribute]) {
    let parts = || attributes.iter().filter(|a| a.is_colour());
    let wide = parts().flat_map(|a| &a.values).any(|&x| x > 255.0);
    for part in attributes.iter_mut().filter(|a| a.is_colour()) {
        part.number = Number::U8;
        if wide {
            // 65,535 is 257 times 255.
            part.values.iter_mut().for_each(|x| *x = (*x / 257.0).round());
        }
    }
}

#[cfg(feature = "formats")]
fn packed(bytes: &[u8], header: &Header, want: Want, loaded: &mut Loaded) -> Result<(), Error> {
    laz::read(bytes, header, want, loaded)
}

#[cfg(not(feature = "formats"))]
fn packed(_: &[u8], _: &Header, _: Want, _: &mut Loaded) -> Result<(), Error> {
    Err(Error::new(ErrorKind::Format, "the points are packed (LAZ), which this build does not unpack")
        .advise("unpack them to LAS, or build with the feature `formats`"))
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    pub const POINTS: [[f64; 3]; 3] = [[100.5, 200.25, -3.0], [101.0, 200.5, -2.75], [99.75, 201.0, -3.5]];

    /// The records of the points in steps of 1/4 from 100, 200, 0; format 0.
    pub fn records() -> Vec<u8> {
        let offset = [100.0, 200.0, 0.0];
        let steps =
            |p: &[f64; 3]| [0, 1, 2].map(|a| (((p[a] - offset[a]) / 0.25) as i32).to_le_bytes()).concat();
        POINTS.iter().flat_map(|p| [steps(p), vec![7; 8]].concat()).collect()
    }

    /// A header for them, with `extras` between it and the points.
    pub fn header(minor: u8, format: u8, extras: &[u8], count: u64) -> Vec<u8> {
        let size: u16 = if minor >= 4 { 375 } else { 227 };
        let mut h = vec![0; size as usize];
        let mut put = |at: usize, bytes: &[u8]| h[at..at + bytes.len()].copy_from_slice(bytes);
        put(0, b"LASF");
        put(24, &[1, minor]);
        put(94, &size.to_le_bytes());
        put(96, &(u32::from(size) + extras.len() as u32).to_le_bytes());
        put(100, &u32::from(!extras.is_empty()).to_le_bytes());
        put(104, &[format]);
        put(105, &20_u16.to_le_bytes());
        if minor >= 4 {
            put(247, &count.to_le_bytes());
        } else {
            put(107, &(count as u32).to_le_bytes());
        }
        for axis in 0..3 {
            put(131 + 8 * axis, &0.25_f64.to_le_bytes());
            put(155 + 8 * axis, &[100_f64, 200.0, 0.0][axis].to_le_bytes());
        }
        h.extend(extras);
        h
    }

    #[test]
    fn points_are_scaled_and_moved() {
        for minor in [0, 2, 4] {
            let bytes = [header(minor, 0, &[], 3), records()].concat();
            assert_eq!(read(&bytes, Want::Cloud).unwrap().verts, POINTS, "1.{minor}");
            for end in 0..bytes.len() {
                assert!(read(&bytes[..end], Want::Cloud).is_err(), "{end}");
            }
        }
    }

    #[test]
    fn intensity_class_and_colour_become_attributes() {
        for (format, record, class, colour) in
            [(0, 20, 15, None), (2, 26, 15, Some(20)), (3, 34, 15, Some(28)), (7, 36, 16, Some(30))]
        {
            for scale in [1_u16, 257] {
                let mut head = header(if format == 7 { 4 } else { 2 }, format, &[], 3);
                head[105..107].copy_from_slice(&(record as u16).to_le_bytes());
                let mut rows = Vec::new();
                for old in records().chunks_exact(20) {
                    let mut row = old[..12].to_vec();
                    row.resize(record, 0);
                    row[12..14].copy_from_slice(&4000_u16.to_le_bytes());
                    // With the flag of a withheld point in the older formats.
                    row[class] = if class == 15 { 0x86 } else { 6 };
                    for (part, x) in [200_u16, 0, 17].into_iter().enumerate() {
                        if let Some(at) = colour {
                            row[at + 2 * part..][..2].copy_from_slice(&(x * scale).to_le_bytes());
                        }
                    }
                    rows.extend(row);
                }
                let loaded = read(&[head, rows].concat(), Want::Attributes).unwrap();
                assert_eq!(loaded.verts, POINTS);
                let found: Vec<(&str, &[f64])> =
                    loaded.attributes.iter().map(|a| (a.name.as_str(), &a.values[..])).collect();
                let expected: [(&str, &[f64]); 5] = [
                    ("intensity", &[4000.0; 3]),
                    ("classification", &[6.0; 3]),
                    ("red", &[200.0; 3]),
                    ("green", &[0.0; 3]),
                    ("blue", &[17.0; 3]),
                ];
                assert_eq!(found, expected[..if colour.is_some() { 5 } else { 2 }], "format {format}");
            }
        }
    }

    #[test]
    fn a_count_that_is_too_small_is_warned_of() {
        let expected = "the header promises 2 points, 3 are there; the last 1 were not read";
        for minor in [0, 2, 3, 4] {
            let warnings = |count, tail: usize| {
                let bytes = [header(minor, 0, &[], count), records(), vec![7; tail]].concat();
                let loaded = read(&bytes, Want::Cloud).unwrap();
                assert_eq!(loaded.verts, POINTS[..count as usize]);
                loaded.warnings
            };
            assert_eq!(warnings(2, 0), [expected], "1.{minor}");
            assert_eq!(warnings(2, 19), [expected], "1.{minor}");
            assert!(warnings(3, 0).is_empty() && warnings(3, 19).is_empty(), "1.{minor}");
        }
        // What else may follow the points since version 1.3 and 1.4.
        for (minor, field) in [(3, 227), (4, 227), (4, 235)] {
            let extras = if minor == 3 { vec![0; 8] } else { Vec::new() };
            let mut bytes = [header(minor, 0, &extras, 3), records()].concat();
            let end = bytes.len() as u64;
            bytes[100..104].fill(0);
            if minor == 3 {
                bytes[94..96].copy_from_slice(&235_u16.to_le_bytes());
            }
            bytes[field..field + 8].copy_from_slice(&end.to_le_bytes());
            bytes.extend([7; 100]);
            assert!(read(&bytes, Want::Cloud).unwrap().warnings.is_empty(), "1.{minor} {field}");
        }
    }

    #[test]
    fn points_outside_the_box_of_the_header_are_warned_of() {
        // The box of the points.
        let (low, high) = ([99.75, 200.25, -3.5], [101.0, 201.0, -2.75]);
        let warnings = |low: [f64; 3], high: [f64; 3]| {
            let mut head = header(2, 0, &[], 3);
            for axis in 0..3 {
                head[179 + 16 * axis..][..8].copy_from_slice(&high[axis].to_le_bytes());
                head[187 + 16 * axis..][..8].copy_from_slice(&low[axis].to_le_bytes());
            }
            read(&[head, records()].concat(), Want::Cloud).unwrap().warnings
        };
        for (low, high) in [
            (low, high),
            (low.map(|x| x - 9.0), high.map(|x| x + 9.0)),
            // A step of rounding.
            (low.map(|x| x + 0.2), high.map(|x| x - 0.2)),
            // Boxes that were not filled in.
            ([0.0; 3], [0.0; 3]),
            ([f64::NAN; 3], [f64::NAN; 3]),
            ([f64::MAX; 3], [f64::MIN; 3]),
            (low, [101.0, f64::INFINITY, -3.0]),
        ] {
            assert!(warnings(low, high).is_empty(), "{low:?} {high:?}");
        }
        for (low, high, count) in [
            ([99.75, 200.25, -2.9], high, 1),
            (low, [100.2, 201.0, -2.75], 2),
            (low, [101.0, 200.6, -2.75], 1),
            ([0.0; 3], [1.0, 1.0, 1.0], 3),
        ] {
            let all = warnings(low, high);
            let expected = format!("{count} of 3 points lie outside the box that the header gives");
            assert!(all.len() == 1 && all[0].starts_with(&expected), "{all:?}");
        }
    }

    #[test]
    fn what_is_wrong_is_said() {
        let message = |bytes: Vec<u8>| read(&bytes, Want::Cloud).map(|l| l.verts).unwrap_err().to_string();
        assert!(message(b"LASF\x00".to_vec()).contains("ends in its header, at 5 bytes"));
        assert!(message(header(5, 0, &[], 0)).contains("version 1.5"));
        assert!(message(header(2, 11, &[], 0)).contains("point format 11"));
        assert!(message(header(2, 1, &[], 0)).contains("28 bytes or more, not 20"));
        assert!(message(header(4, 0, &[], u64::MAX)).contains("promised, 0 are there"));
        for (minor, size) in [(0, 227), (2, 227), (3, 227), (4, 375)] {
            for start in [0_u32, 10, size - 1] {
                let mut inside = [header(minor, 0, &[], 3), records()].concat();
                inside[96..100].copy_from_slice(&start.to_le_bytes());
                let expected =
                    format!("points begin at byte {start} by the header, inside the header itself");
                assert!(message(inside).contains(&expected), "1.{minor}");
            }
        }
        // The header may be longer than its version needs.
        let mut long = [header(2, 0, &[], 3), records()].concat();
        long[94..96].copy_from_slice(&235_u16.to_le_bytes());
        assert!(message(long).contains("which has 235 bytes"));
        let mut flat = header(2, 0, &[], 0);
        flat[131..139].fill(0);
        assert!(message(flat).contains("scale"));
    }
}
