//! What a reader is told when name and content of a file do not say enough.

use std::str::FromStr;

use super::Format;
use crate::{Error, ErrorKind};

/// How to read the points of a file.
///
/// The default reads what is certain, leaves out rows that hold no point (and says so), and stops where it cannot
/// know which numbers are the coordinates.
///
/// ```
/// use bijective_sdf::io::{ReadOptions, read_cloud_with};
///
/// let survey = b"1,10.5,20.5,3.5\n2,11.5,20.5,3.25\n3,10.5,21.5,3\n4,11,21,4\n";
/// assert!(read_cloud_with(survey, &ReadOptions::default()).is_err(), "column 1 may be a point number");
/// let mut options = ReadOptions::default();
/// options.columns = Some("2,3,4".parse()?);
/// let cloud = read_cloud_with(survey, &options)?;
/// assert_eq!(cloud.points[0], [10.5, 20.5, 3.5]);
/// # Ok::<(), bijective_sdf::Error>(())
/// ```
#[derive(Clone, Debug, Default, PartialEq)]
#[non_exhaustive]
pub struct ReadOptions {
    /// The format, whatever name and content of the file say.
    pub format: Option<Format>,
    /// The format that the file's name means. It decides only where the content fits several formats, or none.
    pub hint: Option<Format>,
    /// Which columns hold x, y and z, for text, raw and NumPy files.
    pub columns: Option<Columns>,
    /// The byte between the columns of a text; a space stands for any run of white space.
    pub delimiter: Option<u8>,
    /// Lines at the beginning of a text that are not read.
    pub skip: usize,
    /// How the rows of a raw file are built.
    pub raw: Option<RawLayout>,
    /// Reads on where the reader would stop because it doubts which numbers are coordinates, and keeps points that
    /// look like fillers.
    pub assume: bool,
    /// Every row must hold a point: rows that are not finite are errors, and no row is left out.
    pub every_row: bool,
    /// Reads what stands beside the coordinates of each point, too, into
    /// [`PointCloud::attributes`](super::PointCloud::attributes).
    pub attributes: bool,
}

/// The columns of x, y and z.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Columns {
    /// Their numbers, counted from 1.
    Numbers([usize; 3]),
    /// Their names in the header, in any letter case.
    Names([String; 3]),
}

impl FromStr for Columns {
    type Err = Error;

    /// Three numbers such as `2,3,4`, or three names such as `E,N,Z`.
    ///
    /// # Errors
    ///
    /// [`ErrorKind::Config`] unless there are three different ones, and numbers count from 1.
    fn from_str(text: &str) -> Result<Columns, Error> {
        let wrong = || {
            Error::new(ErrorKind::Config, format!("{text:?} does not name three different columns"))
                .advise("give numbers from 1, as in 2,3,4, or names, as in E,N,Z")
        };
        let parts: Vec<&str> = text.split(',').map(str::trim).collect();
        let [a, b, c] = parts[..] else { return Err(wrong()) };
        if a == b || b == c || a == c || parts.iter().any(|p| p.is_empty()) {
            return Err(wrong());
        }
        let numbers: Vec<usize> = parts.iter().filter_map(|p| p.parse().ok()).collect();
        match numbers[..] {
            [i, j, k] if i > 0 && j > 0 && k > 0 && i != j && j != k && i != k => {
                Ok(Columns::Numbers([i, j, k]))
            }
            [_, _, _] => Err(wrong()),
            _ => Ok(Columns::Names([a, b, c].map(str::to_string))),
        }
    }
}

/// How the rows of a raw file are built: little-endian numbers without any header.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RawLayout {
    /// Bytes of a number: 4 or 8.
    pub bytes: usize,
    /// Numbers in a row.
    pub columns: usize,
}

impl FromStr for RawLayout {
    type Err = Error;

    /// Such as `f32x4` (KITTI), `f32x5` (nuScenes) or `f64x3`.
    ///
    /// # Errors
    ///
    /// [`ErrorKind::Config`] for anything else.
    fn from_str(text: &str) -> Result<RawLayout, Error> {
        let bytes = [("f32x", 4), ("f64x", 8)];
        bytes
            .iter()
            .find_map(|(prefix, bytes)| {
                let columns = text.strip_prefix(prefix)?.parse().ok()?;
                (3..=64).contains(&columns).then_some(RawLayout { bytes: *bytes, columns })
            })
            .ok_or_else(|| {
                Error::new(ErrorKind::Config, format!("{text:?} does not describe the rows of a raw file"))
                    .advise("give number type and numbers in a row, as in f32x4, f32x3 or f64x3")
            })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_and_rows_are_parsed() {
        assert_eq!("2,3,4".parse::<Columns>().unwrap(), Columns::Numbers([2, 3, 4]));
        assert_eq!(" E, N ,Z".parse::<Columns>().unwrap(), Columns::Names(["E", "N", "Z"].map(String::from)));
        for bad in ["", "1,2", "1,2,2", "0,1,2", "1,2,3,4", "x,,z", "2,02,3"] {
            assert_eq!(bad.parse::<Columns>().unwrap_err().kind(), ErrorKind::Config, "{bad}");
        }
        assert_eq!("f32x5".parse::<RawLayout>().unwrap(), RawLayout { bytes: 4, columns: 5 });
        assert_eq!("f64x3".parse::<RawLayout>().unwrap(), RawLayout { bytes: 8, columns: 3 });
        for bad in ["", "f32", "f32x2", "f16x3", "f32x65", "f32x-3"] {
            assert_eq!(bad.parse::<RawLayout>().unwrap_err().kind(), ErrorKind::Config, "{bad}");
        }
    }
}
