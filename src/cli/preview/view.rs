//! Where a picture is taken from.

use std::path::PathBuf;
use std::str::FromStr;

use clap::{Args, ValueEnum};

/// Options of a picture.
#[derive(Debug, Default, Args)]
pub struct ViewArgs {
    /// Write a picture of the points and the mesh, side by side (png)
    #[arg(long, value_name = "FILE")]
    pub preview: Option<PathBuf>,
    /// Direction the picture is taken from, in degrees: around the upward axis, and above the horizon
    #[arg(long, value_name = "AROUND,ABOVE", allow_hyphen_values = true, requires = "preview")]
    view: Option<Angles>,
    /// Upward axis of the picture
    #[arg(long, value_enum, default_value_t = Axis::Y, requires = "preview")]
    up: Axis,
}

/// Where the camera is, in degrees.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Angles {
    pub around: f64,
    pub above: f64,
}

impl Default for Angles {
    fn default() -> Self {
        Angles { around: 35.0, above: 28.0 }
    }
}

impl FromStr for Angles {
    type Err = String;

    fn from_str(s: &str) -> Result<Self, String> {
        let numbers: Option<Vec<f64>> = s.split(',').map(|x| x.trim().parse().ok()).collect();
        match numbers.as_deref() {
            Some(&[around, above]) if around.is_finite() && above.is_finite() => Ok(Angles { around, above }),
            _ => Err("two numbers expected, such as 35,25".into()),
        }
    }
}

/// An axis of the input's coordinates.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub enum Axis {
    /// x
    X,
    /// y
    #[default]
    Y,
    /// z
    Z,
}

/// How to look at the scene.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct View {
    /// Where from.
    pub angles: Angles,
    /// The axis that points up in the picture.
    pub up: Axis,
}

impl Default for View {
    fn default() -> Self {
        View { angles: Angles::default(), up: Axis::Y }
    }
}

impl From<&ViewArgs> for View {
    fn from(args: &ViewArgs) -> Self {
        View { angles: args.view.unwrap_or_default(), up: args.up }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn angles_are_read() {
        assert_eq!("-10, 45".parse(), Ok(Angles { around: -10.0, above: 45.0 }));
        for bad in ["", "1", "1,2,3", "a,b", "nan,1"] {
            assert!(bad.parse::<Angles>().is_err());
        }
    }
}
