//! PCD, the format of the Point Cloud Library: text, binary, and binary packed with LZF.

use super::text::{Lines, float, words};
use super::{Loaded, Want};
use crate::Error;
use crate::geometry::{Attribute, COLOUR, Number};

mod data;
mod header;
mod lzf;

use data::{Order, Places};
use header::{Data, Header, wrong};

/// Names of the fields of a normal's components.
const NORMAL_FIELDS: [[&str; 2]; 3] = [["normal_x", "nx"], ["normal_y", "ny"], ["normal_z", "nz"]];

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
        Data::Ascii => data::text(&header, body, &places, want, &mut loaded)?,
        Data::Binary => data::binary(&header, body, Order::Rows, &places, want, &mut loaded)?,
        Data::Packed => {
            let columns = data::unpack(&header, body)?;
            data::binary(&header, &columns, Order::Columns, &places, want, &mut loaded)?;
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
    fn a_count_that_is_too_small_is_warned_of() {
        let short = |bytes: &[u8]| {
            let text = b"WIDTH 3\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS 3\n";
            let at = bytes.windows(text.len()).position(|w| w == text).unwrap();
            let few = b"WIDTH 2\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS 2\n";
            [&bytes[..at], few, &bytes[at + text.len()..]].concat()
        };
        let binary = [header("binary").into_bytes(), rows()].concat();
        for bytes in [binary.clone(), [binary.clone(), vec![7; 32]].concat(), sample()] {
            let loaded = read(&short(&bytes), Want::Cloud).unwrap();
            assert_eq!(loaded.verts, POINTS[..2]);
            let expected = "the header promises 2 points, 3 are there; the last 1 were not read";
            assert_eq!(loaded.warnings, [expected]);
        }
        let tail = read(&[binary, vec![7; 32]].concat(), Want::Cloud).unwrap();
        assert_eq!((tail.verts.len(), tail.warnings.len()), (3, 0));
        assert_eq!(tail.notices[0], "ignored 32 bytes behind the last point");
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
