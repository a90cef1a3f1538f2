//! LAS, the format of laser scans from the air, versions 1.0 to 1.4, and LAZ, the same packed.
//!
//! Offsets are those of the public header block of the LAS 1.4 specification (R15, ASPRS 2019).

use super::number::{ByteOrder, NumberType, unsigned};
use super::precision::check_point;
use super::{Loaded, Want};
use crate::geometry::{Attribute, COLOUR, Number};
use crate::{Error, ErrorKind};

#[cfg(feature = "formats")]
mod laz;

/// Least bytes of a record, by its format.
const MIN_RECORD: [u64; 11] = [20, 28, 26, 34, 57, 63, 30, 36, 38, 59, 67];

/// Where the colour begins in a record, by its format.
const COLOURS: [Option<usize>; 11] =
    [None, None, Some(20), Some(28), None, Some(28), None, Some(30), Some(30), None, Some(30)];

/// Whether the bytes begin like a LAS file.
pub(super) fn looks_like_las(bytes: &[u8]) -> bool {
    bytes.starts_with(b"LASF")
}

/// What the header says of the points.
struct Header {
    packed: bool,
    format: usize,
    record: usize,
    count: u64,
    start: usize,
    scale: [f64; 3],
    offset: [f64; 3],
}

fn wrong(what: impl Into<String>) -> Error {
    Error::new(ErrorKind::Format, what).advise("fetch the file again; if it is whole, export it again")
}

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
    }
    short_colours(&mut loaded.attributes);
    Ok(loaded)
}

impl Header {
    fn parse(bytes: &[u8]) -> Result<Header, Error> {
        let short = || wrong(format!("truncated: the file ends in its header, at {} bytes", bytes.len()));
        let field = |at: usize, size: usize| unsigned(bytes, at, size).ok_or_else(short);
        let minor = field(25, 1)?;
        if !looks_like_las(bytes) || field(24, 1)? != 1 || minor > 4 {
            return Err(wrong(format!("LAS version {}.{minor} is not known", field(24, 1)?)));
        }
        let (format, record) = (field(104, 1)?, field(105, 2)?);
        // The two highest bits say that points are packed.
        let (packed, format) = (format & 0xc0 != 0, format & 0x3f);
        let least = MIN_RECORD.get(format as usize).copied();
        let Some(least) = least else { return Err(wrong(format!("point format {format} is not known"))) };
        if record < least {
            return Err(wrong(format!("points of format {format} have {least} bytes or more, not {record}")));
        }
        let mut count = field(107, 4)?;
        if minor >= 4 {
            // The older count is 0, or the same.
            count = field(247, 8)?.max(count);
        }
        let decimal = |at: usize| field(at, 8).map(f64::from_bits);
        let scale = [decimal(131)?, decimal(139)?, decimal(147)?];
        let offset = [decimal(155)?, decimal(163)?, decimal(171)?];
        if scale.iter().any(|s| !s.is_finite() || *s == 0.0) || offset.iter().any(|o| !o.is_finite()) {
            return Err(wrong("the scale or the offset of the coordinates is 0 or not finite"));
        }
        let start = field(96, 4)? as usize;
        if start > bytes.len() {
            return Err(wrong(format!(
                "truncated: points begin at byte {start}, and the file has {}",
                bytes.len()
            )));
        }
        Ok(Header { packed, format: format as usize, record: record as usize, count, start, scale, offset })
    }

    /// Adds the point of a record, whose first three numbers are its place in steps.
    fn push(&self, row: &[u8], want: Want, loaded: &mut Loaded) -> Result<(), Error> {
        let step = |axis: usize| NumberType::I32.read(&row[4 * axis..], ByteOrder::Little);
        let point = [0, 1, 2].map(|axis| step(axis) * self.scale[axis] + self.offset[axis]);
        check_point(point, want, "point", loaded.verts.len())?;
        loaded.verts.push(point);
        if want == Want::Attributes {
            let word = |at: usize| NumberType::U16.read(&row[at..], ByteOrder::Little);
            // Formats before 6 have flags in the upper bits of the class.
            let class = if self.format < 6 { row[15] & 0x1f } else { row[16] };
            let colour = COLOURS[self.format].map_or([0.0; 3], |at| [0, 2, 4].map(|part| word(at + part)));
            let values = [word(12), f64::from(class)].into_iter().chain(colour);
            loaded.attributes.iter_mut().zip(values).for_each(|(a, x)| a.values.push(x));
        }
        Ok(())
    }

    /// What records of the format have beside the place, without values yet.
    fn attributes(&self) -> Vec<Attribute> {
        let one =
            |(name, number): (&str, Number)| Attribute { name: name.into(), number, values: Vec::new() };
        let colours = COLOUR.into_iter().filter(|_| COLOURS[self.format].is_some());
        let plain = [("intensity", Number::U16), ("classification", Number::U8)];
        plain.into_iter().chain(colours.map(|name| (name, Number::U16))).map(one).collect()
    }
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
    fn what_is_wrong_is_said() {
        let message = |bytes: Vec<u8>| read(&bytes, Want::Cloud).map(|l| l.verts).unwrap_err().to_string();
        assert!(message(b"LASF\x00".to_vec()).contains("ends in its header, at 5 bytes"));
        assert!(message(header(5, 0, &[], 0)).contains("version 1.5"));
        assert!(message(header(2, 11, &[], 0)).contains("point format 11"));
        assert!(message(header(2, 1, &[], 0)).contains("28 bytes or more, not 20"));
        assert!(message(header(4, 0, &[], u64::MAX)).contains("promised, 0 are there"));
        let mut flat = header(2, 0, &[], 0);
        flat[131..139].fill(0);
        assert!(message(flat).contains("scale"));
    }
}
