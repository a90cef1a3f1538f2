//! The surface of least bending through points, whatever their number: one thin plate, or for more points than that can
//! have, one of each part of them.

use super::forecast::{Forecast, covariances, forecasts};
use super::local_plates::LocalPlates;
use super::plate::{MAX_CENTRES, System, ThinPlate, directions};
use crate::error::Error;

/// Points up to which the surface of least bending is worth its time, which grows with their number
/// (`benches/method.md`).
pub(crate) const MAX_PLATE_POINTS: usize = 1 << 18;

/// A function that is 0 at given points, has about unit gradient there, and bends little.
#[derive(Clone, Debug)]
pub(crate) enum LeastBending {
    Whole(ThinPlate),
    Local(LocalPlates),
}

impl LeastBending {
    /// The functions for `points` (n x 3, distinct, working frame) from each of several guesses of the normals (each
    /// n x 3, outward, need not be exact; zero is no direction), in their order.
    ///
    /// # Errors
    /// [`Data`](crate::ErrorKind::Data) if the points, or those of a part of them, determine no plate.
    ///
    /// # Panics
    /// If a guess does not have one normal a point.
    #[track_caller]
    pub fn fit_each(points: &[[f32; 3]], guesses: &[Vec<[f32; 3]>]) -> Result<Vec<Self>, Error> {
        Ok(if points.len() <= MAX_CENTRES {
            ThinPlate::fit_each(points, guesses)?.into_iter().map(Self::Whole).collect()
        } else {
            LocalPlates::fit_each(points, guesses)?.into_iter().map(Self::Local).collect()
        })
    }

    /// The function for one guess of the normals, and the leave-one-out forecast at each point (n).
    ///
    /// # Errors
    /// As [`fit_each`](Self::fit_each).
    ///
    /// # Panics
    /// As [`fit_each`](Self::fit_each).
    #[track_caller]
    pub fn fit_with_forecasts(
        points: &[[f32; 3]],
        normals: &[[f32; 3]],
    ) -> Result<(Self, Vec<Forecast>), Error> {
        if points.len() > MAX_CENTRES {
            let (plates, found) = LocalPlates::fit_with_forecasts(points, normals)?;
            return Ok((Self::Local(plates), found));
        }
        let centres: Vec<[f64; 3]> = points.iter().map(|p| p.map(f64::from)).collect();
        let system = System::determined(&centres)?;
        let gradients = system.least_bending(directions(normals));
        let found = forecasts(&system, &covariances(&system), &gradients);
        Ok((Self::Whole(system.interpolant(&centres, &gradients)), found))
    }

    /// Values at `x` (m x 3), whose nearest points are `nearest` (m): negative inside, near the points about the signed
    /// distance; NaN where no plate reaches, which is beyond some neighbour spacings of the points only.
    pub fn value(&self, x: &[[f32; 3]], nearest: &[u32]) -> Vec<f32> {
        match self {
            Self::Whole(plate) => plate.value(x),
            Self::Local(plates) => plates.value(x, nearest),
        }
    }
}
