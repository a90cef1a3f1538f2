//! NPY, the file format of one NumPy array, versions 1 to 3.
//!
//! The array is n rows of 3 or more columns of real numbers in either byte order and either storage order; or 3 rows of
//! n columns, an image of points (height, width, 3), or rows with named fields x, y and z.

use super::doubt::{Doubt, Evidence};
use super::number::{NumberType, unsigned};
use super::options::ReadOptions;
use super::precision::check_point;
use super::{Loaded, MAX_ATTRIBUTES, Want};
use crate::geometry::{Attribute, COLOUR};
use crate::{Error, ErrorKind};

mod header;
mod layout;

use header::{Header, bad_header};
use layout::{ArrayLayout, MAX_COLUMNS};

const MAGIC: &[u8] = b"\x93NUMPY";

/// Whether the bytes begin like an NPY file.
pub(super) fn looks_like_npy(bytes: &[u8]) -> bool {
    bytes.starts_with(MAGIC)
}

/// Reads n x 3 points.
pub(super) fn read(bytes: &[u8], options: &ReadOptions, want: Want) -> Result<Loaded, Error> {
    let (header, data) = split(bytes)?;
    let header = Header::parse(header)?;
    let mut loaded = Loaded::default();
    let layout = ArrayLayout::of(&header, options, &mut loaded)?;

    let promised = header.shape.iter().try_fold(1_u64, |all, n| all.checked_mul(*n));
    let needed = promised.and_then(|n| n.checked_mul(header.item as u64));
    let Some(needed) = needed.filter(|&b| b <= data.len() as u64) else {
        let sizes: Vec<String> = header.shape.iter().map(u64::to_string).collect();
        return Err(Error::new(
            ErrorKind::Format,
            format!(
                "truncated: {} numbers of {} bytes promised, {} bytes are there",
                sizes.join(" x "),
                header.item,
                data.len()
            ),
        )
        .advise("fetch the file again"));
    };
    // All sizes fit in memory from here on: there are at least 3 bytes for each point.
    let doubted = layout.guessed && options.columns.is_none() && !options.assume;
    if doubted && layout.columns > MAX_COLUMNS {
        return Err(Doubt::of_width(layout.columns).error());
    }
    let mut evidence = Evidence::default();
    loaded.verts.reserve_exact(layout.points);
    let more = if want == Want::Attributes { layout.others(&header) } else { Vec::new() };
    loaded.attributes = more
        .iter()
        .map(|&(column, field)| {
            let field = &header.fields[field];
            let name = field.name.clone().unwrap_or_else(|| format!("column_{}", column + 1));
            Attribute { name, number: field.number.kept_as(), values: Vec::with_capacity(layout.points) }
        })
        .collect();
    for i in 0..layout.points {
        if doubted && evidence.wants_more() {
            let all =
                (0..layout.columns).map(|c| header.fields[0].read(&data[layout.at(i, c) * header.item..]));
            evidence.add(all.map(|x| (x, x.fract() == 0.0)));
        }
        let mut point = [0.0; 3];
        for (axis, value) in point.iter_mut().enumerate() {
            let field = &header.fields[layout.field[axis]];
            *value = field.read(&data[layout.at(i, layout.column[axis]) * header.item + field.offset..]);
        }
        check_point(point, want, "point", i)?;
        loaded.verts.push(point);
        for (attribute, &(column, field)) in loaded.attributes.iter_mut().zip(&more) {
            let field = &header.fields[field];
            attribute.values.push(field.read(&data[layout.at(i, column) * header.item + field.offset..]));
        }
    }
    if let Some(doubt) = doubted.then(|| evidence.doubt()).flatten() {
        return Err(doubt.error());
    }

    let named = header.fields.len() > 1;
    let noun = if named { "field" } else { "column" };
    match layout.columns.max(header.fields.len()).saturating_sub(3 + more.len()) {
        0 => {}
        1 => loaded.notices.push(format!("ignored 1 extra {noun}")),
        extra => loaded.notices.push(format!("ignored {extra} extra {noun}s")),
    }
    let (tail, row) = (data.len() as u64 - needed, (layout.columns * header.item) as u64);
    let points = layout.points as u64;
    if tail >= row && row > 0 {
        loaded.warn_of_rest("points", points, points.saturating_add(tail / row));
    } else if tail > 0 {
        loaded.notices.push(format!("ignored {tail} bytes behind the array"));
    }
    Ok(loaded)
}

/// Whether an array has the shape n x 3 of points, and then whether its numbers are floats.
pub(super) fn floats_of_points(bytes: &[u8]) -> Option<bool> {
    let header = Header::parse(split(bytes).ok()?.0).ok()?;
    let plain = matches!(header.shape[..], [_, 3]) && header.fields.len() == 1;
    plain.then(|| matches!(header.fields[0].number, NumberType::F16 | NumberType::F32 | NumberType::F64))
}

/// The columns of an array of values other than points, as attributes named after the array: `name`, or `name_1`,
/// `name_2`, ... if there are several (`red`, `green`, `blue` for three of a colour), or `name.field`.
///
/// # Errors
///
/// As [`read`]; for an array of one axis or two only, of at most 64 columns.
pub(super) fn columns(bytes: &[u8], name: &str) -> Result<Vec<Attribute>, Error> {
    let (header, data) = split(bytes)?;
    let header = Header::parse(header)?;
    let (rows, width) = match header.shape[..] {
        [rows] => (rows, 1),
        [rows, width] => (rows, width),
        _ => return Err(bad_header("neither one axis nor two".to_string())),
    };
    let needed = rows.checked_mul(width).and_then(|n| n.checked_mul(header.item as u64));
    let held = needed.is_some_and(|bytes| bytes <= data.len() as u64);
    if !held || (width as usize).saturating_mul(header.fields.len()) > MAX_ATTRIBUTES {
        return Err(bad_header("cut short, or of very many columns".to_string()));
    }
    let (rows, width) = (rows as usize, width as usize);
    let colour = width == 3 && ["rgb", "color", "colors", "colour", "colours"].contains(&name);
    let parts: &[&str] = if colour { &COLOUR } else { &[] };
    let mut all = Vec::new();
    for column in 0..width {
        for field in &header.fields {
            let at = |row: usize| if header.fortran { column * rows + row } else { row * width + column };
            let value = |row: usize| field.read(&data[at(row) * header.item + field.offset..]);
            let name = match (&field.name, parts.get(column)) {
                (Some(field), _) => format!("{name}.{field}"),
                (None, Some(part)) => part.to_string(),
                (None, None) if width == 1 => name.to_string(),
                (None, None) => format!("{name}_{}", column + 1),
            };
            let values = (0..rows).map(value).collect();
            all.push(Attribute { name, number: field.number.kept_as(), values });
        }
    }
    Ok(all)
}

/// Cuts a file into the text of its header and the array's bytes.
fn split(bytes: &[u8]) -> Result<(&str, &[u8]), Error> {
    let short = || {
        Error::new(
            ErrorKind::Format,
            format!("truncated: the file ends in its header, at {} bytes", bytes.len()),
        )
        .advise("fetch the file again")
    };
    if !looks_like_npy(bytes) {
        return Err(Error::new(ErrorKind::Format, "the file does not begin with the mark of an NPY file")
            .advise("write it with numpy.save(path, points)"));
    }
    let version = *bytes.get(6).ok_or_else(short)?;
    let (length, start) = match version {
        1 => (unsigned(bytes, 8, 2).ok_or_else(short)?, 10),
        2 | 3 => (unsigned(bytes, 8, 4).ok_or_else(short)?, 12),
        other => return Err(bad_header(format!("version {other} is unknown"))),
    };
    if length > (bytes.len() - start) as u64 {
        return Err(short());
    }
    let (header, data) = bytes[start..].split_at(length as usize);
    let header = std::str::from_utf8(header).map_err(|_| bad_header("the header is not text".to_string()))?;
    Ok((header, data))
}

#[cfg(test)]
pub(super) mod tests {
    use super::super::options::Columns;
    use super::*;

    /// An NPY file with `header` as its dictionary.
    pub fn file(version: u8, header: &str, data: &[u8]) -> Vec<u8> {
        let mut bytes = MAGIC.to_vec();
        bytes.extend([version, 0]);
        let text = format!("{header}\n");
        match version {
            1 => bytes.extend((text.len() as u16).to_le_bytes()),
            _ => bytes.extend((text.len() as u32).to_le_bytes()),
        }
        bytes.extend(text.as_bytes());
        bytes.extend(data);
        bytes
    }

    /// The points as an NPY file of little-endian `f32`, row by row.
    pub fn write(points: &[[f32; 3]]) -> Vec<u8> {
        let header = format!("{{'descr': '<f4', 'fortran_order': False, 'shape': ({}, 3), }}", points.len());
        let data: Vec<u8> = points.as_flattened().iter().flat_map(|x| x.to_le_bytes()).collect();
        file(1, &header, &data)
    }

    fn array(descr: &str, fortran: bool, shape: &str, data: &[u8]) -> Vec<u8> {
        let order = if fortran { "True" } else { "False" };
        file(2, &format!("{{'shape': {shape}, \"fortran_order\": {order}, 'descr': '{descr}'}}"), data)
    }

    fn plain(bytes: &[u8]) -> Result<Loaded, Error> {
        read(bytes, &ReadOptions::default(), Want::Cloud)
    }

    fn message(bytes: &[u8]) -> String {
        read(bytes, &ReadOptions::default(), Want::Cloud).map(|l| l.verts).unwrap_err().to_string()
    }

    #[test]
    fn reads_every_type_byte_order_and_storage_order() {
        let rows = [[1.0, -2.0, 3.0, 9.0], [4.0, 5.0, -6.0, 9.0]];
        let columns: Vec<f64> = (0..4).flat_map(|c| rows.map(|r: [f64; 4]| r[c])).collect();
        for (fortran, values) in [(false, rows.as_flattened().to_vec()), (true, columns)] {
            let flat = |f: &dyn Fn(f64) -> Vec<u8>| values.iter().flat_map(|&x| f(x)).collect::<Vec<u8>>();
            let cases = [
                ("<f4", flat(&|x| (x as f32).to_le_bytes().to_vec())),
                (">f4", flat(&|x| (x as f32).to_be_bytes().to_vec())),
                ("<f8", flat(&|x| x.to_le_bytes().to_vec())),
                (">f8", flat(&|x| x.to_be_bytes().to_vec())),
                ("|i1", flat(&|x| (x as i8).to_le_bytes().to_vec())),
                (">i2", flat(&|x| (x as i16).to_be_bytes().to_vec())),
                ("<i4", flat(&|x| (x as i32).to_le_bytes().to_vec())),
                (">i4", flat(&|x| (x as i32).to_be_bytes().to_vec())),
                ("<i8", flat(&|x| (x as i64).to_le_bytes().to_vec())),
                (">i8", flat(&|x| (x as i64).to_be_bytes().to_vec())),
            ];
            for (descr, data) in cases {
                let loaded = plain(&array(descr, fortran, "(2, 4)", &data)).unwrap();
                assert_eq!(loaded.verts, [[1.0, -2.0, 3.0], [4.0, 5.0, -6.0]], "{descr} {fortran}");
                assert_eq!(loaded.notices, ["ignored 1 extra column"]);
            }
        }
        let loaded = plain(&array("|u1", false, "(1, 3)", &[1, 200, 255])).unwrap();
        assert_eq!(loaded.verts, [[1.0, 200.0, 255.0]]);
        let loaded = plain(&array("|u1", false, "(1, 3)", &[1, 2, 3, 4])).unwrap();
        assert_eq!(loaded.notices, ["ignored 1 bytes behind the array"]);
        assert_eq!(plain(&write(&[[0.5, 1.5, 2.5]])).unwrap().verts, [[0.5, 1.5, 2.5]]);
    }

    #[test]
    fn shapes_of_every_kind_give_the_same_points() {
        let points: Vec<[f64; 3]> =
            (0..20).map(|i| [f64::from(i) + 0.5, f64::from(i * i % 7) - 0.25, -f64::from(i % 3)]).collect();
        let n = points.len();
        let by = |order: &dyn Fn(usize) -> (usize, usize)| {
            (0..3 * n).map(order).flat_map(|(i, c)| points[i][c].to_le_bytes()).collect::<Vec<u8>>()
        };
        let rows = by(&|k| (k / 3, k % 3));
        let columns = by(&|k| (k % n, k / n));
        // Fortran order of (5, 4, 3): the first index runs fastest.
        let image = by(&|k| (k % 5 * 4 + k / 5 % 4, k / n));
        let cases = [
            ("(20, 3)", false, &rows),
            ("(20, 3)", true, &columns),
            ("(3, 20)", false, &columns),
            ("(3, 20)", true, &rows),
            ("(5, 4, 3)", false, &rows),
            ("(1, 20, 3)", false, &rows),
            ("(5, 4, 3)", true, &image),
            ("(3, 5, 4)", false, &columns),
        ];
        for (shape, fortran, data) in cases {
            let loaded =
                plain(&array("<f8", fortran, shape, data)).unwrap_or_else(|e| panic!("{shape}: {e}"));
            assert_eq!(loaded.verts, points, "{shape} {fortran}");
        }
        let halves: Vec<u8> = [0x3c00_u16, 0xc000, 0x3800].iter().flat_map(|h| h.to_be_bytes()).collect();
        assert_eq!(plain(&array(">f2", false, "(1, 3)", &halves)).unwrap().verts, [[1.0, -2.0, 0.5]]);
        let header = "{'descr': [('z', '<f4'), ('i', '|u1'), ('x', '>f4'), ('y', '<f8')], 'fortran_order': False, \
                      'shape': (1,)}";
        let row = [&3_f32.to_le_bytes()[..], &[9], &1_f32.to_be_bytes(), &2_f64.to_le_bytes()].concat();
        let loaded = plain(&file(1, header, &row)).unwrap();
        assert_eq!(
            (loaded.verts, loaded.notices[0].as_str()),
            (vec![[1.0, 2.0, 3.0]], "ignored 1 extra field")
        );
    }

    #[test]
    fn point_numbers_are_doubted_and_columns_can_be_given() {
        let data: Vec<u8> = (0..40_u16)
            .flat_map(|i| [f64::from(i / 4), f64::from(i) * 0.37, 0.5, 1.5][usize::from(i % 4)].to_le_bytes())
            .collect();
        let bytes = array("<f8", false, "(10, 4)", &data);
        assert!(message(&bytes).contains("--columns 2,3,4"));
        let options = ReadOptions { columns: Some(Columns::Numbers([2, 3, 4])), ..Default::default() };
        assert_eq!(read(&bytes, &options, Want::Cloud).unwrap().verts[1], [0.37 * 5.0, 0.5, 1.5]);
        let options = ReadOptions { assume: true, ..Default::default() };
        assert_eq!(read(&bytes, &options, Want::Cloud).unwrap().verts[1][0], 1.0);
    }

    #[test]
    fn matrices_of_many_columns_are_doubted() {
        let odd = |i: usize| 1.0 + (i * 31 % 97) as f64 / 7.0;
        let depths = |rows: usize, columns: usize| {
            let data: Vec<u8> = (0..rows * columns).flat_map(|i| odd(i).to_le_bytes()).collect();
            array("<f8", false, &format!("({rows}, {columns})"), &data)
        };
        for (rows, columns) in [(48, 64), (48, 17), (64, 48), (17, 17), (2, 64), (1, 17)] {
            let bytes = depths(rows, columns);
            let e = message(&bytes);
            assert!(e.starts_with("it is not certain where the coordinates are"), "{e}");
            assert!(e.contains(&format!("{columns} columns")) && e.contains("--columns 1,2,3"), "{e}");
            assert!(e.contains("--assume"), "{e}");
            let given = ReadOptions { columns: Some(Columns::Numbers([3, 1, 2])), ..Default::default() };
            assert_eq!(read(&bytes, &given, Want::Cloud).unwrap().verts[0], [odd(2), odd(0), odd(1)]);
            let assumed = ReadOptions { assume: true, ..Default::default() };
            let loaded = read(&bytes, &assumed, Want::Cloud).unwrap();
            assert_eq!((loaded.verts.len(), loaded.verts[0]), (rows, [0, 1, 2].map(odd)));
        }
        for (rows, columns, points) in [(48, 16, 48), (16, 48, 48), (3, 64, 64)] {
            assert_eq!(plain(&depths(rows, columns)).unwrap().verts.len(), points, "{rows} x {columns}");
        }
    }

    #[test]
    fn rows_that_the_shape_does_not_count_are_warned_of() {
        for (shape, fortran) in [("(2, 3)", false), ("(2, 3)", true), ("(1, 2, 3)", false)] {
            let loaded = plain(&array("|u1", fortran, shape, &[1; 12])).unwrap();
            let expected = "the header promises 2 points, 4 are there; the last 2 were not read";
            assert_eq!((loaded.verts.len(), loaded.warnings), (2, vec![expected.to_string()]), "{shape}");
            let loaded = plain(&array("|u1", fortran, shape, &[1; 8])).unwrap();
            assert!(loaded.warnings.is_empty());
            assert_eq!(loaded.notices.last().unwrap(), "ignored 2 bytes behind the array");
        }
    }

    #[test]
    fn errors_say_what_to_save_instead() {
        assert!(message(b"PK\x03\x04").contains("mark of an NPY file"));
        assert!(message(b"\x93NUMPY\x01\x00\xff").contains("ends in its header, at 9 bytes"));
        assert!(message(&file(9, "{}", &[])).contains("version 9"));
        assert!(message(&file(1, "{}", &[])).contains("descr is missing"));
        assert!(message(&array("<c8", false, "(1, 3)", &[])).contains("\"<c8\" are not supported"));
        assert!(message(&file(1, "{'descr': {'x': 1}}", &[])).contains("neither one plain type"));
        assert!(message(&array("<f4", false, "(3,)", &[])).contains("the shape is (3)"));
        assert!(message(&array("<f4", false, "(9, 2)", &[])).contains("reshape(-1, 3)"));
        assert!(message(&array("<f4", false, "(2, 3, 2)", &[])).contains("the shape is (2, 3, 2)"));
        assert!(
            message(&array("<f4", false, "(2, 3)", &[0; 20]))
                .contains("2 x 3 numbers of 4 bytes promised, 20 bytes are there")
        );
        // The product overflows 64 bits; nothing may be reserved for it.
        let huge = array("<f8", false, "(18446744073709551615, 18446744073709551615)", &[0; 24]);
        assert!(message(&huge).contains("truncated"));
        let nan: Vec<u8> = [0.0, f32::NAN, 0.0].iter().flat_map(|x| x.to_le_bytes()).collect();
        let strict = read(&array("<f4", false, "(1, 3)", &nan), &ReadOptions::default(), Want::EveryRow);
        assert!(strict.map(|l| l.verts).unwrap_err().to_string().contains("point 0: y is NaN"));
        let fields = "{'descr': [('x', '<f4'), ('y', '<f4')], 'fortran_order': False, 'shape': (2,)}";
        assert!(message(&file(1, fields, &[0; 16])).contains("no field \"z\", only \"x\", \"y\""));
        let wide: Vec<u8> = [0.0, 1e200, 0.0].iter().flat_map(|x: &f64| x.to_le_bytes()).collect();
        assert!(message(&array("<f8", false, "(1, 3)", &wide)).contains("not a finite 32-bit number"));
    }
}
