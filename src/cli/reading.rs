//! How the user says what a file does not: format, columns, rows.

use std::path::Path;

use bijective_sdf::io::{Columns, Format, RawLayout, ReadOptions};
use clap::Args;

use super::Common;
use super::failure::Failure;
use super::formats::format_parser;
use super::input::Input;

/// Options of every command that reads points.
#[derive(Clone, Debug, Args)]
pub struct ReadArgs {
    /// Format of the input [default: by content, and where that fits several, by extension]
    #[arg(long, value_parser = format_parser())]
    format: Option<Format>,
    /// Columns of x, y and z by number from 1, as in `2,3,4`, or by name, as in `E,N,Z` (text, raw, npy)
    #[arg(long, value_name = "X,Y,Z")]
    columns: Option<Columns>,
    /// What separates the columns of a text: comma, semicolon, tab, space, bar, or one character that
    /// numbers do not have [default: found out]
    #[arg(long, value_name = "CHAR", value_parser = delimiter)]
    delimiter: Option<u8>,
    /// Leave out the first lines of a text
    #[arg(long, value_name = "LINES", default_value_t = 0)]
    skip: usize,
    /// Rows of a raw file: type and count of its numbers, such as f32x4 (KITTI), f32x5 (nuScenes) or f64x3
    #[arg(long, value_name = "TYPExN")]
    raw: Option<RawLayout>,
    /// Read on where it is not certain which columns are coordinates, and keep points that look like fillers
    #[arg(long)]
    assume: bool,
}

fn delimiter(text: &str) -> Result<u8, String> {
    match (text, text.as_bytes()) {
        ("comma", _) => Ok(b','),
        ("semicolon", _) => Ok(b';'),
        ("tab" | "\\t", _) => Ok(b'\t'),
        ("space", _) => Ok(b' '),
        ("bar" | "pipe", _) => Ok(b'|'),
        (_, &[byte]) if !byte.is_ascii_alphanumeric() && !b".+-\"".contains(&byte) => Ok(byte),
        _ => {
            Err("expected comma, semicolon, tab, space, bar or one character that numbers do not have".into())
        }
    }
}

impl ReadArgs {
    /// Reads a file, or standard input.
    pub fn input<'a>(&self, path: &'a Path) -> Result<Input<'a>, Failure> {
        self.read(path, false, false)
    }

    /// Reads a file with what stands beside the coordinates of its points.
    pub fn with_attributes<'a>(&self, path: &'a Path) -> Result<Input<'a>, Failure> {
        self.read(path, false, true)
    }

    /// Reads a file of which every row must be a point, as results are printed beside them.
    pub fn rows<'a>(&self, path: &'a Path) -> Result<Input<'a>, Failure> {
        self.read(path, true, false)
    }

    fn read<'a>(&self, path: &'a Path, every_row: bool, attributes: bool) -> Result<Input<'a>, Failure> {
        let mut options = ReadOptions::default();
        options.format = self.format.or(self.raw.map(|_| Format::Raw));
        options.columns = self.columns.clone();
        options.delimiter = self.delimiter;
        options.skip = self.skip;
        options.raw = self.raw;
        options.assume = self.assume;
        options.every_row = every_row;
        options.attributes = attributes;
        Input::read_with(path, options)
    }
}

impl Common {
    /// Tells what the reader of a file has to say.
    pub fn tell(self, warnings: &[String], notices: &[String]) {
        warnings.iter().for_each(|w| self.warn(w));
        notices.iter().for_each(|n| self.note(n));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn delimiters_have_names() {
        for (text, byte) in
            [("comma", b','), ("tab", b'\t'), ("\\t", b'\t'), (";", b';'), (" ", b' '), ("|", b'|')]
        {
            assert_eq!(delimiter(text), Ok(byte));
        }
        for bad in ["", "ab", "1", ".", "-", "\"", "e"] {
            assert!(delimiter(bad).is_err(), "{bad}");
        }
    }
}
