//! PLY, text and binary of either byte order.
//!
//! Binary elements are decoded by `ply_rs` behind the header check of [`header`]. Text elements are split in [`text`]:
//! the grammar of `ply_rs` refuses numbers such as `1.` and `.5`, blank lines, and an integer property written as
//! `3.0`, all of which real files have.

use ply_rs::ply::{Encoding, PropertyType, ScalarType};

use super::{Loaded, NORMAL_NAMES, Want};
use crate::{Error, ErrorKind};

mod binary;
mod elements;
mod header;
mod text;
mod write;

use elements::{CORNERS, attributes, axis_of, has_normals};
use header::Header;

pub(super) use write::write;
#[cfg(test)]
pub(super) use write::write_encoded;

/// Whether the first line of the bytes is `ply`.
pub(super) fn looks_like_ply(bytes: &[u8]) -> bool {
    let line = bytes[..bytes.len().min(64)].split(|b| b"\n\r".contains(b)).next().unwrap_or_default();
    line.len() < bytes.len() && line.trim_ascii_end() == b"ply"
}

/// Reads v x 3 positions and, if wanted, polygons cut into f x 3 triangles.
pub(super) fn read(bytes: &[u8], want: Want) -> Result<Loaded, Error> {
    let header = Header::parse(bytes)?;
    if want == Want::Mesh {
        check_faces(&header)?;
    }
    let mut loaded = Loaded { notices: notices(&header, want), ..Loaded::default() };
    if want == Want::Attributes {
        loaded.attributes = header.element("vertex").map_or(Vec::new(), attributes);
    }
    if want != Want::Mesh {
        loaded.ignore_faces(header.element("face").map_or(0, |e| e.count as u64));
    }
    let body = &bytes[header.body..];
    match header.encoding {
        Encoding::Ascii => text::read(&header, body, want, &mut loaded)?,
        Encoding::BinaryLittleEndian | Encoding::BinaryBigEndian => {
            binary::read(&header, body, want, &mut loaded)?;
        }
    }
    Ok(loaded)
}

/// Makes sure that there are faces with exactly one corner list.
fn check_faces(header: &Header) -> Result<(), Error> {
    let Some(face) = header.element("face") else {
        // A cloud is whole but the wrong thing, as an OBJ file without faces is.
        let (kind, what, advice) = if header.element("tristrips").is_some() {
            (ErrorKind::Format, "the file holds triangle strips", "convert them to faces first")
        } else {
            (ErrorKind::Data, "the file has no faces", "give a triangle mesh; this is a point cloud")
        };
        return Err(Error::new(kind, what).advise(advice));
    };
    let lists: Vec<_> = CORNERS.iter().filter_map(|name| face.properties.get(*name)).collect();
    let what = match lists.as_slice() {
        [one] => match &one.data_type {
            PropertyType::List(_, item) if !matches!(item, ScalarType::Float | ScalarType::Double) => {
                return Ok(());
            }
            _ => "there is no integer list vertex_indices or vertex_index",
        },
        [] => "there is no integer list vertex_indices or vertex_index",
        _ => "there are both vertex_indices and vertex_index",
    };
    Err(Error::new(ErrorKind::Format, what)
        .at_element("element face")
        .advise("export the mesh again with its faces as one such list"))
}

fn notices(header: &Header, want: Want) -> Vec<String> {
    let mut notices = Vec::new();
    for e in &header.elements {
        match e.name.as_str() {
            "vertex" => {
                let normals = want != Want::Mesh && has_normals(e);
                let carried = if want == Want::Attributes { attributes(e) } else { Vec::new() };
                let read = |k: &&str| {
                    let is_carried = carried.iter().any(|a| a.name == *k);
                    axis_of(k).is_some() || (normals && NORMAL_NAMES.contains(k)) || is_carried
                };
                let extra: Vec<&str> = e.properties.keys().map(String::as_str).filter(|k| !read(k)).collect();
                let more = if extra.len() > 8 { ", ..." } else { "" };
                let names = extra[..extra.len().min(8)].join(", ");
                match extra.len() {
                    0 => {}
                    1 => notices.push(format!("ignored 1 extra property ({names})")),
                    n => notices.push(format!("ignored {n} extra properties ({names}{more})")),
                }
            }
            "face" => {}
            name => notices.push(format!("ignored {} elements {name}", e.count)),
        }
    }
    notices
}

#[cfg(test)]
mod tests {
    use super::super::encoding::Width;
    use super::*;
    use crate::geometry::{relative_to, widened};
    use ply_rs::parser::Parser;
    use ply_rs::ply::DefaultElement;
    use proptest::prelude::*;

    const ENCODINGS: [Encoding; 3] =
        [Encoding::Ascii, Encoding::BinaryLittleEndian, Encoding::BinaryBigEndian];

    fn message(bytes: &[u8]) -> String {
        read(bytes, Want::Mesh).map(|l| l.verts).unwrap_err().to_string()
    }

    /// A file with two vertices of mixed types, an element to skip, and one face, in each encoding.
    fn mixed(encoding: &Encoding) -> Vec<u8> {
        let header = format!(
            "ply\r\nformat {encoding} 1.0\r\ncomment c\r\nelement skip 1\r\nproperty list uchar short s\r\n\
             property char c\r\nelement vertex 3\r\nproperty double y\r\nproperty uchar red\r\n\
             property short x\r\nproperty list uchar float tags\r\nproperty float32 z\r\nelement face 1\r\n\
             property uchar flags\r\nproperty list int ushort vertex_index\r\nend_header\r\n"
        );
        let mut out = header.into_bytes();
        if *encoding == Encoding::Ascii {
            out.extend(b"2 7 7 -1\r\n\r\n2. 255 1 0 .5\r\n-5e0 0 -4 1 9 6.0\n8 0 +7 2 9 9 9\n1 3 0 1 2");
            return out;
        }
        let big = *encoding == Encoding::BinaryBigEndian;
        let mut put = |little: &[u8]| {
            if big { out.extend(little.iter().rev()) } else { out.extend(little) }
        };
        let vertices: [(i16, f64, f32, &[f32]); 3] =
            [(1, 2.0, 0.5, &[]), (-4, -5.0, 6.0, &[9.0]), (7, 8.0, 9.0, &[9.0, 9.0])];
        put(&[2]);
        put(&7_i16.to_le_bytes());
        put(&7_i16.to_le_bytes());
        put(&[255]);
        for (x, y, z, tags) in vertices {
            put(&y.to_le_bytes());
            put(&[9]);
            put(&x.to_le_bytes());
            put(&[tags.len() as u8]);
            tags.iter().for_each(|t| put(&t.to_le_bytes()));
            put(&z.to_le_bytes());
        }
        put(&[1]);
        put(&3_i32.to_le_bytes());
        (0..3_u16).for_each(|i| put(&i.to_le_bytes()));
        out
    }

    #[test]
    fn reads_mixed_types_orders_and_elements() {
        for encoding in &ENCODINGS {
            let loaded = read(&mixed(encoding), Want::Mesh).unwrap_or_else(|e| panic!("{encoding}: {e}"));
            assert_eq!(loaded.verts, [[1.0, 2.0, 0.5], [-4.0, -5.0, 6.0], [7.0, 8.0, 9.0]], "{encoding}");
            assert_eq!(loaded.faces, [[0, 1, 2]]);
            assert_eq!(loaded.notices, ["ignored 1 elements skip", "ignored 2 extra properties (red, tags)"]);
            let cloud = read(&mixed(encoding), Want::Cloud).unwrap();
            assert_eq!(cloud.verts, loaded.verts);
            assert!(cloud.notices.contains(&"ignored 1 faces; their vertices are the points".to_string()));
        }
    }

    #[test]
    fn normals_of_a_cloud_are_read() {
        let header = |encoding: &Encoding, normal: &str| {
            format!(
                "ply\nformat {encoding} 1.0\nelement vertex 2\nproperty float nx\nproperty float x\n\
                 property float y\nproperty float z\nproperty {normal}\nproperty double nz\nend_header\n"
            )
        };
        let rows = [[0.6, 1.0, 2.0, 3.0, 0.0, -0.8], [2.0, 4.0, 5.0, 6.0, 7.0, f64::NAN]];
        for encoding in &ENCODINGS {
            let mut bytes = header(encoding, "float ny").into_bytes();
            for row in rows {
                for (i, x) in row.into_iter().enumerate() {
                    match encoding {
                        Encoding::Ascii => {
                            bytes.extend(format!("{x}{}", if i == 5 { "\n" } else { " " }).bytes())
                        }
                        Encoding::BinaryLittleEndian if i == 5 => bytes.extend(x.to_le_bytes()),
                        Encoding::BinaryLittleEndian => bytes.extend((x as f32).to_le_bytes()),
                        Encoding::BinaryBigEndian if i == 5 => bytes.extend(x.to_be_bytes()),
                        Encoding::BinaryBigEndian => bytes.extend((x as f32).to_be_bytes()),
                    }
                }
            }
            let cloud = read(&bytes, Want::Cloud).unwrap_or_else(|e| panic!("{encoding}: {e}"));
            assert_eq!(cloud.verts, [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]], "{encoding}");
            assert_eq!(cloud.normals[0], [0.6, 0.0, -0.8]);
            assert!(cloud.normals[1][..2] == [2.0, 7.0] && cloud.normals[1][2].is_nan());
            assert!(cloud.notices.is_empty(), "{:?}", cloud.notices);
        }
        // A list, a missing component, or a mesh: no normals, and it is said.
        let text = |normal: &str, row: &str| {
            let bytes = format!("{}{row}\n{row}\n", header(&Encoding::Ascii, normal)).into_bytes();
            let cloud = read(&bytes, Want::Cloud).unwrap();
            assert!(cloud.normals.is_empty());
            cloud.notices.concat()
        };
        assert!(text("list uchar float ny", "1 2 3 4 1 9 6").contains("(nx, ny, nz)"));
        assert!(text("float n", "1 2 3 4 9 6").contains("(nx, n, nz)"));
    }

    #[test]
    fn corners_may_have_any_integer_type() {
        for (item, width) in
            [("char", 1), ("uint8", 1), ("short", 2), ("ushort", 2), ("int32", 4), ("uint", 4)]
        {
            let mut bytes = format!(
                "ply\nformat binary_little_endian 1.0\nelement vertex 1\nproperty char x\nproperty char y\n\
                 property char z\nelement face 1\nproperty list uchar {item} vertex_indices\n\
                 property list uchar {item} other\nend_header\n"
            )
            .into_bytes();
            bytes.extend([1, 2, 255, 4]);
            for i in 0..4_u32 {
                bytes.extend(&i.to_le_bytes()[..width]);
            }
            bytes.extend([1, 9, 0, 0, 0]);
            bytes.truncate(bytes.len() - 4 + width);
            let loaded = read(&bytes, Want::Mesh).unwrap_or_else(|e| panic!("{item}: {e}"));
            assert_eq!(loaded.verts, [[1.0, 2.0, -1.0]]);
            assert_eq!(loaded.faces, [[0, 1, 2], [0, 2, 3]], "{item}");
        }
    }

    #[test]
    fn errors_name_line_and_element() {
        let file = |body: &str| {
            format!(
                "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
                 element face 1\nproperty list uchar int vertex_indices\nend_header\n{body}"
            )
        };
        let cases = [
            ("0 0 0\n1 0\n0 1 0\n3 0 1 2\n", "line 11: vertex 1: the line ends before property z"),
            ("0 0 0\n1 0 a\n0 1 0\n3 0 1 2\n", "line 11: vertex 1: \"a\" is not a number"),
            ("0 0 0\n1 0 0 5\n0 1 0\n3 0 1 2\n", "line 11: vertex 1: 1 words too many"),
            ("0 0 0\n1 0 nan\n0 1 0\n3 0 1 2\n", "line 11: vertex 1: z is NaN"),
            ("0 0 0\n1 0 0\n0 1 0\n\n2 0 1\n", "line 14: face 0: at least 3 corners expected, 2 found"),
            (
                "0 0 0\n1 0 0\n0 1 0\n4 0 1 2\n",
                "line 13: face 0: the line ends before property vertex_indices",
            ),
            ("0 0 0\n1 0 0\n0 1 0\n-3 0 1 2\n", "\"-3\" is not the length of a list"),
            ("0 0 0\n1 0 0\n0 1 0\n3 0 1 -2\n", "vertex -2 is named"),
            ("0 0 0\n1 0 0\n0 1 0\n3 0 1 1.5\n", "\"1.5\" is not a vertex index"),
            ("0 0 0\n1 0 0\n0 1   0\n\n\n", "face 0: truncated: 1 promised, 0 are whole"),
        ];
        for (body, expected) in cases {
            let text = message(file(body).as_bytes());
            assert!(text.contains(expected), "{body}: {text}");
        }
        let header = |rest: &str| {
            format!(
                "ply\nformat ascii 1.0\nelement vertex 0\nproperty int x\nproperty int y\nproperty int z\n{rest}\
                 end_header\n"
            )
        };
        assert!(message(header("").as_bytes()).contains("no faces; give a triangle mesh"));
        let strips = header("element tristrips 0\nproperty list int int vertex_indices\n");
        assert!(message(strips.as_bytes()).contains("triangle strips"));
        let other = header("element face 0\nproperty int vertex_indices\n");
        assert!(message(other.as_bytes()).contains("no integer list vertex_indices"));
        let both = header(
            "element face 0\nproperty list int int vertex_indices\nproperty list int int vertex_index\n",
        );
        assert!(message(both.as_bytes()).contains("both"));
    }

    #[test]
    fn a_false_list_length_is_a_truncation() {
        let mut bytes =
            b"ply\nformat binary_little_endian 1.0\nelement vertex 0\nproperty int x\nproperty int y\n\
            property int z\nelement face 1\nproperty list uint int vertex_indices\nend_header\n"
                .to_vec();
        bytes.extend([0xff; 20]);
        assert!(message(&bytes).contains("face 0: truncated: 1 promised, 0 are whole"));
        let signed = String::from_utf8_lossy(&bytes[..bytes.len() - 20]).replace("uint", "int").into_bytes();
        let error = read(&[signed, vec![0xff; 20]].concat(), Want::Mesh).map(|l| l.verts).unwrap_err();
        let text = std::error::Error::source(&error).unwrap().to_string();
        assert!(text.contains("List length cannot be negative") && !text.contains('\n'), "{text}");
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]

        /// What is written comes back to the bit, both here and through the plain parser of `ply_rs`.
        #[test]
        fn every_encoding_comes_back(
            verts in prop::collection::vec(prop::array::uniform3(any::<f32>().prop_filter("finite", |x| x.is_finite())), 1..12),
            picks in prop::collection::vec(prop::array::uniform3(0_u32..1000), 0..12),
        ) {
            let faces: Vec<[u32; 3]> = picks.iter().map(|f| f.map(|i| i % verts.len() as u32)).collect();
            for encoding in ENCODINGS {
                let mut bytes = Vec::new();
                write_encoded(&mut bytes, &widened(&verts), Width::Single, &[], Some(&faces), encoding).unwrap();
                let loaded = read(&bytes, Want::Mesh).unwrap();
                let read = relative_to(&loaded.verts, [0.0; 3]);
                prop_assert_eq!(bits(&read), bits(&verts));
                prop_assert_eq!(&loaded.faces, &faces);
                let ply = Parser::<DefaultElement>::new().read_ply(&mut bytes.as_slice()).unwrap();
                let twin: Vec<[f32; 3]> = ply.payload["vertex"]
                    .iter()
                    .map(|v| ["x", "y", "z"].map(|k| v[k].to_f32_lossy().unwrap()))
                    .collect();
                prop_assert_eq!(bits(&twin), bits(&verts));
                let twin: Vec<Vec<u32>> =
                    ply.payload["face"].iter().map(|f| f["vertex_indices"].to_u32_list().unwrap()).collect();
                prop_assert_eq!(twin.concat(), faces.as_flattened());
            }
        }
    }

    #[test]
    fn what_stands_behind_the_last_element_is_told() {
        let header = |encoding: &str| {
            let head = format!("ply\nformat {encoding} 1.0\nelement vertex 1\nproperty double x\n");
            head + "property double y\nproperty double z\nend_header\n"
        };
        let binary = |extra: &[u8]| [header("binary_little_endian").as_bytes(), &[1; 24], extra].concat();
        let text = |extra: &str| (header("ascii") + "1 2 3\n" + extra).into_bytes();
        let warnings = |bytes: Vec<u8>| read(&bytes, Want::Cloud).unwrap().warnings;
        assert!(warnings(binary(b"\n")).is_empty() && warnings(text("\n \n")).is_empty());
        assert!(warnings(binary(&[7; 24]))[0].starts_with("24 bytes behind the last element"));
        assert!(warnings(text("4 5 6\n\n7 8 9\n"))[0].starts_with("2 lines behind the last element"));
    }

    fn bits(points: &[[f32; 3]]) -> Vec<[u32; 3]> {
        points.iter().map(|p| p.map(f32::to_bits)).collect()
    }
}
