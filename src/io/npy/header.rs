//! The header of an NPY file: a Python dictionary with the type, the storage order and the shape of the array.

use super::super::number::{ByteOrder, NumberType};
use super::super::text::show;
use crate::{Error, ErrorKind};

/// What the header says.
pub(super) struct Header {
    pub fortran: bool,
    pub shape: Vec<u64>,
    /// One number without a name, or the named numbers of a row.
    pub fields: Vec<Field>,
    /// Bytes of an item, or of a row of fields.
    pub item: usize,
}

/// A number and its place in an item.
pub(super) struct Field {
    pub name: Option<String>,
    pub offset: usize,
    pub number: NumberType,
    order: ByteOrder,
}

impl Field {
    /// The number at the beginning of `bytes`.
    pub fn read(&self, bytes: &[u8]) -> f64 {
        self.number.read(bytes, self.order)
    }
}

impl Header {
    /// Reads the dictionary.
    pub fn parse(text: &str) -> Result<Header, Error> {
        let descr = value_of(text, "descr")?;
        let (fields, item) = if descr.starts_with('[') {
            structure(descr)?
        } else {
            let (number, order) = number_type(&quoted(descr).ok_or_else(|| odd_type(descr))?)?;
            (vec![Field { name: None, offset: 0, number, order }], number.size())
        };
        let fortran = match value_of(text, "fortran_order")? {
            v if v.starts_with("True") => true,
            v if v.starts_with("False") => false,
            v => {
                return Err(bad_header(format!(
                    "fortran_order is {}, not True or False",
                    show(v.as_bytes())
                )));
            }
        };
        let shape = shape(value_of(text, "shape")?)?;
        Ok(Header { fortran, shape, fields, item })
    }
}

/// What follows a key of the header.
fn value_of<'a>(header: &'a str, key: &str) -> Result<&'a str, Error> {
    let found = ['\'', '"'].iter().find_map(|q| header.split_once(&format!("{q}{key}{q}")));
    found
        .and_then(|(_, rest)| rest.trim_start().strip_prefix(':'))
        .map(str::trim_start)
        .ok_or_else(|| bad_header(format!("{key} is missing")))
}

/// The text in quotes that a value begins with.
fn quoted(value: &str) -> Option<String> {
    let quoted = ['\'', '"'].iter().find_map(|&q| value.strip_prefix(q)?.split_once(q));
    quoted.map(|(text, _)| text.to_string())
}

fn odd_type(value: &str) -> Error {
    bad_header(format!("descr is {}, neither one plain type nor a list of fields", show(value.as_bytes())))
        .advise("save an array of one number type, such as points.astype('float32')")
}

/// The fields of a row, as in `[('x', '<f4'), ('y', '<f4'), ('rgb', '|u1', (3,))]`.
fn structure(value: &str) -> Result<(Vec<Field>, usize), Error> {
    let mut fields = Vec::new();
    let mut offset = 0_usize;
    let mut rest = value;
    let end = |rest: &str| rest.trim_start().starts_with(']');
    rest = &rest[1..];
    while !end(rest) {
        let Some((_, inside)) = rest.split_once('(') else { return Err(odd_type(value)) };
        let name = quoted(inside.trim_start()).ok_or_else(|| odd_type(value))?;
        let behind = &inside.trim_start()[name.len() + 2..];
        let Some(behind) = behind.trim_start().strip_prefix(',').map(str::trim_start) else {
            return Err(odd_type(value));
        };
        let kind = quoted(behind).ok_or_else(|| odd_type(value))?;
        let behind = behind[kind.len() + 2..].trim_start();
        let mut count = 1_usize;
        rest = if let Some(behind) = behind.strip_prefix(')') {
            behind
        } else {
            let (sizes, behind) = behind
                .strip_prefix(',')
                .and_then(|b| b.trim_start().strip_prefix('('))
                .and_then(|b| b.split_once(')'))
                .ok_or_else(|| odd_type(value))?;
            for size in sizes.split(',').map(str::trim).filter(|s| !s.is_empty()) {
                count = size
                    .parse()
                    .ok()
                    .and_then(|n: usize| count.checked_mul(n))
                    .ok_or_else(|| odd_type(value))?;
            }
            behind.trim_start().strip_prefix(')').ok_or_else(|| odd_type(value))?
        };
        rest = rest.trim_start().strip_prefix(',').unwrap_or(rest);
        // Fields that are no numbers, such as names or fillers, are passed over.
        let number = number_type(&kind);
        let size = match &number {
            Ok((number, _)) => number.size(),
            Err(_) => void_size(&kind).ok_or_else(|| odd_type(value))?,
        };
        if let Ok((number, order)) = number
            && count == 1
        {
            fields.push(Field { name: Some(name), offset, number, order });
        }
        offset = size
            .checked_mul(count)
            .and_then(|bytes| offset.checked_add(bytes))
            .filter(|&all| all < 1 << 20)
            .ok_or_else(|| odd_type(value))?;
    }
    if fields.is_empty() {
        return Err(odd_type(value));
    }
    Ok((fields, offset))
}

/// The bytes of a type that is no number: void, bytes, text or truth values.
fn void_size(descr: &str) -> Option<usize> {
    let rest = descr.trim_start_matches(['<', '>', '=', '|']);
    let (kind, digits) = rest.split_at_checked(1)?;
    let size: usize = digits.parse().ok()?;
    match kind {
        "V" | "S" | "a" | "b" | "c" | "M" | "m" => Some(size),
        "U" => size.checked_mul(4),
        _ => None,
    }
}

/// The sizes in a shape such as `(100, 3)`.
fn shape(value: &str) -> Result<Vec<u64>, Error> {
    let wrong = |inside: &str| {
        Error::new(ErrorKind::Format, format!("the shape is {}", show(inside.as_bytes())))
            .at_element("NPY header")
            .advise("save an array of shape (n, 3), for example points.reshape(-1, 3)")
    };
    let Some((inside, _)) = value.strip_prefix('(').and_then(|v| v.split_once(')')) else {
        return Err(wrong(value));
    };
    let sizes = inside.split(',').map(str::trim).filter(|s| !s.is_empty());
    sizes
        .map(|s| s.trim_end_matches('L').parse().ok())
        .collect::<Option<Vec<u64>>>()
        .ok_or_else(|| wrong(value))
}

/// The type and the byte order that the text of a type such as `<f4` names.
fn number_type(descr: &str) -> Result<(NumberType, ByteOrder), Error> {
    let (order, rest) = match descr.as_bytes() {
        [b'>', rest @ ..] => (ByteOrder::Big, rest),
        [b'<' | b'=' | b'|', rest @ ..] | rest => (ByteOrder::Little, rest),
    };
    let number = match rest {
        b"f2" => Some(NumberType::F16),
        b"f4" => Some(NumberType::F32),
        b"f8" => Some(NumberType::F64),
        [kind @ (b'i' | b'u'), size @ (b'1' | b'2' | b'4' | b'8')] => {
            NumberType::integer(usize::from(size - b'0'), *kind == b'i')
        }
        _ => None,
    };
    number.map(|number| (number, order)).ok_or_else(|| {
        Error::new(ErrorKind::Format, format!("numbers of type {} are not supported", show(descr.as_bytes())))
            .at_element("NPY header")
            .advise("save floats or integers of at most 64 bits, for example points.astype('float32')")
    })
}

/// The error for a header that cannot be used.
pub(super) fn bad_header(what: String) -> Error {
    Error::new(ErrorKind::Format, what)
        .at_element("NPY header")
        .advise("write it with numpy.save(path, points)")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_of_fields_have_their_places() {
        let text = "{'descr': [('x', '<f4'), ('', '|V4'), ('rgb', '|u1', (3,)), ('y', '>f8'), ('tag', '<U2')], \
                    'fortran_order': False, 'shape': (5,), }";
        let header = Header::parse(text).unwrap();
        let places: Vec<_> = header.fields.iter().map(|f| (f.name.as_deref().unwrap(), f.offset)).collect();
        assert_eq!((places, header.item), (vec![("x", 0), ("y", 11)], 27));
        for bad in
            ["[]", "[('x')]", "[('x', 'O')]", "[('x', '<f4', (999999999999,))]", "[('x', '<f4'", "['x'"]
        {
            let text = format!("{{'descr': {bad}, 'fortran_order': False, 'shape': (5,)}}");
            assert!(Header::parse(&text).is_err(), "{bad}");
        }
    }
}
