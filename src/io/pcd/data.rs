//! The points of a PCD file: text, binary, or binary packed with LZF.

use super::super::number::{ByteOrder, unsigned};
use super::super::precision::check_point;
use super::super::text::{Lines, float, not_a_number, push_value, words};
use super::super::{Loaded, Want};
use super::header::{Header, wrong};
use super::lzf;
use crate::{Error, ErrorKind};

/// The fields that are read, by their numbers in the header.
pub(super) struct Places {
    pub point: [usize; 3],
    pub normal: Option<[usize; 3]>,
    /// Those of the attributes.
    pub more: Vec<usize>,
}

/// Reads points in text, one a line.
pub(super) fn text(
    header: &Header,
    body: &[u8],
    places: &Places,
    want: Want,
    loaded: &mut Loaded,
) -> Result<(), Error> {
    let mut found = 0;
    for (number, line) in Lines::after(body, header.lines) {
        if line.trim_ascii().is_empty() || line.trim_ascii().starts_with(b"#") {
            continue;
        }
        let at = |e: Error| e.at_line(number).at_element(format!("point {found}"));
        let parts: Vec<&[u8]> = words(line).collect();
        let value = |field: usize| {
            let word = parts.get(header.fields[field].word).copied().ok_or_else(|| {
                let all: usize = header.fields.iter().map(|f| f.count).sum();
                Error::new(ErrorKind::Format, format!("{all} numbers expected, {} found", parts.len()))
                    .advise("complete the line or delete it")
            })?;
            float(word).ok_or_else(|| not_a_number(word))
        };
        let mut position = [0.0; 3];
        for (to, field) in position.iter_mut().zip(places.point) {
            *to = value(field).map_err(at)?;
        }
        let normal = places.normal.map(|n| n.map(|field| value(field).unwrap_or(f64::NAN)));
        for (attribute, &field) in loaded.attributes.iter_mut().zip(&places.more) {
            push_value(attribute, value(field).unwrap_or(f64::NAN));
        }
        push(loaded, found, want, position, normal).map_err(|e| e.at_line(number))?;
        found += 1;
    }
    if found as u64 != header.points {
        let what = if (found as u64) < header.points { "the file may be cut short" } else { "all were read" };
        loaded
            .warnings
            .push(format!("the header promises {} points, {found} are there; {what}", header.points));
    }
    Ok(())
}

/// Where the values of binary data lie.
#[derive(Clone, Copy)]
pub(super) enum Order {
    /// All fields of a point together, point by point.
    Rows,
    /// All numbers of a field before those of the next.
    Columns,
}

/// Reads points in binary; behind the last one may be more bytes.
pub(super) fn binary(
    header: &Header,
    body: &[u8],
    order: Order,
    places: &Places,
    want: Want,
    loaded: &mut Loaded,
) -> Result<(), Error> {
    let rows = header.rows(body.len())?;
    // The columns of a packed file are as long as its data say, however many points the header promises.
    let whole = body.len() / header.row;
    let stride = if body.len() == whole * header.row { whole } else { rows };
    loaded.verts.reserve_exact(rows);
    for i in 0..rows {
        let value = |field: usize| {
            let field = &header.fields[field];
            let at = match order {
                Order::Rows => i * header.row + field.offset,
                Order::Columns => stride * field.offset + i * field.number.size() * field.count,
            };
            field.number.read(&body[at..], ByteOrder::Little)
        };
        for (attribute, &field) in loaded.attributes.iter_mut().zip(&places.more) {
            attribute.values.push(value(field));
        }
        push(loaded, i, want, places.point.map(value), places.normal.map(|n| n.map(value)))?;
    }
    let tail = body.len() - rows * header.row;
    if tail >= header.row {
        loaded.warn_of_rest("points", rows as u64, whole as u64);
    } else if tail > 0 {
        loaded.notices.push(format!("ignored {tail} bytes behind the last point"));
    }
    Ok(())
}

/// The columns of a packed file, one behind the other.
pub(super) fn unpack(header: &Header, body: &[u8]) -> Result<Vec<u8>, Error> {
    let size = |at: usize| unsigned(body, at, 4).map(|n| n as usize);
    let (Some(packed), Some(plain)) = (size(0), size(4)) else {
        return Err(wrong("truncated: the sizes of the packed data are missing"));
    };
    let Some(bytes) = body.get(8..).and_then(|b| b.get(..packed)) else {
        return Err(wrong(format!(
            "truncated: {packed} packed bytes promised, {} are there",
            body.len().saturating_sub(8)
        )));
    };
    let rows = header.rows(plain)?;
    let columns = if packed == 0 && plain == 0 { Some(Vec::new()) } else { lzf::unpack(bytes, plain) };
    let columns = columns.ok_or_else(|| wrong("the packed data are damaged"))?;
    debug_assert!(columns.len() >= rows * header.row);
    Ok(columns)
}

/// Adds a point with its normal.
fn push(
    loaded: &mut Loaded,
    index: usize,
    want: Want,
    point: [f64; 3],
    normal: Option<[f64; 3]>,
) -> Result<(), Error> {
    check_point(point, want, "point", index)?;
    loaded.verts.push(point);
    if let Some(normal) = normal {
        loaded.normals.push(normal.map(|x| x as f32));
    }
    Ok(())
}
