//! The first shape: a closed mesh found among the working points, for the field to learn and for S to cover.

use super::{Config, StartShape};
use crate::error::Error;
use crate::geometry::{TriangleBvh, TriangleMesh};
use crate::start::{
    DENOISED_POINTS, Denoised, GaussField, MAX_PLATE_POINTS, ShapeFit, best_fitting, denoise, gauss_shapes,
    plate_shapes,
};

/// Radii of dipoles that are tried where `start.dipole_radius` is `None`, in neighbour spacings.
const DIPOLE_RADII: [f32; 3] = [0.25, 0.5, 1.0];

/// The most working points for which all of these radii are tried.
const MAX_RADII_POINTS: usize = 1024;

/// The indicator of the Gauss formula at points of a closed surface ([`GaussField::at_points`]) is 1/2 if the normals
/// point outward and -1/2 if they point inward, as those of a room scanned from inside; -0.3 or so if half of the room
/// is missing, and 0 for a sheet. Below this median over the working points, the given normals count as inward.
const WITHIN: f32 = -0.1;

/// The shape that a run begins with.
pub(super) struct FirstShape {
    /// The shape, a closed mesh in the working frame.
    pub mesh: TriangleMesh,
    /// The field's regression to it.
    pub fit: ShapeFit,
    /// The denoised points, if option `denoise` is on and noise was found; the shape was then found for these.
    pub denoised: Option<Denoised>,
    /// The area of the shape, working frame.
    pub area: f64,
    /// Outward unit normals of the mesh nearest to the denoised points, n x 3.
    pub normals: Vec<[f32; 3]>,
    /// Whether the given normals point inward; the mesh then bounds the free space, not the solid.
    pub turned: bool,
}

impl FirstShape {
    /// The shape for the `working` points (n x 3, working frame), with `normals` at them (n x 3, of unit length or
    /// zero) if the caller gave some; `None` if the field starts as a sphere, which needs no mesh.
    ///
    /// # Errors
    /// As [`gauss_shapes`].
    pub fn find(
        working: &[[f32; 3]],
        normals: Option<&[[f32; 3]]>,
        config: &Config,
    ) -> Result<Option<Self>, Error> {
        let (start, seed) = (config.start, config.seed);
        if start.shape == StartShape::Sphere {
            return Ok(None);
        }
        let radii = match &start.dipole_radius {
            // For more points no gain was measured that would be worth the time.
            None if working.len() > MAX_RADII_POINTS => &DIPOLE_RADII[1..2],
            None => &DIPOLE_RADII[..],
            Some(radius) => std::slice::from_ref(radius),
        };
        let turned = normals
            .is_some_and(|normals| GaussField::of_normals(working, normals, 1.0, seed).at_points() < WITHIN);
        let outward = normals.map(|normals| match turned {
            true => normals.iter().map(|n| n.map(|x| -x)).collect(),
            false => normals.to_vec(),
        });
        let sides = outward.as_deref();
        let mut rough = gauss_shapes(working, sides, radii, start.regularity, seed)?;
        let denoised = if config.denoise && DENOISED_POINTS.contains(&working.len()) {
            let best = best_fitting(&rough, working, seed)?;
            denoise(working, &TriangleBvh::new(&rough[best])?.normals_near(working))
        } else {
            None
        };
        let points = denoised.as_ref().map_or(working, |denoised| &denoised.points);
        let plates = match start.shape {
            StartShape::Plate if points.len() <= MAX_PLATE_POINTS => plate_shapes(points, sides, &rough).ok(),
            _ => None,
        };
        let mesh = match plates {
            Some(mut plates) => plates.swap_remove(best_fitting(&plates, points, seed)?),
            // Points that determine no surface of least bending still have the rough ones.
            None => rough.swap_remove(best_fitting(&rough, points, seed)?),
        };
        let normals = TriangleBvh::new(&mesh)?.normals_near(points);
        let (area, fit) = (mesh.topology().area, ShapeFit::new(&mesh, seed)?);
        Ok(Some(FirstShape { mesh, fit, denoised, area, normals, turned }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::fibonacci_sphere;

    fn sphere(n: usize) -> Vec<[f32; 3]> {
        fibonacci_sphere(n).into_iter().map(|p| p.map(|x| 0.5 * x)).collect()
    }

    #[test]
    fn normals_point_outward() {
        let working = sphere(120);
        let shape = FirstShape::find(&working, None, &Config::default()).unwrap().unwrap();
        for (p, n) in working.iter().zip(&shape.normals) {
            let cos: f32 = (0..3).map(|d| 2.0 * p[d] * n[d]).sum();
            assert!(cos > 0.95, "{p:?} {n:?}");
        }
    }

    #[test]
    fn a_sphere_needs_no_shape() {
        let mut config = Config::default();
        config.start.shape = StartShape::Sphere;
        assert!(FirstShape::find(&sphere(50), None, &config).unwrap().is_none());
    }
}
