//! Values on a regular grid, for programs that work with volumes: NPY, NRRD and VTI.

use std::fmt;
use std::io::{self, Write};
use std::path::Path;

use super::write::failed;
use crate::Error;

/// Values at the vertices of a grid of cubes.
#[derive(Clone, Debug, PartialEq)]
pub struct GridValues {
    /// Place of the first vertex, which has the least coordinates.
    pub origin: [f64; 3],
    /// Side of a cube, in the unit of the place.
    pub spacing: f64,
    /// Vertices along x, y and z.
    pub size: [usize; 3],
    /// The values, as many as the product of the sizes; x runs fastest, z slowest.
    pub values: Vec<f32>,
}

/// A format of volumes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum GridFormat {
    /// A NumPy array with the indices x, y, z; it has no room for place and spacing.
    Npy,
    /// Nearly raw raster data (Teem, ITK, 3D Slicer).
    Nrrd,
    /// Image data of the Visualization Toolkit (ParaView).
    Vti,
}

impl GridFormat {
    /// Every format.
    pub const ALL: [GridFormat; 3] = [GridFormat::Npy, GridFormat::Nrrd, GridFormat::Vti];

    /// Its name, which is also the extension of its files.
    pub fn name(self) -> &'static str {
        match self {
            GridFormat::Npy => "npy",
            GridFormat::Nrrd => "nrrd",
            GridFormat::Vti => "vti",
        }
    }

    /// The format that the extension of a path means, in any letter case.
    pub fn from_path(path: impl AsRef<Path>) -> Option<GridFormat> {
        let extension = path.as_ref().extension()?.to_str()?.to_ascii_lowercase();
        GridFormat::ALL.into_iter().find(|format| format.name() == extension)
    }
}

impl fmt::Display for GridFormat {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// Writes values on a grid to any writer. Give a buffered writer.
///
/// # Errors
///
/// [`Io`](crate::ErrorKind::Io) if writing fails.
///
/// # Panics
///
/// If there is not one value a vertex.
#[track_caller]
pub fn write_grid_to(mut out: impl Write, grid: &GridValues, format: GridFormat) -> Result<(), Error> {
    let count = grid.size.iter().product::<usize>();
    assert!(grid.values.len() == count, "write_grid_to: {} values at {count} vertices", grid.values.len());
    emit(&mut out, grid, format).and_then(|()| out.flush()).map_err(failed)
}

fn emit(out: &mut dyn Write, grid: &GridValues, format: GridFormat) -> io::Result<()> {
    let ([nx, ny, nz], [x, y, z], h) = (grid.size, grid.origin, grid.spacing);
    match format {
        GridFormat::Npy => {
            let mut header =
                format!("{{'descr': '<f4', 'fortran_order': True, 'shape': ({nx}, {ny}, {nz}), }}");
            // The data begin at a multiple of 64 bytes, behind a line break.
            while (10 + header.len() + 1) % 64 != 0 {
                header.push(' ');
            }
            header.push('\n');
            out.write_all(b"\x93NUMPY\x01\x00")?;
            out.write_all(&(header.len() as u16).to_le_bytes())?;
            out.write_all(header.as_bytes())?;
            data(out, grid)
        }
        GridFormat::Nrrd => {
            write!(
                out,
                "NRRD0004\ntype: float\ndimension: 3\nspace dimension: 3\nsizes: {nx} {ny} {nz}\n\
                 space directions: ({h},0,0) (0,{h},0) (0,0,{h})\nspace origin: ({x},{y},{z})\n\
                 kinds: domain domain domain\nendian: little\nencoding: raw\n\n"
            )?;
            data(out, grid)
        }
        GridFormat::Vti => {
            let extent = format!("0 {} 0 {} 0 {}", nx - 1, ny - 1, nz - 1);
            write!(
                out,
                "<?xml version=\"1.0\"?>\n<VTKFile type=\"ImageData\" version=\"1.0\" byte_order=\"LittleEndian\" \
                 header_type=\"UInt64\">\n<ImageData WholeExtent=\"{extent}\" Origin=\"{x} {y} {z}\" \
                 Spacing=\"{h} {h} {h}\">\n<Piece Extent=\"{extent}\">\n<PointData Scalars=\"sdf\">\n\
                 <DataArray type=\"Float32\" Name=\"sdf\" format=\"appended\" offset=\"0\"/>\n</PointData>\n</Piece>\n\
                 </ImageData>\n<AppendedData encoding=\"raw\">\n_"
            )?;
            out.write_all(&(4 * grid.values.len() as u64).to_le_bytes())?;
            data(out, grid)?;
            out.write_all(b"\n</AppendedData>\n</VTKFile>\n")
        }
    }
}

fn data(out: &mut dyn Write, grid: &GridValues) -> io::Result<()> {
    grid.values.iter().try_for_each(|x| out.write_all(&x.to_le_bytes()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn headers_say_where_the_values_are() {
        let grid = GridValues {
            origin: [450_123.4, -2.0, 0.5],
            spacing: 0.25,
            size: [2, 3, 4],
            values: (0..24).map(|i| i as f32).collect(),
        };
        let raw: Vec<u8> = grid.values.iter().flat_map(|x| x.to_le_bytes()).collect();
        for format in GridFormat::ALL {
            let mut out = Vec::new();
            write_grid_to(&mut out, &grid, format).unwrap();
            assert!(out.windows(raw.len()).any(|w| w == raw), "{format}");
            let text = String::from_utf8_lossy(&out);
            let parts: &[&str] = match format {
                GridFormat::Npy => &["'shape': (2, 3, 4)", "'fortran_order': True"],
                GridFormat::Nrrd => &["sizes: 2 3 4\n", "space origin: (450123.4,-2,0.5)\n", "(0.25,0,0)"],
                GridFormat::Vti => &["WholeExtent=\"0 1 0 2 0 3\"", "Origin=\"450123.4 -2 0.5\""],
            };
            assert!(parts.iter().all(|part| text.contains(part)), "{text}");
        }
        let mut npy = Vec::new();
        write_grid_to(&mut npy, &grid, GridFormat::Npy).unwrap();
        assert_eq!(npy.len(), 128 + raw.len());
        assert_eq!(GridFormat::from_path("a/b.NRRD"), Some(GridFormat::Nrrd));
        assert_eq!(GridFormat::from_path("a.vtk"), None);
    }
}
