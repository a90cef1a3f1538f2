//! Raw files: rows of little-endian floats and nothing else, as of the KITTI and nuScenes laser scans.
//!
//! The file does not say how long a row is. Rows of four 32-bit numbers (x, y, z, intensity, as KITTI has them) are
//! taken unless the bytes speak for another length; then the reader stops and says which.

use super::doubt::Evidence;
use super::number::{ByteOrder, NumberType};
use super::options::{Columns, RawLayout, ReadOptions};
use super::precision::check_point;
use super::{Loaded, Want};
use crate::{Error, ErrorKind};

/// What rows are taken for unless something speaks against it: x, y, z, intensity.
const KITTI: RawLayout = RawLayout { bytes: 4, columns: 4 };
/// The rows that files are found to have.
const KNOWN: [RawLayout; 7] = [
    RawLayout { bytes: 4, columns: 3 },
    KITTI,
    RawLayout { bytes: 4, columns: 5 },
    RawLayout { bytes: 4, columns: 6 },
    RawLayout { bytes: 4, columns: 7 },
    RawLayout { bytes: 8, columns: 3 },
    RawLayout { bytes: 8, columns: 4 },
];
/// Rows that are looked at.
const SAMPLE: usize = 4096;

/// Reads n x 3 points; the other columns are dropped.
pub(super) fn read(bytes: &[u8], options: &ReadOptions, want: Want) -> Result<Loaded, Error> {
    let mut loaded = Loaded::default();
    let raw = match options.raw {
        Some(raw) => raw,
        None if options.assume => KITTI,
        None => choose(bytes)?,
    };
    let row = raw.bytes * raw.columns;
    if !bytes.len().is_multiple_of(row) {
        return Err(Error::new(
            ErrorKind::Format,
            format!(
                "truncated: {} bytes are {} rows of {row} bytes and {} bytes more",
                bytes.len(),
                bytes.len() / row,
                bytes.len() % row
            ),
        )
        .advise(format!(
            "rows were taken to have {} numbers of {} bytes; give other rows as in --raw f32x5",
            raw.columns, raw.bytes
        )));
    }
    let columns = match &options.columns {
        Some(Columns::Numbers(numbers)) => numbers.map(|n| n - 1),
        Some(Columns::Names(_)) => {
            return Err(Error::new(ErrorKind::Format, "the columns of a raw file have no names")
                .advise("give their numbers, as in --columns 1,2,3"));
        }
        None => [0, 1, 2],
    };
    if let Some(beyond) = columns.iter().find(|c| **c >= raw.columns) {
        return Err(Error::new(
            ErrorKind::Format,
            format!("column {} is asked for, but rows have {}", beyond + 1, raw.columns),
        )
        .advise("give other --columns or other rows, as in --raw f32x5"));
    }
    let doubted = options.columns.is_none() && !options.assume;
    let mut evidence = Evidence::default();
    loaded.verts.reserve_exact(bytes.len() / row);
    for (i, row) in bytes.chunks_exact(row).enumerate() {
        if doubted && evidence.wants_more() {
            evidence.add((0..raw.columns).map(|c| number(row, raw, c)).map(|x| (x, x.fract() == 0.0)));
        }
        let point = columns.map(|c| number(row, raw, c));
        check_point(point, want, "point", i)?;
        loaded.verts.push(point);
    }
    if let Some(doubt) = doubted.then(|| evidence.doubt()).flatten() {
        return Err(doubt.error());
    }
    if columns == [0, 1, 2] && matches!(raw.columns, 4 | 5) {
        // The frame of KITTI and nuScenes is that of the scanner.
        loaded.viewpoints.push([0.0; 3]);
    }
    match raw.columns {
        3 => {}
        4 if columns == [0, 1, 2] => loaded.notices.push("ignored the intensity column".to_string()),
        n => loaded.notices.push(format!("ignored {} of {n} columns", n - 3)),
    }
    Ok(loaded)
}

fn number(row: &[u8], raw: RawLayout, column: usize) -> f64 {
    let number = if raw.bytes == 4 { NumberType::F32 } else { NumberType::F64 };
    number.read(&row[column * raw.bytes..], ByteOrder::Little)
}

/// The rows of KITTI, unless the bytes do not fit them or fit others better.
fn choose(bytes: &[u8]) -> Result<RawLayout, Error> {
    let mut fitting: Vec<(RawLayout, f64)> =
        KNOWN.into_iter().filter_map(|raw| Some((raw, spread(bytes, raw)?))).collect();
    // How much the spread of `rows` rows varies by chance, in logarithms: smaller differences decide nothing.
    let chance = |rows: usize| 0.02 + 1.0 / (rows.max(1) as f64).sqrt();
    // Two true rows read as one have the same spread: of a length and its double the shorter one is meant.
    let halves = |(raw, own): &(RawLayout, f64)| {
        let half = RawLayout { columns: raw.columns / 2, ..*raw };
        let least = own + chance(bytes.len() / (raw.bytes * raw.columns));
        raw.columns.is_multiple_of(2) && fitting.iter().any(|(r, s)| *r == half && *s <= least)
    };
    let doubled: Vec<RawLayout> = fitting.iter().filter(|f| halves(f)).map(|(r, _)| *r).collect();
    fitting.retain(|(r, _)| !doubled.contains(r));
    let kitti = fitting.iter().find(|(raw, _)| *raw == KITTI);
    let best = fitting.iter().min_by(|a, b| a.1.total_cmp(&b.1));
    let margin = chance(bytes.len() / 16);
    match (kitti, best) {
        (Some((_, own)), Some((_, least))) if *own <= *least && fitting.len() == 1 => Ok(KITTI),
        (Some((_, own)), Some(_)) if fitting.iter().all(|(r, s)| *r == KITTI || *s > own + margin) => Ok(KITTI),
        (_, None) => Err(Error::new(
            ErrorKind::Format,
            format!(
                "{} bytes are not rows of 3 to 7 floats with coordinates in front: numbers are not finite, or too \
                 large or small",
                bytes.len()
            ),
        )
        .advise("a raw file holds little-endian floats only; name its rows as in --raw f32x4, or its --format")),
        _ => {
            fitting.sort_by(|a, b| a.1.total_cmp(&b.1));
            let name = |(r, _): &(RawLayout, f64)| {
                let n = bytes.len() / (r.bytes * r.columns);
                format!("f32x{} ({n} points)", r.columns).replace("f32", if r.bytes == 8 { "f64" } else { "f32" })
            };
            let names: Vec<String> = fitting.iter().map(name).collect();
            Err(Error::new(
                ErrorKind::Format,
                format!(
                    "a raw file does not say how long its rows are, and these bytes fit best as {}",
                    names.join(", then ")
                ),
            )
            .advise(format!(
                "name the rows, as in --raw {}, or give --assume to read x, y, z, intensity as KITTI has them",
                names[0].split(' ').next().unwrap_or("f32x5")
            )))
        }
    }
}

/// How much the numbers spread within the columns, as the mean logarithm: least for the true length of rows, as other
/// lengths mix the columns. None if the bytes cannot be such rows.
fn spread(bytes: &[u8], raw: RawLayout) -> Option<f64> {
    let row = raw.bytes * raw.columns;
    if bytes.is_empty() || !bytes.len().is_multiple_of(row) {
        return None;
    }
    let step = (bytes.len() / row / SAMPLE).max(1);
    let (mut sums, mut squares, mut n) = (vec![0.0; raw.columns], vec![0.0; raw.columns], 0.0);
    for row in bytes.chunks_exact(row).step_by(step) {
        let values: Vec<f64> = (0..raw.columns).map(|c| number(row, raw, c)).collect();
        // A laser scan may have rows without a return.
        if values[..3].iter().all(|x| x.is_nan()) {
            continue;
        }
        let place = |x: &f64| *x == 0.0 || (1e-12..1e8).contains(&x.abs());
        if !values[..3].iter().all(place) {
            return None;
        }
        for (c, &x) in values.iter().enumerate() {
            let plain = x.is_nan() || place(&x);
            // Behind the coordinates come intensity, ring and time; or colours or a normal.
            let fits = match (raw.columns, c) {
                (_, 0..3) => true,
                (3..6, _) => plain && (x >= 0.0 || x.is_nan()),
                _ => plain,
            };
            if !fits {
                return None;
            }
            let x = if x.is_nan() { 0.0 } else { x };
            sums[c] += x;
            squares[c] += x * x;
        }
        n += 1.0;
    }
    if n == 0.0 {
        return None;
    }
    let total: f64 = squares.iter().sum::<f64>() / n;
    let logs = sums.iter().zip(&squares).map(|(s, q)| {
        let variance = (q / n - (s / n).powi(2)).max(0.0);
        // A constant column counts as a narrow one, not as an infinitely narrow one.
        0.5 * (variance + 1e-6 * total + f64::MIN_POSITIVE).ln()
    });
    Some(logs.sum::<f64>() / raw.columns as f64)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::AnalyticShape;

    fn scan(rows: &[[f32; 4]]) -> Vec<u8> {
        rows.iter().flatten().flat_map(|x| x.to_le_bytes()).collect()
    }

    fn plain(bytes: &[u8]) -> Result<Loaded, Error> {
        read(bytes, &ReadOptions::default(), Want::Cloud)
    }

    /// A number from 0 to 1 of no pattern.
    fn odd(i: usize, seed: usize) -> f32 {
        ((i * 31 + seed * 977).wrapping_mul(2_654_435_761) >> 8) as u16 as f32 / 65_536.0
    }

    /// Rows with what a laser scan has behind its coordinates.
    fn rows(columns: usize, n: usize) -> Vec<u8> {
        let points = AnalyticShape::Torus { major: 1.0, minor: 0.4 }.sample(n, 3).0;
        let more = |i: usize, c: usize| match (columns, c) {
            (4 | 5, 3) => odd(i, 1),
            (5, _) => (i % 32) as f32,
            (6, _) => 255.0 * odd(i, c),
            _ => odd(i, c),
        };
        points
            .iter()
            .enumerate()
            .flat_map(|(i, p)| (0..columns).map(move |c| if c < 3 { p[c] } else { more(i, c) }))
            .flat_map(f32::to_le_bytes)
            .collect()
    }

    #[test]
    fn reads_rows_and_drops_the_intensity() {
        let bytes = scan(&[[1.0, 2.0, 3.0, 0.5], [-4.0, 5.0, -6.0, f32::NAN]]);
        let loaded = read(&bytes, &ReadOptions { assume: true, ..Default::default() }, Want::Cloud).unwrap();
        assert_eq!(loaded.verts, [[1.0, 2.0, 3.0], [-4.0, 5.0, -6.0]]);
        assert_eq!(loaded.notices, ["ignored the intensity column"]);
    }

    #[test]
    fn rows_of_four_are_read_and_others_are_doubted() {
        for n in [60, 61, 63, 300, 1000, 3000] {
            let kitti = plain(&rows(4, n)).unwrap_or_else(|e| panic!("{n}: {e}"));
            assert_eq!(kitti.verts.len(), n);
            for (columns, name) in [(3, "f32x3"), (5, "f32x5"), (6, "f32x6")] {
                let bytes = rows(columns, n);
                let e = plain(&bytes).map(|l| l.verts.len()).unwrap_err().to_string();
                assert!(e.contains(&format!("best as {name} ({n} points)")) && e.contains("--raw"), "{e}");
                let options = ReadOptions { raw: Some(name.parse().unwrap()), ..Default::default() };
                assert_eq!(read(&bytes, &options, Want::Cloud).unwrap().verts.len(), n);
            }
        }
        let doubles: Vec<u8> = AnalyticShape::Sphere { radius: 1.0 }
            .sample(100, 1)
            .0
            .as_flattened()
            .iter()
            .flat_map(|x| f64::from(*x).mul_add(1.0 + 1e-12, 1e-9).to_le_bytes())
            .collect();
        let e = plain(&doubles).map(|l| l.verts.len()).unwrap_err().to_string();
        assert!(e.contains("f64x3 (100 points)"), "{e}");
        let options = ReadOptions { raw: Some("f64x3".parse().unwrap()), ..Default::default() };
        assert_eq!(read(&doubles, &options, Want::Cloud).unwrap().verts.len(), 100);
        let noise: Vec<u8> = (0..4800_usize).map(|i| (i * i * 7 + i / 3) as u8).collect();
        assert!(plain(&noise).map(|l| l.verts.len()).unwrap_err().to_string().contains("not rows of 3 to 7"));
    }

    #[test]
    fn columns_can_be_named_by_number() {
        let bytes = scan(&[[9.0, 1.0, 2.0, 3.0], [8.0, 4.0, 5.0, 6.0]]);
        let with = |columns: &str| {
            let columns = Some(columns.parse().unwrap());
            read(&bytes, &ReadOptions { columns, raw: Some(KITTI), ..Default::default() }, Want::Cloud)
        };
        assert_eq!(with("2,3,4").unwrap().verts, [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]);
        assert!(with("3,4,5").map(|l| l.verts).unwrap_err().to_string().contains("column 5"));
        assert!(with("x,y,z").map(|l| l.verts).unwrap_err().to_string().contains("no names"));
    }

    #[test]
    fn refuses_cut_rows() {
        let bytes = scan(&[[1.0, 2.0, 3.0, 0.5], [1.0, 2.0, 3.0, 0.5]]);
        let options = ReadOptions { assume: true, ..Default::default() };
        let e = read(&bytes[..17], &options, Want::Cloud).map(|l| l.verts).unwrap_err();
        assert!(e.to_string().contains("17 bytes are 1 rows of 16 bytes and 1 bytes more"), "{e}");
    }
}
