//! `--codes`: points, S and grid vertices in the colours of their codes.

use std::path::{Path, PathBuf};

use bijective_sdf::bsp::code_colour;
use bijective_sdf::geometry::widened;
use bijective_sdf::io::{Encoding, write_coloured_cloud_to};
use bijective_sdf::reconstruct::Coded;

use super::failure::Failure;
use super::output::{short_enough, write_bytes};

/// What comes behind the stem, file by file.
const PARTS: [&str; 6] = ["points", "codes", "surface", "patches", "grid", "moved"];

/// The files that a stem stands for. A stem that ends in `.ply` is taken without it.
#[derive(Clone, Debug)]
pub struct CodesFiles {
    pub paths: Vec<PathBuf>,
    encoding: Encoding,
}

impl CodesFiles {
    pub fn new(stem: &Path, ascii: bool) -> Self {
        let stem =
            if stem.extension().is_some_and(|e| e == "ply") { stem.with_extension("") } else { stem.into() };
        let path = |part: &&str| {
            let mut name = stem.as_os_str().to_os_string();
            name.push(format!("-{part}.ply"));
            PathBuf::from(name)
        };
        let encoding = if ascii { Encoding::Ascii } else { Encoding::Binary };
        CodesFiles { paths: PARTS.iter().map(path).collect(), encoding }
    }

    /// Writes all files, each whole or not at all.
    pub fn write(&self, coded: &Coded) -> Result<(), Failure> {
        let [points, codes, surface, patches, grid, moved] = &self.paths[..] else { return Ok(()) };
        self.write_one(points, &coded.points, &coded.codes)?;
        self.write_one(codes, &widened(&coded.codes), &coded.codes)?;
        self.write_one(surface, &coded.surface, &coded.patches)?;
        self.write_one(patches, &widened(&coded.patches), &coded.patches)?;
        self.write_one(grid, &coded.verts, &coded.vert_codes)?;
        self.write_one(moved, &coded.moved, &coded.vert_codes)
    }

    fn write_one(&self, path: &Path, points: &[[f64; 3]], codes: &[[f32; 3]]) -> Result<(), Failure> {
        let colours: Vec<[u8; 3]> = codes.iter().map(|&code| code_colour(code)).collect();
        let mut bytes = Vec::new();
        write_coloured_cloud_to(&mut bytes, &short_enough(points), &colours, self.encoding)
            .map_err(Failure::Output)?;
        write_bytes(path, &bytes)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_follow_the_stem() {
        for stem in ["a/b.c", "a/b.c.ply"] {
            let files = CodesFiles::new(Path::new(stem), false);
            assert_eq!(files.paths[1], Path::new("a/b.c-codes.ply"));
            assert_eq!(files.paths.len(), PARTS.len());
        }
    }
}
