//! Thousands of generated files as many programs write them, whole and damaged, through every reader: never a panic,
//! and never another number of points without a word.

use bijective_sdf::ErrorKind;
use bijective_sdf::io::{Format, PointCloud, ReadOptions, read_cloud_with};
use proptest::prelude::*;

/// A text file: how its numbers, columns and lines are written.
#[derive(Clone, Debug)]
struct Dialect {
    delimiter: &'static str,
    end: &'static str,
    decimal_comma: bool,
    header: Header,
    /// Columns in front of x and behind z.
    before: usize,
    behind: usize,
    count: Option<i64>,
    last_end: bool,
    digits: usize,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Header {
    None,
    Names,
    Comment,
    Survey,
}

fn dialects() -> impl Strategy<Value = Dialect> {
    let delimiter = prop::sample::select(vec![",", ";", " ", "\t", "  ", " ; ", ", ", "|"]);
    let end = prop::sample::select(vec!["\n", "\r\n", "\r"]);
    let header = prop::sample::select(vec![Header::None, Header::Names, Header::Comment, Header::Survey]);
    let parts = (delimiter, end, any::<bool>(), header, 0..3_usize, 0..4_usize);
    let more = (prop::option::of(-1..2_i64), any::<bool>(), 3..9_usize);
    (parts, more).prop_map(|((delimiter, end, comma, header, before, behind), (count, last_end, digits))| {
        Dialect {
            delimiter,
            end,
            decimal_comma: comma && !delimiter.contains(','),
            header,
            // Columns in front of unnamed ones are what the reader doubts.
            before: if header == Header::None { 0 } else { before },
            behind,
            count: count.filter(|_| header == Header::None),
            last_end,
            digits,
        }
    })
}

/// Points of no pattern, none at a place that could stand for no value.
fn clouds() -> impl Strategy<Value = Vec<[f64; 3]>> {
    prop::collection::vec(prop::array::uniform3(0.013_f64..7.9), 8..40)
}

impl Dialect {
    fn write(&self, points: &[[f64; 3]]) -> String {
        let mut text = String::new();
        let names = |axes: [&str; 3]| {
            let before = (0..self.before).map(|i| format!("before_{i}"));
            let behind = (0..self.behind).map(|i| format!("behind_{i}"));
            let all: Vec<String> = before.chain(axes.map(String::from)).chain(behind).collect();
            all.join(self.delimiter)
        };
        match self.header {
            Header::None => {}
            Header::Names => text += &(names(["x", "y", "z"]) + self.end),
            Header::Comment => text += &(format!("# {}", names(["X", "Y", "Z"])) + self.end),
            Header::Survey => text += &(names(["Easting", "Northing", "Elev."]) + self.end),
        }
        if let Some(off) = self.count {
            text += &format!("{}{}", points.len() as i64 + off, self.end);
        }
        for (i, p) in points.iter().enumerate() {
            let before = (0..self.before).map(|c| format!("{}", 1 + i + c));
            let numbers = p.map(|x| format!("{x:.*}", self.digits));
            let behind = (0..self.behind).map(|c| format!("0.{}", 1 + (i * 7 + c) % 9));
            let mut row = before.chain(numbers).chain(behind).collect::<Vec<_>>().join(self.delimiter);
            if self.decimal_comma {
                row = row.replace('.', ",");
            }
            text += &row;
            if self.last_end || i + 1 < points.len() {
                text += self.end;
            }
        }
        text
    }

    /// Whether the reader has to speak of this file.
    fn wants_a_warning(&self) -> bool {
        self.count.is_some_and(|off| off != 0)
    }
}

/// Sound data with a word about each loss, or an error of one line with advice.
fn answers(bytes: &[u8], format: Option<Format>) -> Option<PointCloud> {
    let mut options = ReadOptions::default();
    options.format = format;
    match read_cloud_with(bytes, &options) {
        Ok(cloud) => {
            assert!(!cloud.points.is_empty() && cloud.points.as_flattened().iter().all(|x| x.is_finite()));
            assert!(cloud.left_out == 0 || !cloud.warnings.is_empty() || !cloud.notices.is_empty());
            assert!(cloud.warnings.iter().chain(&cloud.notices).all(|t| !t.contains('\n')));
            // Who asks for what stands beside the points gets the same points, and a value for each.
            options.attributes = true;
            let more = read_cloud_with(bytes, &options).expect("what is read without attributes");
            assert_eq!((&more.points, &more.warnings), (&cloud.points, &cloud.warnings));
            assert!(more.attributes.iter().all(|a| a.values.len() == more.points.len()));
            Some(cloud)
        }
        Err(e) => {
            assert!(matches!(e.kind(), ErrorKind::Format | ErrorKind::Data), "{e}");
            assert!(!e.to_string().contains('\n'), "{e}");
            None
        }
    }
}

/// Files of other formats that hold the points.
fn files(points: &[[f64; 3]]) -> Vec<(Format, Vec<u8>)> {
    let n = points.len();
    let floats = |big: bool| -> Vec<u8> {
        let bytes = |x: f64| if big { (x as f32).to_be_bytes() } else { (x as f32).to_le_bytes() };
        points.as_flattened().iter().flat_map(|x| bytes(*x)).collect()
    };
    let rows: String = points.iter().map(|p| format!("{} {} {}\n", p[0], p[1], p[2])).collect();
    let pcd = |data: &str| {
        format!(
            "VERSION .7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH {n}\nHEIGHT 1\nDATA {data}\n"
        )
    };
    let vtk = |encoding: &str| {
        format!("# vtk DataFile Version 3.0\nt\n{encoding}\nDATASET POLYDATA\nPOINTS {n} float\n")
    };
    let ply = |encoding: &str| {
        format!(
            "ply\nformat {encoding} 1.0\nelement vertex {n}\nproperty float X\nproperty float Y\nproperty float Z\n\
             end_header\n"
        )
    };
    let header = format!("{{'descr': '<f4', 'fortran_order': False, 'shape': ({n}, 3), }}\n");
    let npy = [&b"\x93NUMPY\x01\0"[..], &(header.len() as u16).to_le_bytes(), header.as_bytes()].concat();
    let joined = |head: String, body: Vec<u8>| [head.into_bytes(), body].concat();
    let pose = "0 0 0\n1 0 0\n0 1 0\n0 0 1\n1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n";
    let ptx: String = points.iter().map(|p| format!("{} {} {} 0.5\n", p[0], p[1], p[2])).collect();
    vec![
        (Format::Ply, joined(ply("ascii"), rows.clone().into_bytes())),
        (Format::Ply, joined(ply("binary_little_endian"), floats(false))),
        (Format::Pcd, joined(pcd("ascii"), rows.clone().into_bytes())),
        (Format::Pcd, joined(pcd("binary"), floats(false))),
        (Format::Vtk, joined(vtk("ASCII"), rows.clone().into_bytes())),
        (Format::Vtk, joined(vtk("BINARY"), floats(true))),
        (Format::Npy, [npy, floats(false)].concat()),
        (Format::Off, format!("OFF\n{n} 0 0\n{rows}").into_bytes()),
        (Format::Ptx, format!("{n}\n1\n{pose}{ptx}").into_bytes()),
        (
            Format::Obj,
            points.iter().map(|p| format!("v {} {} {}\n", p[0], p[1], p[2])).collect::<String>().into(),
        ),
    ]
}

/// One damage: bytes changed, removed, doubled or put in.
fn damage(bytes: &[u8], kind: u8, at: usize, byte: u8) -> Vec<u8> {
    let at = at % bytes.len();
    let length = 1 + usize::from(byte) % 40;
    let end = (at + length).min(bytes.len());
    let mut out = bytes.to_vec();
    match kind % 5 {
        0 => out[at] ^= byte.max(1),
        1 => out.truncate(at),
        2 => drop(out.drain(at..end)),
        3 => out.insert(at, byte),
        _ => {
            let part = bytes[at..end].to_vec();
            out.splice(at..at, part);
        }
    }
    out
}

/// Files of each kind: 3,000, or as many as the variable `PROPTEST_CASES` says.
fn cases() -> u32 {
    std::env::var("PROPTEST_CASES").map_or(3000, |n| n.parse().expect("a number of cases"))
}

proptest! {
    #![proptest_config(ProptestConfig { cases: cases(), failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn every_dialect_gives_its_points(dialect in dialects(), points in clouds()) {
        let text = dialect.write(&points);
        let cloud = answers(text.as_bytes(), None);
        let cloud = cloud.unwrap_or_else(|| {
            let e = read_cloud_with(text.as_bytes(), &ReadOptions::default()).unwrap_err();
            panic!("{dialect:?}\n{text}\n{e}")
        });
        prop_assert_eq!(cloud.points.len(), points.len(), "{}", text);
        for (read, written) in cloud.points.iter().zip(&points) {
            for axis in 0..3 {
                let off = (read[axis] - written[axis]).abs();
                prop_assert!(off <= 0.6 * 0.1_f64.powi(dialect.digits as i32) + 1e-6, "{}", text);
            }
        }
        if dialect.header == Header::Names {
            let mut options = ReadOptions::default();
            options.attributes = true;
            let attributes = read_cloud_with(text.as_bytes(), &options).unwrap().attributes;
            prop_assert_eq!(attributes.len(), dialect.before + dialect.behind, "{}", text);
            if dialect.behind > 0 {
                let last = &attributes[attributes.len() - 1].values;
                let written = |i: usize| format!("0.{}", 1 + (i * 7 + dialect.behind - 1) % 9);
                prop_assert!(last.iter().enumerate().all(|(i, x)| x.to_string() == written(i)), "{}", text);
            }
        }
        prop_assert_eq!(dialect.wants_a_warning(), !cloud.warnings.is_empty(), "{:?} {}", cloud.warnings, text);
    }

    #[test]
    fn damaged_text_is_answered(
        dialect in dialects(), points in clouds(), kind: u8, at: usize, byte: u8,
    ) {
        let damaged = damage(dialect.write(&points).as_bytes(), kind, at, byte);
        for format in [None, Some(Format::Xyz), Some(Format::Csv)] {
            answers(&damaged, format);
        }
    }

    #[test]
    fn other_formats_give_their_points_and_answer_to_damage(
        points in clouds(), kind: u8, at: usize, byte: u8, which in 0..10_usize,
    ) {
        let (format, bytes) = &files(&points)[which];
        let cloud = answers(bytes, None).expect("a sound file");
        prop_assert_eq!(cloud.points.len(), points.len());
        prop_assert!(cloud.warnings.is_empty(), "{:?}", cloud.warnings);
        prop_assert!((cloud.points[3][1] - points[3][1]).abs() < 1e-5);
        let damaged = damage(bytes, kind, at, byte);
        answers(&damaged, Some(*format));
        // Bytes cut off at the end: fewer points are an error, or told. An OBJ file does not say how many it has.
        if kind % 5 == 1 && *format != Format::Obj && let Some(read) = answers(&damaged, Some(*format)) {
            let told = !read.warnings.is_empty() || read.points.len() == points.len();
            prop_assert!(told, "{} {:?}", format, String::from_utf8_lossy(&damaged));
        }
        answers(&damaged, None);
    }

    #[test]
    fn every_reader_answers_to_any_bytes(
        bytes in prop::collection::vec(any::<u8>(), 0..300), text in "[0-9a-z .,;\n\t#-]{0,200}",
    ) {
        for format in Format::ALL {
            answers(&bytes, Some(format));
            answers(text.as_bytes(), Some(format));
        }
        answers(&bytes, None);
        answers(text.as_bytes(), None);
    }
}
