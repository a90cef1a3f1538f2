//! PCD, the format of the Point Cloud Library: text, binary, and binary packed with LZF.

use super::number::{ByteOrder, NumberType, unsigned};
use super::precision::check_point;
use super::text::{Lines, float, integer, not_a_number, show, words};
use super::{Loaded, Want};
use crate::geometry::{Attribute, COLOUR, Number};
use crate::{Error, ErrorKind};

mod lzf;

/// Names of the fields of a normal's components.
const NORMAL_FIELDS: [[&str; 2]; 3] = [["normal_x", "nx"], ["normal_y", "ny"], ["normal_z", "nz"]];
const MAX_HEADER: usize = 1 << 20;

/// Whether the bytes begin with the header of a PCD file.
pub(super) fn looks_like_pcd(bytes: &[u8]) -> bool {
    let start = &bytes[..bytes.len().min(4096)];
    let mut lines = Lines::new(start).map(|(_, l)| l.trim_ascii());
    let first = lines.find(|l| !l.is_empty() && !l.starts_with(b"#"));
    first.is_some_and(|l| {
        let mut parts = words(l);
        match parts.next() {
            Some(b"VERSION") => parts.next().and_then(float).is_some() && parts.next().is_none(),
            Some(b"FIELDS" | b"COLUMNS") => parts.next().is_some(),
            _ => false,
        }
    })
}

/// A column, or several of one name.
struct Field {
    name: String,
    number: NumberType,
    /// How many of them.
    count: usize,
    /// Where it begins in a row, in bytes.
    offset: usize,
    /// Where it begins in a line of text, in words.
    word: usize,
}

/// The fields that are read, by their numbers in the header.
struct Places {
    point: [usize; 3],
    normal: Option<[usize; 3]>,
    /// Those of the attributes.
    more: Vec<usize>,
}

impl Field {
    /// The attribute that it becomes, without values yet.
    fn attribute(&self) -> Attribute {
        Attribute { name: self.name.clone(), number: self.number.kept_as(), values: Vec::new() }
    }
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Data {
    Ascii,
    Binary,
    Packed,
}

struct Header {
    fields: Vec<Field>,
    points: u64,
    /// The points as rows and columns of an image, where they are no mere list.
    organised: bool,
    viewpoint: Option<Vec<f64>>,
    data: Data,
    /// Where the data begin, in bytes.
    body: usize,
    /// Lines of the header.
    lines: u64,
    /// Bytes of a point.
    row: usize,
}

/// Reads n x 3 points and, if there are any, their normals.
pub(super) fn read(bytes: &[u8], want: Want) -> Result<Loaded, Error> {
    let header = Header::parse(bytes)?;
    let mut loaded = Loaded::default();
    let place =
        |name: &str| header.fields.iter().position(|f| f.name.eq_ignore_ascii_case(name) && f.count == 1);
    let mut point = [0; 3];
    for (at, axis) in point.iter_mut().zip(["x", "y", "z"]) {
        *at = place(axis).ok_or_else(|| {
            let names: Vec<&str> = header.fields.iter().take(8).map(|f| f.name.as_str()).collect();
            wrong(format!("there is no field {axis}, only {}", names.join(", ")))
        })?;
    }
    let normal = match NORMAL_FIELDS.map(|names| names.iter().find_map(|n| place(n))) {
        [Some(a), Some(b), Some(c)] => Some([a, b, c]),
        _ => None,
    };
    let mut read: Vec<usize> = point.into_iter().chain(normal.into_iter().flatten()).collect();
    let others = (0..header.fields.len()).filter(|i| {
        let field = &header.fields[*i];
        want == Want::Attributes && !read.contains(i) && field.count == 1 && field.name != "_"
    });
    let more: Vec<usize> = others.collect();
    read.extend(&more);
    loaded.attributes = more.iter().map(|&i| header.fields[i].attribute()).collect();
    let places = Places { point, normal, more };
    let body = &bytes[header.body..];
    match header.data {
        Data::Ascii => text(&header, body, &places, want, &mut loaded)?,
        Data::Binary => binary(&header, body, Order::Rows, &places, want, &mut loaded)?,
        Data::Packed => {
            let columns = header.unpack(body)?;
            binary(&header, &columns, Order::Columns, &places, want, &mut loaded)?;
        }
    }
    unpack_colours(&mut loaded, &header, &places.more);
    let extra = header.fields.iter().filter(|f| f.name != "_").count() - read.len();
    if extra > 0 {
        loaded.notices.push(format!("ignored {extra} extra fields"));
    }
    if let Some(v) = header.viewpoint.filter(|v| v[..] != [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]) {
        loaded.notices.push("the viewpoint was not applied; the points are as the file has them".into());
        // 0 0 0 is what programs write that do not know the scanner's place.
        let place = v.first_chunk::<3>().copied();
        loaded.viewpoints.extend(place.filter(|p| *p != [0.0; 3] && p.iter().all(|x| x.is_finite())));
    }
    if header.organised {
        loaded.notices.push("the points are rows and columns of an image".into());
    }
    Ok(loaded)
}

/// Replaces a field `rgb` or `rgba`, in whose 32 bits the parts of a colour are packed, by these parts. The bits may be
/// declared as those of a float.
fn unpack_colours(loaded: &mut Loaded, header: &Header, fields: &[usize]) {
    let packed = |(a, &i): (&Attribute, &usize)| {
        let named = ["rgb", "rgba"].iter().any(|name| a.name.eq_ignore_ascii_case(name));
        named && header.fields[i].number.size() == 4
    };
    let Some(at) = loaded.attributes.iter().zip(fields).position(packed) else { return };
    let Attribute { number, values, .. } = loaded.attributes.remove(at);
    let bits = |&x: &f64| match number {
        Number::F32 => (x as f32).to_bits(),
        // Text may have the bits of an unsigned number in a field of signed ones, and the other way round.
        _ => x as i64 as u32,
    };
    let part = |(name, shift): (&str, u32)| Attribute {
        name: name.into(),
        number: Number::U8,
        values: values.iter().map(|x| f64::from((bits(x) >> shift) as u8)).collect(),
    };
    loaded.attributes.retain(|a| !a.is_colour());
    loaded.attributes.extend(COLOUR.into_iter().zip([16, 8, 0]).map(part));
}

impl Header {
    fn parse(bytes: &[u8]) -> Result<Header, Error> {
        let mut names: Vec<String> = Vec::new();
        let (mut sizes, mut kinds, mut counts): (Vec<usize>, Vec<u8>, Vec<usize>) = Default::default();
        let (mut width, mut height, mut points, mut viewpoint) = (None, None, None, None);
        let mut at = 0;
        let mut number = 0;
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
            let whole = |word: &[u8]| {
                integer(word)
                    .and_then(|n| u64::try_from(n).ok())
                    .ok_or_else(|| here(wrong(format!("{} is not a count", show(word)))))
            };
            let one = || parts.first().copied().unwrap_or_default();
            match keyword {
                b"VERSION" => {}
                b"FIELDS" | b"COLUMNS" => {
                    names = parts.iter().map(|p| String::from_utf8_lossy(p).into_owned()).collect();
                }
                b"SIZE" => {
                    for word in &parts {
                        let size = whole(word)?;
                        if ![1, 2, 4, 8].contains(&size) {
                            return Err(here(wrong(format!("numbers of {size} bytes are not known"))));
                        }
                        sizes.push(size as usize);
                    }
                }
                b"TYPE" => kinds = parts.iter().map(|p| p.first().copied().unwrap_or(b'?')).collect(),
                b"COUNT" => {
                    for word in &parts {
                        let count = whole(word)?;
                        if count == 0 || count > 1 << 16 {
                            return Err(here(wrong(format!("a field of {count} numbers is not possible"))));
                        }
                        counts.push(count as usize);
                    }
                }
                b"WIDTH" => width = Some(whole(one())?),
                b"HEIGHT" => height = Some(whole(one())?),
                b"POINTS" => points = Some(whole(one())?),
                b"VIEWPOINT" => viewpoint = parts.iter().map(|p| float(p)).collect::<Option<Vec<f64>>>(),
                b"DATA" => {
                    let data = match one() {
                        w if w.eq_ignore_ascii_case(b"ascii") => Data::Ascii,
                        w if w.eq_ignore_ascii_case(b"binary") => Data::Binary,
                        w if w.eq_ignore_ascii_case(b"binary_compressed") => Data::Packed,
                        w => return Err(here(wrong(format!("unknown data {}", show(w))))),
                    };
                    let area = width.and_then(|w| w.checked_mul(height.unwrap_or(1)));
                    let Some(count) = points.or(area) else {
                        return Err(here(wrong("neither POINTS nor WIDTH says how many points there are")));
                    };
                    if area.is_some_and(|area| area != count) {
                        return Err(here(wrong(format!(
                            "POINTS is {count}, but WIDTH times HEIGHT is {}",
                            area.unwrap_or(0)
                        ))));
                    }
                    counts.resize(if counts.is_empty() { names.len() } else { counts.len() }, 1);
                    let all = names.len();
                    if all == 0 || [sizes.len(), kinds.len(), counts.len()].iter().any(|n| *n != all) {
                        return Err(here(wrong("FIELDS, SIZE, TYPE and COUNT have not the same length")));
                    }
                    let (mut offset, mut word, mut fields) = (0, 0, Vec::new());
                    for (i, name) in names.into_iter().enumerate() {
                        let (size, kind, count) = (sizes[i], kinds[i].to_ascii_uppercase(), counts[i]);
                        let number = match kind {
                            b'F' if size == 4 => Some(NumberType::F32),
                            b'F' if size == 8 => Some(NumberType::F64),
                            b'I' | b'U' => NumberType::integer(size, kind == b'I'),
                            // Fillers may have any type; only their size matters.
                            _ if name == "_" => NumberType::integer(size, false),
                            _ => None,
                        };
                        let Some(number) = number else {
                            return Err(here(wrong(format!(
                                "field {name} has the type {} of {size} bytes",
                                char::from(kind)
                            ))));
                        };
                        fields.push(Field { name, number, count, offset, word });
                        offset += size * count;
                        word += count;
                    }
                    let organised = height.is_some_and(|h| h > 1) && width.is_some_and(|w| w > 1);
                    let (body, lines, row) = (at, number, offset);
                    return Ok(Header {
                        fields,
                        points: count,
                        organised,
                        viewpoint,
                        data,
                        body,
                        lines,
                        row,
                    });
                }
                other => return Err(here(wrong(format!("{} is not a PCD header line", show(other))))),
            }
        }
    }

    /// The number of points, if as many rows are there.
    fn rows(&self, bytes: usize) -> Result<usize, Error> {
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

    /// The columns of a packed file, one behind the other.
    fn unpack(&self, body: &[u8]) -> Result<Vec<u8>, Error> {
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
        let rows = self.rows(plain)?;
        let columns = if packed == 0 && plain == 0 { Some(Vec::new()) } else { lzf::unpack(bytes, plain) };
        let columns = columns.ok_or_else(|| wrong("the packed data are damaged"))?;
        debug_assert!(columns.len() >= rows * self.row);
        Ok(columns)
    }
}

fn wrong(what: impl Into<String>) -> Error {
    Error::new(ErrorKind::Format, what).advise("the file is damaged or not PCD; export it again")
}

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

fn text(header: &Header, body: &[u8], places: &Places, want: Want, loaded: &mut Loaded) -> Result<(), Error> {
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
            let value = value(field).unwrap_or(f64::NAN);
            // Only floats can say that there is no value.
            if !value.is_finite() && attribute.number != Number::F32 {
                attribute.number = Number::F64;
            }
            let narrow = attribute.number == Number::F32;
            attribute.values.push(if narrow { f64::from(value as f32) } else { value });
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
enum Order {
    /// All fields of a point together, point by point.
    Rows,
    /// All numbers of a field before those of the next.
    Columns,
}

fn binary(
    header: &Header,
    body: &[u8],
    order: Order,
    places: &Places,
    want: Want,
    loaded: &mut Loaded,
) -> Result<(), Error> {
    let rows = header.rows(body.len())?;
    loaded.verts.reserve_exact(rows);
    for i in 0..rows {
        let value = |field: usize| {
            let field = &header.fields[field];
            let at = match order {
                Order::Rows => i * header.row + field.offset,
                Order::Columns => rows * field.offset + i * field.number.size() * field.count,
            };
            field.number.read(&body[at..], ByteOrder::Little)
        };
        for (attribute, &field) in loaded.attributes.iter_mut().zip(&places.more) {
            attribute.values.push(value(field));
        }
        push(loaded, i, want, places.point.map(value), places.normal.map(|n| n.map(value)))?;
    }
    let tail = body.len() - rows * header.row;
    if tail > 0 {
        loaded.notices.push(format!("ignored {tail} bytes behind the last point"));
    }
    Ok(())
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    const POINTS: [[f64; 3]; 3] = [[1.0, 2.0, 3.0], [-4.5, 0.25, 6.0], [7.0, 8.0, -9.0]];

    fn header(data: &str) -> String {
        format!(
            "# .PCD v0.7\nVERSION 0.7\nFIELDS normal_x x _ y rgb z normal_y normal_z\nSIZE 4 4 1 8 4 2 4 4\n\
             TYPE F F U F U I F F\nCOUNT 1 1 3 1 1 1 1 1\nWIDTH 3\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS 3\n\
             DATA {data}\n"
        )
    }

    /// The bytes of each field of a point.
    fn fields(p: [f64; 3]) -> [Vec<u8>; 8] {
        [
            0.6_f32.to_le_bytes().to_vec(),
            (p[0] as f32).to_le_bytes().to_vec(),
            vec![1, 2, 3],
            p[1].to_le_bytes().to_vec(),
            vec![9; 4],
            (p[2] as i16).to_le_bytes().to_vec(),
            0_f32.to_le_bytes().to_vec(),
            0.8_f32.to_le_bytes().to_vec(),
        ]
    }

    fn rows() -> Vec<u8> {
        POINTS.iter().flat_map(|p| fields(*p).concat()).collect()
    }

    /// A packed file of the points.
    pub fn sample() -> Vec<u8> {
        let columns: Vec<u8> = (0..8).flat_map(|f| POINTS.map(|p| fields(p)[f].clone()).concat()).collect();
        let packed = lzf::tests::pack(&columns);
        let sizes = [packed.len() as u32, columns.len() as u32].map(u32::to_le_bytes).concat();
        [header("binary_compressed").into_bytes(), sizes, packed].concat()
    }

    #[test]
    fn reads_every_encoding() {
        let text: String =
            POINTS.iter().map(|p| format!("0.6 {} 1 2 3 {} 99 {} 0 0.8\n", p[0], p[1], p[2])).collect();
        let files = [
            (header("ascii") + &text).into_bytes(),
            [header("binary").into_bytes(), rows()].concat(),
            sample(),
        ];
        for bytes in files {
            assert!(looks_like_pcd(&bytes));
            let loaded = read(&bytes, Want::Cloud).unwrap();
            assert_eq!(loaded.verts, POINTS);
            assert_eq!(loaded.normals, [[0.6, 0.0, 0.8]; 3]);
            assert_eq!(loaded.notices, ["ignored 1 extra fields"]);
        }
        let old = b"FIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nWIDTH 2\nDATA ascii\n1 2 3\nnan 0 0\n";
        let loaded = read(old, Want::Cloud).unwrap();
        assert!(loaded.verts[0] == [1.0, 2.0, 3.0] && loaded.verts[1][0].is_nan());
    }

    #[test]
    fn fields_beside_the_coordinates_become_attributes() {
        let head = |kind: &str, data: &str| {
            format!(
                "FIELDS x y z intensity rgb ring _ more\nSIZE 4 4 4 4 4 2 1 4\nTYPE F F F F {kind} U U F\n\
                 COUNT 1 1 1 1 1 1 1 2\nWIDTH 2\nDATA {data}\n"
            )
        };
        // 255, 128, 7 in the last three bytes.
        let bits = 0x00ff_8007_u32;
        let rows: Vec<u8> = [[1.0, 0.5], [4.0, -2.0]]
            .iter()
            .flat_map(|[x, i]: &[f32; 2]| {
                let floats = [*x, 2.0, 3.0, *i].map(f32::to_le_bytes).concat();
                [floats, bits.to_le_bytes().to_vec(), 9_u16.to_le_bytes().to_vec(), vec![0; 9]].concat()
            })
            .collect();
        let float = f32::from_bits(bits);
        let text = |rgb: String| format!("1 2 3 0.5 {rgb} 9 0 0 0\n4 2 3 -2 {rgb} 9 0 0 0\n").into_bytes();
        for (head, body) in [
            (head("F", "binary"), rows.clone()),
            (head("U", "binary"), rows),
            (head("F", "ascii"), text(float.to_string())),
            (head("U", "ascii"), text(bits.to_string())),
        ] {
            let bytes = [head.as_bytes(), &body].concat();
            let loaded = read(&bytes, Want::Attributes).unwrap();
            let found: Vec<(&str, Number, &[f64])> =
                loaded.attributes.iter().map(|a| (a.name.as_str(), a.number, &a.values[..])).collect();
            let expected: [(&str, Number, &[f64]); 5] = [
                ("intensity", Number::F32, &[0.5, -2.0]),
                ("ring", Number::U16, &[9.0; 2]),
                ("red", Number::U8, &[255.0; 2]),
                ("green", Number::U8, &[128.0; 2]),
                ("blue", Number::U8, &[7.0; 2]),
            ];
            assert_eq!(found, expected, "{head}");
            assert_eq!(loaded.notices, ["ignored 1 extra fields"]);
            assert!(read(&bytes, Want::Cloud).unwrap().attributes.is_empty());
        }
    }

    #[test]
    fn what_is_wrong_is_said() {
        let ascii = header("ascii");
        let loaded = read((ascii.clone() + "0 1 0 0 0 2 0 3 0 0\n").as_bytes(), Want::Cloud).unwrap();
        assert_eq!(loaded.warnings, ["the header promises 3 points, 1 are there; the file may be cut short"]);
        let binary = [header("binary").into_bytes(), rows()].concat();
        let cases: [(Vec<u8>, &str); 8] = [
            (binary[..binary.len() - 1].to_vec(), "3 points of 33 bytes promised, 98 bytes are there"),
            (sample()[..sample().len() - 1].to_vec(), "packed bytes promised"),
            (ascii.replace("DATA", "DATE").into_bytes(), "not a PCD header line"),
            (ascii.replace("POINTS 3", "POINTS 4").into_bytes(), "WIDTH times HEIGHT is 3"),
            (ascii.replace(" z ", " w ").into_bytes(), "no field z"),
            (ascii.replace("SIZE 4", "SIZE 3").into_bytes(), "numbers of 3 bytes"),
            (header("ascii").replace("COUNT 1", "COUNT").into_bytes(), "not the same length"),
            ((ascii + "0 1 0 0 0 x 0 3 0 0\n").into_bytes(), "line 12: point 0: \"x\" is not a number"),
        ];
        for (bytes, message) in cases {
            let e = read(&bytes, Want::Cloud).map(|l| l.verts).unwrap_err().to_string();
            assert!(e.contains(message), "{e}");
        }
        let huge = header("binary").replace("WIDTH 3", "WIDTH 18446744073709551615");
        assert!(read(huge.replace("POINTS 3\n", "").as_bytes(), Want::Cloud).is_err());
    }
}
