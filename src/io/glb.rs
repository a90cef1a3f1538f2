//! GLB, the binary form of glTF 2.0; meshes are written only.
//!
//! Positions are of 32 bits, as the format has no others; the offset of large coordinates is the translation of the
//! node, whose numbers are text. Axes stay as they are, though viewers of this format show y as upward.

use std::io::{self, Write};

use crate::geometry::{Bounds, TriangleMesh};

// Component types and buffer targets of glTF 2.0.
const FLOAT: u32 = 5126;
const UNSIGNED: u32 = 5125;
const ARRAY_BUFFER: u32 = 34962;
const ELEMENT_ARRAY_BUFFER: u32 = 34963;

/// Writes a mesh that has vertices, with a colour each, if there are some.
pub(super) fn write(
    out: &mut dyn Write,
    mesh: &TriangleMesh<[f64; 3]>,
    colours: Option<&[[f32; 3]]>,
) -> io::Result<()> {
    let offset = mesh.offset();
    let local = mesh.relative_to(offset);
    let bounds = Bounds::of(&local.verts).map_err(io::Error::other)?;
    let numbers = |p: [f64; 3]| format!("[{:?},{:?},{:?}]", p[0] as f32, p[1] as f32, p[2] as f32);
    let (v, f) = (local.verts.len(), local.faces.len());
    let place = match offset {
        [0.0, 0.0, 0.0] => String::new(),
        [x, y, z] => format!(",\"translation\":[{x:?},{y:?},{z:?}]"),
    };
    let places = 12 * v;
    let (mut named, mut accessor, mut view, mut bytes) = ("", String::new(), String::new(), 12 * (v + f));
    if colours.is_some() {
        named = ",\"COLOR_0\":2";
        accessor = format!(",{{\"bufferView\":2,\"componentType\":{FLOAT},\"count\":{v},\"type\":\"VEC3\"}}");
        view = format!(
            ",{{\"buffer\":0,\"byteOffset\":{bytes},\"byteLength\":{places},\"target\":{ARRAY_BUFFER}}}"
        );
        bytes += places;
    }
    let mut json = format!(
        "{{\"asset\":{{\"version\":\"2.0\",\"generator\":\"bijective-sdf\"}},\"scene\":0,\
         \"scenes\":[{{\"nodes\":[0]}}],\"nodes\":[{{\"mesh\":0{place}}}],\
         \"meshes\":[{{\"primitives\":[{{\"attributes\":{{\"POSITION\":0{named}}},\"indices\":1}}]}}],\
         \"accessors\":[{{\"bufferView\":0,\"componentType\":{FLOAT},\"count\":{v},\"type\":\"VEC3\",\
         \"min\":{},\"max\":{}}},\
         {{\"bufferView\":1,\"componentType\":{UNSIGNED},\"count\":{},\"type\":\"SCALAR\"}}{accessor}],\
         \"bufferViews\":[{{\"buffer\":0,\"byteLength\":{},\"target\":{ARRAY_BUFFER}}},\
         {{\"buffer\":0,\"byteOffset\":{},\"byteLength\":{},\"target\":{ELEMENT_ARRAY_BUFFER}}}{view}],\
         \"buffers\":[{{\"byteLength\":{}}}]}}",
        numbers(bounds.min),
        numbers(bounds.max),
        3 * f,
        places,
        places,
        12 * f,
        bytes
    );
    // Chunks end at multiples of 4 bytes.
    while json.len() % 4 != 0 {
        json.push(' ');
    }
    let data = bytes as u64;
    let total = 12 + 8 + json.len() as u64 + 8 + data;
    let length =
        |n: u64| u32::try_from(n).map_err(|_| io::Error::other("the mesh is too large for a GLB file"));
    out.write_all(b"glTF\x02\0\0\0")?;
    out.write_all(&length(total)?.to_le_bytes())?;
    out.write_all(&length(json.len() as u64)?.to_le_bytes())?;
    out.write_all(b"JSON")?;
    out.write_all(json.as_bytes())?;
    out.write_all(&length(data)?.to_le_bytes())?;
    out.write_all(b"BIN\0")?;
    for x in local.verts.as_flattened() {
        out.write_all(&x.to_le_bytes())?;
    }
    for i in local.faces.as_flattened() {
        out.write_all(&i.to_le_bytes())?;
    }
    for &part in colours.unwrap_or_default().as_flattened() {
        out.write_all(&linear(part).to_le_bytes())?;
    }
    Ok(())
}

/// The linear value (0 to 1) of a colour component in sRGB (0 to 1): glTF stores linear ones.
fn linear(part: f32) -> f32 {
    if part <= 0.04045 { part / 12.92 } else { ((part + 0.055) / 1.055).powf(2.4) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn chunks_and_numbers_are_where_the_format_has_them() {
        for at in [0.0, 5_411_234.5] {
            let verts = vec![[at, 0.0, 0.0], [at + 1.0, 0.5, 0.0], [at, 1.0, 0.25]];
            let mesh = TriangleMesh { verts, faces: vec![[0, 1, 2]] };
            let mut out = Vec::new();
            write(&mut out, &mesh, None).unwrap();
            let word = |at: usize| u32::from_le_bytes(out[at..at + 4].try_into().unwrap()) as usize;
            assert_eq!((&out[..4], word(4), word(8)), (&b"glTF"[..], 2, out.len()));
            let json: serde_json::Value = serde_json::from_slice(&out[20..20 + word(12)]).unwrap();
            assert_eq!(json["buffers"][0]["byteLength"], 48);
            assert_eq!(json["accessors"][1]["count"], 3);
            let shift = json["nodes"][0]["translation"][0].as_f64().unwrap_or(0.0);
            assert_eq!(shift == 0.0, at == 0.0);
            let low = json["accessors"][0]["min"][0].as_f64().unwrap();
            assert_eq!(low + shift, at);
            let data = 20 + word(12) + 8;
            assert_eq!((word(data - 8), &out[data - 4..data]), (48, &b"BIN\0"[..]));
            let x = f32::from_le_bytes(out[data + 12..data + 16].try_into().unwrap());
            assert_eq!(f64::from(x) + shift, at + 1.0);
            assert_eq!((word(data + 36), word(data + 40), word(data + 44)), (0, 1, 2));
        }
    }

    #[test]
    fn colours_stand_behind_the_faces_and_count_light() {
        let verts = vec![[0.0; 3], [1.0, 0.5, 0.0], [0.0, 1.0, 0.25]];
        let mesh = TriangleMesh { verts, faces: vec![[0, 1, 2]] };
        let mut out = Vec::new();
        write(&mut out, &mesh, Some(&[[0.0, 1.0, 0.5], [0.0; 3], [1.0; 3]])).unwrap();
        let length = u32::from_le_bytes(out[12..16].try_into().unwrap()) as usize;
        let json: serde_json::Value = serde_json::from_slice(&out[20..20 + length]).unwrap();
        assert_eq!(json["meshes"][0]["primitives"][0]["attributes"]["COLOR_0"], 2);
        let view = &json["bufferViews"][json["accessors"][2]["bufferView"].as_u64().unwrap() as usize];
        assert_eq!((&view["byteOffset"], &view["byteLength"]), (&48.into(), &36.into()));
        assert_eq!((json["buffers"][0]["byteLength"].as_u64(), out.len()), (Some(84), 20 + length + 8 + 84));
        let at = 20 + length + 8 + 48;
        let part = |i: usize| f32::from_le_bytes(out[at + 4 * i..at + 4 * i + 4].try_into().unwrap());
        assert_eq!([part(0), part(1), part(8)], [0.0, 1.0, 1.0]);
        // Half the value of a picture is some fifth of the light.
        assert!((part(2) - 0.214).abs() < 1e-3, "{}", part(2));
    }
}
