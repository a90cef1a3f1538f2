//! The two sides of a comparison: the ground truth and what is held against it, in one frame and sampled.

use super::metrics::Samples;
use crate::error::{Error, ErrorKind};
use crate::geometry::vec3::{unit_vector, wide};
use crate::geometry::{Bounds, Normalizer, TriangleMesh, sample_surface, usable};
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};

/// The surface that a prediction is compared with.
#[derive(Clone, Copy, Debug)]
pub enum GroundTruth<'a> {
    /// A mesh, which is sampled.
    Mesh(&'a TriangleMesh),
    /// Points on the surface, used as they are (a random subset if there are more than asked for).
    Cloud {
        /// Positions, n x 3.
        points: &'a [[f32; 3]],
        /// Normals of any length and sign, n x 3; one of length 0 agrees with nothing.
        normals: Option<&'a [[f32; 3]]>,
    },
}

/// The frame that distances and thresholds are measured in.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum Frame {
    /// The frame of the files.
    AsIs,
    /// The ground truth's bounding box is scaled so that its longest side is 1, and the prediction with it, so that
    /// numbers and thresholds mean the same for every shape.
    #[default]
    GroundTruthUnit,
}

/// Wraps an error so that it says which input it is about, such as `unusable scan`.
pub(super) fn naming(what: &'static str) -> impl Fn(Error) -> Error {
    move |e: Error| Error::new(e.kind(), what).caused_by(e)
}

/// The frame of the comparison.
pub(super) fn frame_of(gt: GroundTruth<'_>, frame: Frame) -> Result<Normalizer, Error> {
    match (frame, gt) {
        (Frame::AsIs, _) => Ok(Normalizer::identity()),
        // Only vertices in use: a stray one would change the scale.
        (Frame::GroundTruthUnit, GroundTruth::Mesh(mesh)) => Normalizer::of(&corners(mesh)?),
        (Frame::GroundTruthUnit, GroundTruth::Cloud { points, .. }) => Normalizer::of(points),
    }
}

/// Samples of one surface in the frame of the comparison: n x 3 points and, if known, unit normals.
pub(super) struct Side {
    pub points: Vec<[f32; 3]>,
    normals: Option<Vec<[f32; 3]>>,
}

impl Side {
    pub fn of_mesh(mesh: &TriangleMesh, count: usize, seed: u64) -> Result<Side, Error> {
        let samples = sample_surface(mesh, count, seed)?;
        within_reach(&samples.points)?;
        Ok(Side { points: samples.points, normals: Some(samples.normals) })
    }

    /// At most `most` of the points.
    #[track_caller]
    pub fn of_cloud(
        points: &[[f32; 3]],
        normals: Option<&[[f32; 3]]>,
        frame: &Normalizer,
        most: usize,
        seed: u64,
    ) -> Result<Side, Error> {
        // Checked here in every frame, so that a bad point is an error and not a panic further down.
        Bounds::of(points)?;
        if let Some(n) = normals {
            assert!(n.len() == points.len(), "a cloud of {} points has {} normals", points.len(), n.len());
            if let Some(i) = n.iter().position(|n| n.iter().any(|x| !x.is_finite())) {
                return Err(Error::new(ErrorKind::Data, "the normal is not finite")
                    .at_element(format!("point {i}"))
                    .advise("repair it or leave the normals out"));
            }
        }
        let (points, normals) = subset(&frame.forward(points), normals, most, seed);
        within_reach(&points)?;
        Ok(Side { points, normals: normals.map(|n| n.into_iter().map(unit).collect()) })
    }

    pub fn samples(&self) -> Samples<'_> {
        Samples::new(&self.points, self.normals.as_deref())
    }
}

/// Refuses points that are too far out for their squared distances.
fn within_reach(points: &[[f32; 3]]) -> Result<(), Error> {
    match points.iter().find(|p| !usable(p)) {
        None => Ok(()),
        Some(p) => {
            Err(Error::new(ErrorKind::Data, format!("it reaches to {p:?}, in units of the comparison"))
                .advise("remove what is far away, or check the units of both files"))
        }
    }
}

pub(super) fn moved(mesh: &TriangleMesh, frame: &Normalizer) -> TriangleMesh {
    TriangleMesh { verts: frame.forward(&mesh.verts), faces: mesh.faces.clone() }
}

/// The vector at length 1; 0 stays 0.
fn unit(n: [f32; 3]) -> [f32; 3] {
    unit_vector(wide(n)).map_or([0.0; 3], |unit| unit.map(|x| x as f32))
}

/// The corner positions of all faces, with repetition.
fn corners(mesh: &TriangleMesh) -> Result<Vec<[f32; 3]>, Error> {
    let corner = |(f, &v): (usize, &u32)| {
        mesh.verts.get(v as usize).copied().ok_or_else(|| {
            Error::new(ErrorKind::Data, format!("vertex {v} of {} does not exist", mesh.verts.len()))
                .at_element(format!("face {}", f / 3))
                .advise("repair the mesh")
        })
    };
    mesh.faces.as_flattened().iter().enumerate().map(corner).collect()
}

/// `count` of the points with their normals, drawn without repetition; all of them in order if there are no more.
fn subset(
    points: &[[f32; 3]],
    normals: Option<&[[f32; 3]]>,
    count: usize,
    seed: u64,
) -> (Vec<[f32; 3]>, Option<Vec<[f32; 3]>>) {
    let mut index: Vec<usize> = (0..points.len()).collect();
    if count < index.len() {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        for i in 0..count {
            let j = rng.random_range(i..index.len());
            index.swap(i, j);
        }
        index.truncate(count);
    }
    let pick = |all: &[[f32; 3]]| index.iter().map(|&i| all[i]).collect();
    (pick(points), normals.map(pick))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::AnalyticShape;

    #[test]
    fn a_subset_has_no_point_twice_and_the_normals_of_its_points() {
        let (points, normals) = AnalyticShape::Sphere { radius: 1.0 }.sample(3000, 5);
        let (few, of_few) = subset(&points, Some(&normals), 1000, 1);
        for (p, n) in few.iter().zip(of_few.unwrap()) {
            let i = points.iter().position(|q| q == p).unwrap();
            assert_eq!(normals[i], n);
        }
        let mut sorted = few.clone();
        sorted.sort_by(|a, b| a.partial_cmp(b).unwrap());
        sorted.dedup();
        assert_eq!((few.len(), sorted.len()), (1000, 1000));
        assert_eq!(subset(&points, None, 3000, 1), (points, None));
    }
}
