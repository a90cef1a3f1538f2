//! The header of a PCD file: which fields its points have, how many points there are, and how they are stored.

use super::super::number::NumberType;
use super::super::text::{float, integer, show, words};
use crate::geometry::Attribute;
use crate::{Error, ErrorKind};

const MAX_HEADER: usize = 1 << 20;

/// A column, or several of one name.
pub(super) struct Field {
    pub name: String,
    pub number: NumberType,
    /// Its columns.
    pub count: usize,
    /// Where it begins in a row, in bytes.
    pub offset: usize,
    /// Where it begins in a line of text, in words.
    pub word: usize,
}

impl Field {
    /// The attribute that it becomes, without values yet.
    pub fn attribute(&self) -> Attribute {
        Attribute { name: self.name.clone(), number: self.number.kept_as(), values: Vec::new() }
    }
}

/// How the points are stored.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Data {
    Ascii,
    Binary,
    /// Binary, packed with LZF.
    Packed,
}

pub(super) struct Header {
    pub fields: Vec<Field>,
    pub points: u64,
    /// The points as rows and columns of an image, where they are no mere list.
    pub organised: bool,
    pub viewpoint: Option<Vec<f64>>,
    pub data: Data,
    /// Where the data begin, in bytes.
    pub body: usize,
    /// Lines of the header.
    pub lines: u64,
    /// Bytes of a point.
    pub row: usize,
}

impl Header {
    pub fn parse(bytes: &[u8]) -> Result<Header, Error> {
        let mut said = Said::default();
        let (mut at, mut number) = (0, 0);
        loop {
            // Binary data may begin with half a line ending, so lines end at the line feed alone.
            let rest = &bytes[at.min(bytes.len())..];
            let Some(length) = rest.iter().take(MAX_HEADER).position(|&b| b == b'\n') else {
                return Err(wrong("truncated: the header ends without a line DATA").at_line(number + 1));
            };
            let line = rest[..length].trim_ascii();
            (at, number) = (at + length + 1, number + 1);
            if at > MAX_HEADER {
                return Err(wrong("the header is longer than 1 MiB").at_line(number));
            }
            let mut parts = words(line);
            let Some(keyword) = parts.next() else { continue };
            if keyword.starts_with(b"#") {
                continue;
            }
            let parts: Vec<&[u8]> = parts.collect();
            let here = |e: Error| e.at_line(number);
            if keyword == b"DATA" {
                let mut header = said.header(parts.first().copied().unwrap_or_default()).map_err(here)?;
                (header.body, header.lines) = (at, number);
                return Ok(header);
            }
            said.line(keyword, &parts).map_err(here)?;
        }
    }

    /// The number of points, if as many rows fit into so many bytes.
    pub fn rows(&self, bytes: usize) -> Result<usize, Error> {
        let needed = self.points.checked_mul(self.row as u64);
        match needed.filter(|n| *n <= bytes as u64) {
            Some(_) => Ok(self.points as usize),
            None => Err(Error::new(
                ErrorKind::Format,
                format!(
                    "truncated: {} points of {} bytes promised, {bytes} bytes are there",
                    self.points, self.row
                ),
            )
            .advise("fetch the file again")),
        }
    }
}

/// What the lines of a header have said so far: names, sizes, kinds and counts of the fields, and the rest.
#[derive(Default)]
struct Said {
    names: Vec<String>,
    sizes: Vec<usize>,
    kinds: Vec<u8>,
    counts: Vec<usize>,
    width: Option<u64>,
    height: Option<u64>,
    points: Option<u64>,
    viewpoint: Option<Vec<f64>>,
}

impl Said {
    /// Takes a line other than the last one, `DATA`.
    fn line(&mut self, keyword: &[u8], parts: &[&[u8]]) -> Result<(), Error> {
        let one = || whole(parts.first().copied().unwrap_or_default());
        match keyword {
            b"VERSION" => {}
            b"FIELDS" | b"COLUMNS" => {
                self.names = parts.iter().map(|p| String::from_utf8_lossy(p).into_owned()).collect();
            }
            b"SIZE" => {
                for word in parts {
                    let size = whole(word)?;
                    if ![1, 2, 4, 8].contains(&size) {
                        return Err(wrong(format!("numbers of {size} bytes are not known")));
                    }
                    self.sizes.push(size as usize);
                }
            }
            b"TYPE" => self.kinds = parts.iter().map(|p| p.first().copied().unwrap_or(b'?')).collect(),
            b"COUNT" => {
                for word in parts {
                    let count = whole(word)?;
                    if count == 0 || count > 1 << 16 {
                        return Err(wrong(format!("a field of {count} numbers is not possible")));
                    }
                    self.counts.push(count as usize);
                }
            }
            b"WIDTH" => self.width = Some(one()?),
            b"HEIGHT" => self.height = Some(one()?),
            b"POINTS" => self.points = Some(one()?),
            b"VIEWPOINT" => self.viewpoint = parts.iter().map(|p| float(p)).collect::<Option<Vec<f64>>>(),
            other => return Err(wrong(format!("{} is not a PCD header line", show(other)))),
        }
        Ok(())
    }

    /// The header, at its last line, which names how the data are stored; `body` and `lines` are still 0.
    fn header(self, data: &[u8]) -> Result<Header, Error> {
        let data = match data {
            w if w.eq_ignore_ascii_case(b"ascii") => Data::Ascii,
            w if w.eq_ignore_ascii_case(b"binary") => Data::Binary,
            w if w.eq_ignore_ascii_case(b"binary_compressed") => Data::Packed,
            w => return Err(wrong(format!("unknown data {}", show(w)))),
        };
        let area = self.width.and_then(|w| w.checked_mul(self.height.unwrap_or(1)));
        let Some(points) = self.points.or(area) else {
            return Err(wrong("neither POINTS nor WIDTH says how many points there are"));
        };
        if let Some(area) = area.filter(|area| *area != points) {
            return Err(wrong(format!("POINTS is {points}, but WIDTH times HEIGHT is {area}")));
        }
        let organised = self.height.is_some_and(|h| h > 1) && self.width.is_some_and(|w| w > 1);
        let viewpoint = self.viewpoint.clone();
        let (fields, row) = self.fields()?;
        Ok(Header { fields, points, organised, viewpoint, data, body: 0, lines: 0, row })
    }

    /// The fields, and the bytes of a point.
    fn fields(mut self) -> Result<(Vec<Field>, usize), Error> {
        let all = self.names.len();
        if self.counts.is_empty() {
            self.counts.resize(all, 1);
        }
        if all == 0 || [self.sizes.len(), self.kinds.len(), self.counts.len()].iter().any(|n| *n != all) {
            return Err(wrong("FIELDS, SIZE, TYPE and COUNT have not the same length"));
        }
        let (mut offset, mut word, mut fields) = (0, 0, Vec::new());
        for (i, name) in self.names.into_iter().enumerate() {
            let (size, kind, count) = (self.sizes[i], self.kinds[i].to_ascii_uppercase(), self.counts[i]);
            let number = match kind {
                b'F' if size == 4 => Some(NumberType::F32),
                b'F' if size == 8 => Some(NumberType::F64),
                b'I' | b'U' => NumberType::integer(size, kind == b'I'),
                // Fillers may have any type: they are not read, and only their size matters.
                _ if name == "_" => NumberType::integer(size, false),
                _ => None,
            };
            let Some(number) = number else {
                let kind = char::from(kind);
                return Err(wrong(format!("field {name} has the type {kind} of {size} bytes")));
            };
            fields.push(Field { name, number, count, offset, word });
            offset += size * count;
            word += count;
        }
        Ok((fields, offset))
    }
}

fn whole(word: &[u8]) -> Result<u64, Error> {
    let count = integer(word).and_then(|n| u64::try_from(n).ok());
    count.ok_or_else(|| wrong(format!("{} is not a count", show(word))))
}

/// The error for a file that is not as PCD files are.
pub(super) fn wrong(what: impl Into<String>) -> Error {
    Error::new(ErrorKind::Format, what).advise("the file is damaged or not PCD; export it again")
}
