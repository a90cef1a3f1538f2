//! Packed points, decoded by the crate `laz`.
//!
//! The crate believes the sizes that it reads, so all of them are held against the bytes of the file before it is
//! asked.

use std::io::{Cursor, Seek, SeekFrom};
use std::panic::{AssertUnwindSafe, catch_unwind};

use laz::{LasZipDecompressor, LazVlr};

use super::super::number::unsigned;
use super::super::{Loaded, Want};
use super::header::{Header, wrong};
use crate::{Error, ErrorKind};

/// Unpacks the points.
pub(super) fn read(bytes: &[u8], header: &Header, want: Want, loaded: &mut Loaded) -> Result<(), Error> {
    let vlr = description(bytes)?;
    if check(bytes, header, vlr)? {
        loaded.warnings.push(format!(
            "the header promises {} points, the packed data hold more; the others were not read",
            header.count
        ));
    }
    let damaged = |e: String| {
        Error::new(ErrorKind::Format, "the packed points are damaged")
            .caused_by(e)
            .advise("fetch the file again")
    };
    // Damage that the checks did not see may still break the decoder; that is no reason for the program to end.
    let unpack = AssertUnwindSafe(|| -> Result<(), Error> {
        let vlr = LazVlr::from_buffer(vlr).map_err(|e| damaged(e.to_string()))?;
        let mut source = Cursor::new(bytes);
        source.seek(SeekFrom::Start(header.start as u64)).map_err(|e| damaged(e.to_string()))?;
        let mut points = LasZipDecompressor::new(source, vlr).map_err(|e| damaged(e.to_string()))?;
        let mut row = vec![0; header.record];
        for i in 0..header.count {
            points
                .decompress_one(&mut row)
                .map_err(|e| damaged(e.to_string()).at_element(format!("point {i} of {}", header.count)))?;
            header.push(&row, want, loaded)?;
        }
        Ok(())
    });
    catch_unwind(unpack).unwrap_or_else(|_| Err(damaged("the decoder gave up".into())))
}

/// The record that describes the packing.
fn description(bytes: &[u8]) -> Result<&[u8], Error> {
    let cut = || wrong("truncated: the file ends in front of its points");
    // Records with more about the file follow the header.
    let mut at = unsigned(bytes, 94, 2).ok_or_else(cut)? as usize;
    for _ in 0..unsigned(bytes, 100, 4).ok_or_else(cut)? {
        let head = bytes.get(at..at + 54).ok_or_else(cut)?;
        let size = unsigned(head, 20, 2).unwrap_or(0) as usize;
        let data = bytes.get(at + 54..at + 54 + size).ok_or_else(cut)?;
        if head[2..].starts_with(b"laszip encoded") && unsigned(head, 18, 2) == Some(22204) {
            return Ok(data);
        }
        at += 54 + size;
    }
    Err(wrong("the points are packed, but the file does not say how"))
}

/// Makes sure that the sizes of records, chunks and layers fit the file. Says whether they are certain to hold more
/// points than the header promises.
fn check(bytes: &[u8], header: &Header, vlr: &[u8]) -> Result<bool, Error> {
    let cut = || wrong("truncated: the description of the packing is not whole");
    let items = unsigned(vlr, 32, 2).ok_or_else(cut)?;
    let (mut record, mut layers) = (0, 0);
    for i in 0..items as usize {
        let (kind, size) = (unsigned(vlr, 34 + 6 * i, 2), unsigned(vlr, 36 + 6 * i, 2));
        let (Some(kind), Some(size)) = (kind, size) else { return Err(cut()) };
        record += size;
        // Layers of each item kind of LAZ: 10 point (9), 11 RGB (1), 12 RGB and NIR (2), 13 wave packet (1), 14 extra
        // bytes (one a byte).
        layers += match kind {
            10 => 9,
            11 | 13 => 1,
            12 => 2,
            14 => size,
            _ => 0,
        };
    }
    if items == 0 || record != header.record as u64 {
        return Err(wrong(format!(
            "packed points have {record} bytes, but the header says {}",
            header.record
        )));
    }
    let body = &bytes[header.start..];
    // Packing pointwise, in one piece, has no table.
    let kind = unsigned(vlr, 0, 2).ok_or_else(cut)?;
    if kind == 1 {
        return Ok(false);
    }
    let mut table = unsigned(body, 0, 8).ok_or_else(cut)?;
    if table <= header.start as u64 || table > i64::MAX as u64 {
        table = unsigned(bytes, bytes.len().saturating_sub(8), 8).ok_or_else(cut)?;
    }
    let chunks = usize::try_from(table).ok().and_then(|t| unsigned(bytes, t.checked_add(4)?, 4));
    if chunks.is_some_and(|n| n > header.count.min(bytes.len() as u64) + 1) {
        return Err(wrong("the table of the packed chunks is damaged"));
    }
    // All chunks but the last one are full, unless their size varies.
    let size = unsigned(vlr, 12, 4).filter(|size| *size < u64::from(u32::MAX));
    let least = size.zip(chunks).map_or(0, |(size, chunks)| chunks.saturating_sub(1).saturating_mul(size));
    if kind != 3 {
        return Ok(least > header.count);
    }
    // Each chunk: its first point as it is, the number of its points, the sizes of its layers, the layers.
    let (mut at, mut points) = (8_u64, 0);
    while points < header.count {
        let place = |offset: u64| usize::try_from(at + offset).ok();
        let count = place(record).and_then(|p| unsigned(body, p, 4)).ok_or_else(cut)?;
        let mut sum = 0;
        for layer in 0..layers {
            sum += place(record + 4 + 4 * layer).and_then(|p| unsigned(body, p, 4)).ok_or_else(cut)?;
        }
        at += record + 4 + 4 * layers + sum;
        points += count;
        if count == 0 || at > body.len() as u64 {
            return Err(wrong("the packed chunks are longer than the file"));
        }
    }
    Ok(points.max(least) > header.count)
}

#[cfg(test)]
pub(in super::super) mod tests {
    use super::super::tests::{POINTS, header, records};
    use super::super::{looks_like_las, read};
    use super::*;
    use laz::{LasZipCompressor, LazItemRecordBuilder, LazVlrBuilder};

    /// A packed file of three points.
    pub fn sample(format: u8) -> Vec<u8> {
        packed(format, 3, 3)
    }

    /// The same with so many points in a chunk, and with another count in its header.
    fn packed(format: u8, chunk: u32, count: u64) -> Vec<u8> {
        let items = LazItemRecordBuilder::default_for_point_format_id(format, 0).unwrap();
        let (minor, record) = if format >= 6 { (4, 30) } else { (2, 20) };
        let rows: Vec<u8> = records()
            .chunks_exact(20)
            .flat_map(|row| {
                let mut row = row.to_vec();
                row[12..].fill(0);
                row.resize(record, 0);
                row[14] = 0x11;
                row
            })
            .collect();
        let vlr = LazVlrBuilder::new(items).with_fixed_chunk_size(chunk).build();
        let mut description = Vec::new();
        vlr.write_to(&mut description).unwrap();
        let mut extra = vec![0; 54];
        extra[2..16].copy_from_slice(b"laszip encoded");
        extra[18..20].copy_from_slice(&22204_u16.to_le_bytes());
        extra[20..22].copy_from_slice(&(description.len() as u16).to_le_bytes());
        extra.extend(description);
        let mut bytes = header(minor, format | 0x80, &extra, count);
        bytes[105..107].copy_from_slice(&(record as u16).to_le_bytes());
        let mut out = Cursor::new(bytes);
        out.seek(SeekFrom::End(0)).unwrap();
        let mut packer = LasZipCompressor::new(&mut out, vlr).unwrap();
        packer.compress_many(&rows).unwrap();
        packer.done().unwrap();
        drop(packer);
        out.into_inner()
    }

    #[test]
    fn a_count_that_is_too_small_is_warned_of() {
        for (format, chunk, count, more) in [
            (0, 2, 1, true),
            (6, 2, 1, true),
            // Chunks of the newer formats say how many points they hold.
            (6, 3, 2, true),
            (0, 1, 3, false),
            (6, 1, 3, false),
            (6, 2, 3, false),
        ] {
            let loaded = read(&packed(format, chunk, count), Want::Cloud).unwrap();
            assert_eq!(loaded.verts, POINTS[..count as usize]);
            let expected =
                format!("the header promises {count} points, the packed data hold more; the others");
            let warned = loaded.warnings.iter().any(|w| w.starts_with(&expected));
            assert!(warned == more && loaded.warnings.len() == usize::from(more), "{format} {chunk} {count}");
        }
    }

    #[test]
    fn packed_points_come_back_and_damage_is_answered() {
        for format in [0, 6] {
            let bytes = sample(format);
            assert!(looks_like_las(&bytes));
            assert_eq!(read(&bytes, Want::Cloud).unwrap().verts, POINTS, "{format}");
            let start = bytes.len() - 60;
            for end in start..bytes.len() {
                // The table at the end may be cut: the points before it are whole.
                let cut = read(&bytes[..end], Want::Cloud).map(|l| l.verts);
                assert!(cut.is_err() || cut.unwrap() == POINTS, "{end}");
            }
            for at in 0..bytes.len() {
                for flip in [0x01, 0x80, 0xff] {
                    let mut damaged = bytes.clone();
                    damaged[at] ^= flip;
                    let _ = read(&damaged, Want::Cloud);
                }
            }
        }
    }
}
