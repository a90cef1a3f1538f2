//! How the columns of a text are separated and its numbers are written.

use super::super::text::{float, words};

/// What stands between two columns.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Delimiter {
    /// Any run of white space.
    White,
    /// One byte; two in a row have an empty column between them.
    Byte(u8),
}

/// Delimiter and decimal sign.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Dialect {
    pub delimiter: Delimiter,
    pub decimal_comma: bool,
}

impl Dialect {
    /// The dialect of a line, of which only the delimiter may be known.
    ///
    /// A comma is a decimal sign only where something else separates the columns: between digits and beside
    /// semicolons, tabs or spaces, as in `1,5;2,5;3,5`.
    pub fn of(line: &[u8], known: Option<u8>) -> Dialect {
        let known = known.map(|b| if b == b' ' { Delimiter::White } else { Delimiter::Byte(b) });
        let delimiter = known.unwrap_or_else(|| delimiter_of(line));
        let mut fields = Vec::new();
        let dialect = Dialect { delimiter, decimal_comma: false };
        dialect.split(line, &mut fields);
        let with_comma = fields.iter().filter(|f| f.contains(&b',')).count();
        // Between commas, a column with a comma stands in quotes.
        let decimal_comma =
            with_comma > 0 && fields.iter().filter(|f| f.contains(&b',')).all(|f| is_decimal_comma(f));
        Dialect { delimiter, decimal_comma }
    }

    /// Whether commas separate the columns.
    pub fn is_comma(&self) -> bool {
        self.delimiter == Delimiter::Byte(b',')
    }

    /// Cuts a line into its columns, without white space and quotes around them. A delimiter at the end of the line
    /// has no column behind it.
    pub fn split<'a>(&self, line: &'a [u8], fields: &mut Vec<&'a [u8]>) {
        fields.clear();
        let Delimiter::Byte(delimiter) = self.delimiter else {
            return fields.extend(words(line).map(unquoted));
        };
        let (mut start, mut quoted) = (0, false);
        for (i, &b) in line.iter().enumerate() {
            quoted ^= b == b'"';
            if b == delimiter && !quoted {
                fields.push(unquoted(&line[start..i]));
                start = i + 1;
            }
        }
        if !line[start..].trim_ascii().is_empty() {
            fields.push(unquoted(&line[start..]));
        }
    }

    /// The number of columns of a line, the empty one behind a delimiter at its end included.
    pub fn columns(&self, line: &[u8]) -> usize {
        let mut fields = Vec::new();
        self.split(line, &mut fields);
        fields.len() + usize::from(self.ends_open(line))
    }

    /// Whether a line ends with a delimiter, so that the column behind it is empty.
    pub fn ends_open(&self, line: &[u8]) -> bool {
        matches!(self.delimiter, Delimiter::Byte(b) if line.last() == Some(&b))
    }

    /// The number in a column; NaN where the column says that there is none.
    pub fn number(&self, field: &[u8]) -> Option<f64> {
        if self.decimal_comma && field.contains(&b',') {
            let point: Vec<u8> = field.iter().map(|&b| if b == b',' { b'.' } else { b }).collect();
            return float(&point).filter(|_| is_decimal_comma(field));
        }
        float(field).or_else(|| is_missing(field).then_some(f64::NAN))
    }
}

/// Whether a column says that there is no value, in the words of common programs.
fn is_missing(field: &[u8]) -> bool {
    let is = |w: &&[u8]| field.eq_ignore_ascii_case(w);
    field.is_empty()
        || [&b"na"[..], b"n/a", b"null", b"none", b"-", b"--", b"<na>"].iter().any(is)
        || is_error_of_a_spreadsheet(field)
}

/// Whether a column holds what spreadsheets write for a value that they could not compute.
pub(super) fn is_error_of_a_spreadsheet(field: &[u8]) -> bool {
    [&b"#n/a"[..], b"#value!", b"#ref!", b"#div/0!", b"#num!", b"#name?", b"#null!"]
        .iter()
        .any(|w| field.eq_ignore_ascii_case(w))
}

/// Digits with one comma among them, as in `-1,25e-3`.
fn is_decimal_comma(field: &[u8]) -> bool {
    let Some(at) = field.iter().position(|&b| b == b',') else { return false };
    let digit = |b: Option<&u8>| b.is_some_and(u8::is_ascii_digit);
    let rest = &field[at + 1..];
    digit(rest.first())
        && !rest.contains(&b',')
        && !field.contains(&b'.')
        && field[..at].iter().all(|b| b.is_ascii_digit() || b"+-".contains(b))
}

fn delimiter_of(line: &[u8]) -> Delimiter {
    if line.contains(&b';') {
        return Delimiter::Byte(b';');
    }
    if line.split(|&b| b == b'|').count() > 2 {
        return Delimiter::Byte(b'|');
    }
    if line.contains(&b'\t') {
        // Tabs between columns that are all filled; else they are mere white space.
        let columns: Vec<&[u8]> = line.split(|&b| b == b'\t').map(<[u8]>::trim_ascii).collect();
        let whole = |c: &&[u8]| !c.is_empty() && (!c.contains(&b' ') || !starts_like_number(c));
        let filled = columns.len() > 2 && columns[..columns.len() - 1].iter().all(whole);
        if filled && !columns.iter().any(|c| c.ends_with(b",")) {
            return Delimiter::Byte(b'\t');
        }
    }
    if line.contains(&b',') {
        let mut all = words(line).peekable();
        let separate =
            all.peek().is_some() && all.all(|w| !w.contains(&b',') || is_decimal_comma(unquoted(w)));
        let count = words(line).filter(|w| w.contains(&b',')).count();
        // `1,5 2,5 3,5`: read with commas between, one column would be `5 2`.
        return if separate && count > 1 && words(line).count() > 2 {
            Delimiter::White
        } else {
            Delimiter::Byte(b',')
        };
    }
    Delimiter::White
}

fn starts_like_number(field: &[u8]) -> bool {
    words(field).next().is_some_and(|w| float(w).is_some())
}

/// Without white space and double quotes around.
pub(super) fn unquoted(field: &[u8]) -> &[u8] {
    let field = field.trim_ascii();
    field.strip_prefix(b"\"").and_then(|f| f.strip_suffix(b"\"")).map_or(field, <[u8]>::trim_ascii)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_dialect_of_a_line() {
        let cases: [(&str, Delimiter, bool); 16] = [
            ("1 2 3", Delimiter::White, false),
            ("1,2,3", Delimiter::Byte(b','), false),
            ("1, 2, 3", Delimiter::Byte(b','), false),
            ("1,5;2,5;3,5", Delimiter::Byte(b';'), true),
            ("1,5\t2,5\t3", Delimiter::Byte(b'\t'), true),
            ("1,5 2,5 -3,5e-2", Delimiter::White, true),
            ("1.5;2,5;3", Delimiter::Byte(b';'), true),
            ("1\t\t2\t\t3", Delimiter::White, false),
            ("1\t2\t3\t", Delimiter::Byte(b'\t'), false),
            ("1 2\t3 4", Delimiter::White, false),
            ("a,b,c", Delimiter::Byte(b','), false),
            ("1|2|3", Delimiter::Byte(b'|'), false),
            ("\"1,5\",\"2,5\",3", Delimiter::Byte(b','), true),
            ("1,5|2,5|3,5", Delimiter::Byte(b'|'), true),
            ("1,5 2.5 3.5", Delimiter::Byte(b','), false),
            ("1,\t2,\t3", Delimiter::Byte(b','), false),
        ];
        for (line, delimiter, decimal_comma) in cases {
            assert_eq!(Dialect::of(line.as_bytes(), None), Dialect { delimiter, decimal_comma }, "{line}");
        }
        assert_eq!(Dialect::of(b"1 2 3", Some(b',')).delimiter, Delimiter::Byte(b','));
        assert!(Dialect::of(b"1,5 2,5 3,5", Some(b' ')).decimal_comma);
    }

    #[test]
    fn quotes_hold_delimiters_and_numbers_have_their_sign() {
        let commas = Dialect::of(b"1,2", None);
        let mut fields = Vec::new();
        commas.split(b"\"Smith, J\", 1 ,,\"2\",", &mut fields);
        assert_eq!(fields, [&b"Smith, J"[..], b"1", b"", b"2"]);
        assert!(commas.number(b"").unwrap().is_nan() && commas.number(b"N/A").unwrap().is_nan());
        assert_eq!(commas.number(b"x"), None);
        let german = Dialect::of(b"1,5;2,5;3,5", None);
        assert_eq!(german.number(b"-1,25e2"), Some(-125.0));
        assert_eq!(german.number(b"1.5"), Some(1.5));
        assert_eq!(german.number(b"1,5,2"), None);
        assert_eq!(german.number(b"1.234,5"), None);
    }
}
