//! Zip archives, as far as NumPy's NPZ needs them, and what else an archive turns out to be.

use std::borrow::Cow;

use super::number::unsigned;
use crate::{Error, ErrorKind};

/// A file in an archive.
pub(super) struct Entry<'a> {
    pub name: String,
    method: u16,
    plain: u64,
    packed: &'a [u8],
}

/// Whether the bytes begin like an archive.
pub(super) fn looks_like_zip(bytes: &[u8]) -> bool {
    bytes.starts_with(b"PK\x03\x04") || bytes.starts_with(b"PK\x05\x06")
}

fn wrong(what: impl Into<String>) -> Error {
    Error::new(ErrorKind::Format, what).advise("fetch the file again")
}

/// The files of an archive, by the directory at its end.
pub(super) fn entries(bytes: &[u8]) -> Result<Vec<Entry<'_>>, Error> {
    let cut = || wrong("truncated: the directory at the end of the archive is missing");
    // The end record has 22 bytes and a comment of at most 64 KiB.
    let from = bytes.len().saturating_sub(22 + (1 << 16));
    let end = (from..bytes.len().saturating_sub(21)).rev().find(|&at| bytes[at..].starts_with(b"PK\x05\x06"));
    let end = end.ok_or_else(cut)?;
    let mut count = unsigned(bytes, end + 10, 2).ok_or_else(cut)?;
    let mut at = unsigned(bytes, end + 16, 4).ok_or_else(cut)?;
    // Where these are too small, a longer record stands before the end.
    if (count == 0xffff || at == 0xffff_ffff)
        && let Some(locator) = end.checked_sub(20).filter(|&l| bytes[l..].starts_with(b"PK\x06\x07"))
    {
        let long = unsigned(bytes, locator + 8, 8).and_then(|n| usize::try_from(n).ok()).ok_or_else(cut)?;
        count = unsigned(bytes, long.saturating_add(32), 8).ok_or_else(cut)?;
        at = unsigned(bytes, long.saturating_add(48), 8).ok_or_else(cut)?;
    }
    let mut at = usize::try_from(at).map_err(|_| cut())?;
    // A directory entry has 46 bytes at least.
    let mut out = Vec::with_capacity(usize::try_from(count).unwrap_or(0).min(bytes.len() / 46));
    for _ in 0..count {
        if !bytes.get(at..).is_some_and(|b| b.starts_with(b"PK\x01\x02")) {
            return Err(cut());
        }
        let field = |offset: usize, size: usize| unsigned(bytes, at + offset, size).ok_or_else(cut);
        let (method, mut packed, mut plain) = (field(10, 2)? as u16, field(20, 4)?, field(24, 4)?);
        let (name, extra, comment) = (field(28, 2)? as usize, field(30, 2)? as usize, field(32, 2)? as usize);
        let mut local = field(42, 4)?;
        let text = bytes.get(at + 46..at + 46 + name).ok_or_else(cut)?;
        let extras = bytes.get(at + 46 + name..at + 46 + name + extra).ok_or_else(cut)?;
        longer_sizes(extras, [&mut plain, &mut packed, &mut local]);
        let local = usize::try_from(local).map_err(|_| cut())?;
        let sizes =
            (unsigned(bytes, local.saturating_add(26), 2), unsigned(bytes, local.saturating_add(28), 2));
        let (Some(name_again), Some(extra_again)) = sizes else { return Err(cut()) };
        let data = local + 30 + (name_again + extra_again) as usize;
        let end = usize::try_from(packed).ok().and_then(|n| data.checked_add(n));
        let packed = end.and_then(|end| bytes.get(data..end)).ok_or_else(cut)?;
        out.push(Entry { name: String::from_utf8_lossy(text).into_owned(), method, plain, packed });
        at += 46 + name + extra + comment;
    }
    Ok(out)
}

/// Sizes of 64 bits from the extra fields of an entry, for those that did not fit 32.
fn longer_sizes(mut extras: &[u8], sizes: [&mut u64; 3]) {
    while let (Some(id), Some(length)) = (unsigned(extras, 0, 2), unsigned(extras, 2, 2)) {
        let end = (4 + length as usize).min(extras.len());
        if id == 1 {
            let mut at = 4;
            for size in sizes {
                if *size == 0xffff_ffff
                    && let Some(long) = unsigned(&extras[..end], at, 8)
                {
                    (*size, at) = (long, at + 8);
                }
            }
            return;
        }
        extras = &extras[end..];
    }
}

impl<'a> Entry<'a> {
    /// The bytes of the file.
    pub fn bytes(&self) -> Result<Cow<'a, [u8]>, Error> {
        match self.method {
            0 if self.plain == self.packed.len() as u64 => Ok(Cow::Borrowed(self.packed)),
            0 => Err(wrong(format!("the sizes of {} contradict each other", self.name))),
            8 => super::packed::inflate(self.packed, self.plain).map(Cow::Owned),
            n => Err(Error::new(ErrorKind::Format, format!("{} is packed by method {n}", self.name))
                .advise("unpack the archive and give the file inside")),
        }
    }
}

/// What an archive without arrays is.
pub(super) fn what(entries: &[Entry<'_>]) -> Error {
    let any = |part: &str| entries.iter().any(|e| e.name.contains(part));
    let (what, advice) = if any("xl/") {
        ("an Excel workbook", "save the sheet as CSV")
    } else if any("3D/") && any(".model") {
        ("a 3MF model", "export it as STL, OBJ or PLY")
    } else if any(".kml") {
        ("a KMZ map", "convert it to points in metres and save them as CSV or LAS")
    } else if any("content.xml") {
        ("an OpenDocument file", "save the sheet as CSV")
    } else {
        ("a zip archive", "unpack it and give the file inside")
    };
    Error::new(ErrorKind::Format, format!("{what} is not supported")).advise(advice)
}
