//! The public header block: what the points of a LAS file are, and how a record is read.

use super::super::number::{ByteOrder, NumberType, unsigned};
use super::super::precision::check_point;
use super::super::{Loaded, Want};
use crate::geometry::{Attribute, COLOUR, Number};
use crate::{Error, ErrorKind};

/// Least bytes of a record, by its format.
const MIN_RECORD: [u64; 11] = [20, 28, 26, 34, 57, 63, 30, 36, 38, 59, 67];

/// Bytes of the header of versions up to 1.3, at the least, and of 1.4.
const SIZES: [u64; 2] = [227, 375];

/// Where the colour begins in a record, by its format.
const COLOURS: [Option<usize>; 11] =
    [None, None, Some(20), Some(28), None, Some(28), None, Some(30), Some(30), None, Some(30)];

/// Whether the bytes begin like a LAS file.
pub(in crate::io) fn looks_like_las(bytes: &[u8]) -> bool {
    bytes.starts_with(b"LASF")
}

/// What the header says of the points.
pub(super) struct Header {
    pub packed: bool,
    pub format: usize,
    pub record: usize,
    pub count: u64,
    pub start: usize,
    /// Bytes of the header.
    size: usize,
    pub scale: [f64; 3],
    pub offset: [f64; 3],
    /// The least and the greatest coordinates, as the header has them.
    bounds: [[f64; 3]; 2],
}

/// The error for a file that is not as LAS files are.
pub(super) fn wrong(what: impl Into<String>) -> Error {
    Error::new(ErrorKind::Format, what).advise("fetch the file again; if it is whole, export it again")
}

impl Header {
    /// Reads the public header block.
    pub fn parse(bytes: &[u8]) -> Result<Header, Error> {
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
        let bounds =
            [decimal(187)?, decimal(179)?, decimal(203)?, decimal(195)?, decimal(219)?, decimal(211)?];
        let bounds = [0, 1].map(|end| [0, 1, 2].map(|axis| bounds[2 * axis + end]));
        let (start, size) = (field(96, 4)?, field(94, 2)?.max(SIZES[usize::from(minor >= 4)]));
        if start < size {
            return Err(wrong(format!(
                "points begin at byte {start} by the header, inside the header itself, which has {size} bytes"
            )));
        }
        let (start, size) = (start as usize, size as usize);
        if start > bytes.len() {
            return Err(wrong(format!(
                "truncated: points begin at byte {start}, and the file has {}",
                bytes.len()
            )));
        }
        let (format, record) = (format as usize, record as usize);
        Ok(Header { packed, format, record, count, start, size, scale, offset, bounds })
    }

    /// Where points end at the latest: at the wave packets (since version 1.3) or the further records (since 1.4) that
    /// may follow them, or at the end of the file.
    pub fn records_end(&self, bytes: &[u8]) -> usize {
        let others = [227, 235].into_iter().filter(|at| at + 8 <= self.size);
        let places = others.filter_map(|at| usize::try_from(unsigned(bytes, at, 8)?).ok());
        places.filter(|&place| place >= self.start).fold(bytes.len(), usize::min)
    }

    /// The warning about points outside the box of the header, by more than steps or 32-bit floats round. A box that
    /// was not filled in says nothing.
    pub fn outside(&self, points: &[[f64; 3]]) -> Option<String> {
        let [low, high] = self.bounds;
        let ordered = (0..3).all(|a| low[a].is_finite() && high[a].is_finite() && low[a] <= high[a]);
        if !ordered || (low == [0.0; 3] && high == [0.0; 3]) {
            return None;
        }
        let room = |a: usize| self.scale[a].abs() + 1e-7 * low[a].abs().max(high[a].abs());
        let out = |p: &&[f64; 3]| (0..3).any(|a| p[a] < low[a] - room(a) || p[a] > high[a] + room(a));
        let count = points.iter().filter(out).count();
        (count > 0).then(|| {
            format!(
                "{count} of {} points lie outside the box that the header gives; the file may be damaged",
                points.len()
            )
        })
    }

    /// Adds the point of a record, whose first three numbers are its place in steps.
    pub fn push(&self, row: &[u8], want: Want, loaded: &mut Loaded) -> Result<(), Error> {
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
    pub fn attributes(&self) -> Vec<Attribute> {
        let one =
            |(name, number): (&str, Number)| Attribute { name: name.into(), number, values: Vec::new() };
        let colours = COLOUR.into_iter().filter(|_| COLOURS[self.format].is_some());
        let plain = [("intensity", Number::U16), ("classification", Number::U8)];
        plain.into_iter().chain(colours.map(|name| (name, Number::U16))).map(one).collect()
    }
}
