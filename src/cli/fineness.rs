//! How fine the mesh is taken from the field.

use std::str::FromStr;

use bijective_sdf::Error;
use bijective_sdf::geometry::TriangleMesh;
use bijective_sdf::reconstruct::{Config, Reconstruction};
use clap::Args;
use clap::builder::TypedValueParser;

use super::Common;
use super::failure::Failure;
use super::machine::check_memory;

/// Cubes along each side of the grid that the mesh of a small cloud is taken from.
pub const RESOLUTION: usize = 128;
/// Points beyond which that grid may be coarser than they are.
const FEW_POINTS: usize = 4096;
/// What asks for cells as fine as the points.
const POINTS: &str = "points";

/// Parses the cubes of commands that only work with small clouds.
pub fn resolution_parser() -> impl TypedValueParser<Value = usize> {
    clap::value_parser!(u16).range(8..=1024).map(usize::from)
}

/// Option `--resolution` of the commands that make one mesh.
#[derive(Args, Clone, Copy, Debug)]
pub struct FinenessArgs {
    /// Cubes along the longest side of the grid that the mesh is taken from, 8 to 1024, where what is thinner than a
    /// cube may get lost; or `points`: cells that are everywhere about half as large as the points lie apart [default:
    /// 128 for up to 4096 points, else points]
    #[arg(long, value_name = "CUBES|points")]
    resolution: Option<Fineness>,
}

/// How large the cells are that a mesh is taken from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fineness {
    /// So many along the longest side.
    Cubes(usize),
    /// As the points lie apart.
    Points,
}

impl FromStr for Fineness {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text.parse::<usize>() {
            Ok(cubes) if (8..=1024).contains(&cubes) => Ok(Self::Cubes(cubes)),
            Ok(cubes) => Err(format!("{cubes} is not in 8..=1024")),
            Err(_) if text == POINTS => Ok(Self::Points),
            Err(_) => Err(format!("neither a number nor `{POINTS}`")),
        }
    }
}

impl FinenessArgs {
    /// What is asked for, or else what suits so many points.
    pub fn of(self, points: usize) -> Fineness {
        let usual = if points > FEW_POINTS { Fineness::Points } else { Fineness::Cubes(RESOLUTION) };
        self.resolution.unwrap_or(usual)
    }

    /// Says that the mesh of so many points is taken from cells of another size than that of smaller clouds, unless the
    /// size was asked for.
    pub fn tell(self, points: usize, common: Common) {
        if self.resolution.is_none() && self.of(points) == Fineness::Points {
            common.note("the mesh has cells as fine as the points, as with --resolution points");
        }
    }

    /// Refuses a run whose grids need more memory than there is, see [`check_memory`].
    pub fn check(self, config: &Config, common: Common) -> Result<(), Failure> {
        match self.resolution {
            Some(Fineness::Cubes(cubes)) => check_memory(config, cubes, common),
            _ => check_memory(config, RESOLUTION, common),
        }
    }

    /// What asks for the same on a command line, with a space before it; empty where nothing was asked for.
    pub fn again(self) -> String {
        self.resolution.map_or(String::new(), |fineness| format!(" --resolution {}", fineness.text()))
    }
}

impl Fineness {
    /// As on the command line.
    pub fn text(self) -> String {
        match self {
            Self::Cubes(cubes) => cubes.to_string(),
            Self::Points => POINTS.into(),
        }
    }

    /// As a value of JSON.
    pub fn json(self) -> String {
        match self {
            Self::Cubes(cubes) => cubes.to_string(),
            Self::Points => format!("\"{POINTS}\""),
        }
    }

    /// The mesh of a field.
    pub fn mesh(self, field: &Reconstruction) -> Result<TriangleMesh<[f64; 3]>, Error> {
        match self {
            Self::Cubes(cubes) => field.mesh(cubes),
            Self::Points => field.graded_mesh(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_and_the_word_are_read_and_nothing_else() {
        for (text, want) in
            [("8", Fineness::Cubes(8)), ("1024", Fineness::Cubes(1024)), ("points", Fineness::Points)]
        {
            assert_eq!(text.parse(), Ok(want));
            assert_eq!(want.text(), text);
        }
        for text in ["7", "1025", "-3", "Points", "", "12.5"] {
            assert!(text.parse::<Fineness>().is_err(), "{text}");
        }
    }

    #[test]
    fn large_clouds_have_cells_as_fine_as_their_points() {
        let none = FinenessArgs { resolution: None };
        assert_eq!([none.of(300), none.of(4096)], [Fineness::Cubes(128); 2]);
        assert_eq!(none.of(4097), Fineness::Points);
        let some = FinenessArgs { resolution: Some(Fineness::Cubes(20)) };
        assert_eq!(some.of(100_000), Fineness::Cubes(20));
        assert_eq!((none.again(), some.again()), (String::new(), " --resolution 20".into()));
    }
}
