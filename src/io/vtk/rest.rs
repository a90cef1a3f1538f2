//! What follows the head of a VTK file, taken word by word, line by line, or as binary numbers.

use super::super::number::{ByteOrder, NumberType};
use super::super::text::float;
use crate::{Error, ErrorKind};

/// The bytes behind the header, of which words and lines are taken.
pub(super) struct Rest<'a> {
    pub bytes: &'a [u8],
    /// Where the next byte to be read is.
    pub at: usize,
    /// How many lines were read.
    pub line: u64,
}

impl<'a> Rest<'a> {
    /// The next line, without white space around it; `None` at the end.
    pub fn next_line(&mut self) -> Option<&'a [u8]> {
        let rest = &self.bytes[self.at..];
        if rest.is_empty() {
            return None;
        }
        let end = rest.iter().position(|&b| b == b'\n').unwrap_or(rest.len());
        self.at += (end + 1).min(rest.len());
        self.line += 1;
        Some(rest[..end].trim_ascii())
    }

    /// The next word, on whatever line.
    pub fn next_word(&mut self) -> Option<&'a [u8]> {
        let rest = &self.bytes[self.at..];
        let start = rest.iter().position(|b| !b.is_ascii_whitespace())?;
        let length = rest[start..].iter().position(u8::is_ascii_whitespace).unwrap_or(rest.len() - start);
        self.at += start + length;
        Some(&rest[start..start + length])
    }

    /// So many numbers of a type, in binary or as words; `None` if they are not all there.
    pub fn numbers(&mut self, count: usize, number: NumberType, binary: bool) -> Option<Vec<f64>> {
        let left = self.bytes.len() - self.at;
        if !binary {
            // Each takes a byte at least, so a false count reserves nothing.
            return (count <= left).then(|| (0..count).map(|_| float(self.next_word()?)).collect())?;
        }
        let bytes = count.checked_mul(number.size()).filter(|bytes| *bytes <= left)?;
        let body = &self.bytes[self.at..self.at + bytes];
        self.at += bytes;
        Some(body.chunks_exact(number.size()).map(|bytes| number.read(bytes, ByteOrder::Big)).collect())
    }

    /// The next line that is not empty.
    pub fn next_words(&mut self) -> Option<&'a [u8]> {
        loop {
            let line = self.next_line()?;
            if !line.is_empty() {
                return Some(line);
            }
        }
    }
}

/// The type of numbers that goes by this name, in small letters.
pub(super) fn number_type(name: &[u8]) -> Option<NumberType> {
    Some(match name {
        b"float" => NumberType::F32,
        b"double" => NumberType::F64,
        b"char" => NumberType::I8,
        b"unsigned_char" => NumberType::U8,
        b"short" => NumberType::I16,
        b"unsigned_short" => NumberType::U16,
        b"int" | b"vtkidtype" => NumberType::I32,
        b"unsigned_int" => NumberType::U32,
        b"long" | b"vtktypeint64" => NumberType::I64,
        b"unsigned_long" | b"vtktypeuint64" => NumberType::U64,
        _ => return None,
    })
}

/// The error for a file that is not as legacy VTK files are.
pub(super) fn wrong(what: impl Into<String>) -> Error {
    Error::new(ErrorKind::Format, what).advise("the file is damaged or not legacy VTK; export it again")
}
