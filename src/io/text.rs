//! Lines, words and numbers of text files; every text format reads through these.

use std::io::{self, Write};

use super::encoding::Width;
use crate::geometry::{Attribute, Number};
use crate::{Error, ErrorKind};

/// The lines of a text with their numbers from 1. A line ends at `\n`, `\r\n` or a lone `\r`.
pub(super) struct Lines<'a> {
    rest: &'a [u8],
    number: u64,
}

impl<'a> Lines<'a> {
    pub(super) fn new(bytes: &'a [u8]) -> Self {
        Lines { rest: bytes, number: 0 }
    }

    /// Counts on from `number` lines that were read before.
    pub(super) fn after(bytes: &'a [u8], number: u64) -> Self {
        Lines { rest: bytes, number }
    }
}

impl<'a> Iterator for Lines<'a> {
    type Item = (u64, &'a [u8]);

    fn next(&mut self) -> Option<Self::Item> {
        if self.rest.is_empty() {
            return None;
        }
        self.number += 1;
        let end = self.rest.iter().position(|&b| b == b'\n' || b == b'\r').unwrap_or(self.rest.len());
        let line = &self.rest[..end];
        let pair = self.rest[end..].starts_with(b"\r\n");
        self.rest = &self.rest[(end + 1 + usize::from(pair)).min(self.rest.len())..];
        Some((self.number, line))
    }
}

/// The parts of a line between runs of white space.
pub(super) fn words(line: &[u8]) -> impl Iterator<Item = &[u8]> + Clone {
    line.split(u8::is_ascii_whitespace).filter(|w| !w.is_empty())
}

/// A number, also with the exponent `D` of Fortran, and the ways in which programs print that there is none.
pub(super) fn float(word: &[u8]) -> Option<f64> {
    let text = std::str::from_utf8(word).ok()?;
    if let Ok(number) = text.parse() {
        return Some(number);
    }
    let lower = text.to_ascii_lowercase();
    let bare = lower.trim_start_matches(['+', '-']);
    if bare.starts_with("nan(") || bare.starts_with("1.#") {
        return Some(f64::NAN);
    }
    let (digits, exponent) = lower.split_once('d')?;
    format!("{digits}e{exponent}")
        .parse()
        .ok()
        .filter(|_| digits.ends_with(|c: char| c.is_ascii_digit() || c == '.'))
}

/// A whole number.
pub(super) fn integer(word: &[u8]) -> Option<i64> {
    std::str::from_utf8(word).ok()?.parse().ok()
}

/// A word of a file made fit for a one-line message: quoted, escaped and cut.
pub(super) fn show(word: &[u8]) -> String {
    let cut = &word[..word.len().min(32)];
    let dots = if cut.len() < word.len() { "..." } else { "" };
    format!("{:?}{dots}", String::from_utf8_lossy(cut))
}

/// Three numbers from the first three words, or what is wrong with them.
pub(super) fn three_floats<'a>(words: impl Iterator<Item = &'a [u8]>) -> Result<[f64; 3], Error> {
    let mut point = [0.0; 3];
    let mut found = 0;
    for word in words.take(3) {
        point[found] = float(word).ok_or_else(|| not_a_number(word))?;
        found += 1;
    }
    if found < 3 {
        return Err(Error::new(ErrorKind::Format, format!("3 numbers expected, {found} found"))
            .advise("complete the line or delete it"));
    }
    Ok(point)
}

/// The error for a word that should have been a number.
pub(super) fn not_a_number(word: &[u8]) -> Error {
    Error::new(ErrorKind::Format, format!("{} is not a number", show(word)))
        .advise("write numbers with a decimal point, such as -1.25e-3")
}

/// Adds a value that stands in a text to an attribute whose type the header of the file declares. For a float of 32
/// bits the value is rounded to it. If a value is not finite, as that of a word that is no number, an attribute of
/// integers becomes one of 64-bit floats, as only floats can say that there is no value.
pub(super) fn push_value(attribute: &mut Attribute, value: f64) {
    if !value.is_finite() && attribute.number != Number::F32 {
        attribute.number = Number::F64;
    }
    let narrow = attribute.number == Number::F32;
    attribute.values.push(if narrow { f64::from(value as f32) } else { value });
}

/// Leaves out the byte order mark of UTF-8 and refuses UTF-16, which would read as rubbish.
pub(super) fn without_byte_order_mark(bytes: &[u8]) -> Result<&[u8], Error> {
    // Without a mark, every second byte of plain characters is 0.
    let zeros = matches!(bytes, [a, 0, b, 0, ..] if *a > 0 && *b > 0);
    if zeros || bytes.starts_with(b"\xff\xfe") || bytes.starts_with(b"\xfe\xff") {
        return Err(Error::new(ErrorKind::Format, "the text is encoded as UTF-16")
            .advise("save it as UTF-8 or plain ASCII"));
    }
    Ok(bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes))
}

/// Writes the shortest digits that read back as the same `f32`, with an exponent where plain digits get long.
pub(super) fn write_float(out: &mut dyn Write, x: f32) -> io::Result<()> {
    let size = x.abs();
    if size == 0.0 || (1e-5..1e9).contains(&size) { write!(out, "{x}") } else { write!(out, "{x:e}") }
}

/// Writes the shortest digits that read back as the same `f64`, with an exponent where plain digits get long.
pub(super) fn write_double(out: &mut dyn Write, x: f64) -> io::Result<()> {
    let size = x.abs();
    if size == 0.0 || (1e-5..1e16).contains(&size) { write!(out, "{x}") } else { write!(out, "{x:e}") }
}

/// Writes x, y, z with `separator` between them, in digits of 32 or 64 bits.
pub(super) fn write_position(
    out: &mut dyn Write,
    p: [f64; 3],
    width: Width,
    separator: &str,
) -> io::Result<()> {
    for (axis, x) in p.into_iter().enumerate() {
        if axis > 0 {
            out.write_all(separator.as_bytes())?;
        }
        match width {
            Width::Single => write_float(out, x as f32)?,
            Width::Double => write_double(out, x)?,
        }
    }
    Ok(())
}

/// Writes x, y, z with `separator` between them.
pub(super) fn write_floats(out: &mut dyn Write, p: [f32; 3], separator: &str) -> io::Result<()> {
    write_position(out, p.map(f64::from), Width::Single, separator)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn lines_end_at_any_of_the_three_endings() {
        let lines: Vec<_> = Lines::new(b"a\nb\r\nc\rd\n\n e").collect();
        let expected: [(u64, &[u8]); 6] = [(1, b"a"), (2, b"b"), (3, b"c"), (4, b"d"), (5, b""), (6, b" e")];
        assert_eq!(lines, expected);
        assert_eq!(Lines::new(b"").count(), 0);
        assert_eq!(Lines::new(b"\r\n").count(), 1);
    }

    #[test]
    fn numbers_of_many_programs_are_read() {
        for (word, number) in
            [("1.5", 1.5), ("+.5", 0.5), ("1.5D+02", 150.0), ("-2.d-1", -0.2), ("1e400", f64::INFINITY)]
        {
            assert_eq!(float(word.as_bytes()), Some(number), "{word}");
        }
        for word in ["nan", "-NaN", "nan(ind)", "-nan(snan)", "1.#QNAN", "-1.#IND00"] {
            assert!(float(word.as_bytes()).unwrap().is_nan(), "{word}");
        }
        for word in ["", "d", "d5", "abcd3", "1.5.2", "1,5", "0x10", "--1"] {
            assert_eq!(float(word.as_bytes()), None, "{word}");
        }
    }

    #[test]
    fn values_have_the_type_of_their_attribute() {
        let pushed = |number, values: &[f64]| {
            let mut attribute = Attribute { name: "a".into(), number, values: Vec::new() };
            values.iter().for_each(|&x| push_value(&mut attribute, x));
            (attribute.number, attribute.values)
        };
        assert_eq!(pushed(Number::U8, &[7.0, 8.0]), (Number::U8, vec![7.0, 8.0]));
        assert_eq!(pushed(Number::F32, &[0.1]), (Number::F32, vec![f64::from(0.1_f32)]));
        let (number, values) = pushed(Number::I16, &[7.0, f64::NAN, 9.0]);
        assert!(number == Number::F64 && values[0] == 7.0 && values[1].is_nan() && values[2] == 9.0);
        assert_eq!(pushed(Number::F32, &[f64::INFINITY]).0, Number::F32);
    }

    #[test]
    fn shown_words_stay_on_one_line() {
        assert_eq!(show(b"a\nb"), "\"a\\nb\"");
        assert!(show(&[0xff; 100]).ends_with("..."));
    }

    #[test]
    fn long_numbers_get_an_exponent() {
        let text = |x| {
            let mut out = Vec::new();
            write_float(&mut out, x).unwrap();
            String::from_utf8(out).unwrap()
        };
        assert_eq!(text(0.1), "0.1");
        assert_eq!(text(-0.0), "-0");
        assert_eq!(text(1e30), "1e30");
        assert_eq!(text(f32::MIN_POSITIVE), "1.1754944e-38");
    }

    proptest! {
        #[test]
        fn written_floats_read_back_to_the_bit(bits: u32) {
            let x = f32::from_bits(bits);
            prop_assume!(x.is_finite());
            let mut out = Vec::new();
            write_float(&mut out, x).unwrap();
            prop_assert_eq!((float(&out).unwrap() as f32).to_bits(), bits);
        }
    }
}
