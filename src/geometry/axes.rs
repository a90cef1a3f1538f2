//! Principal axes: the three directions at right angles in which points extend the most, the least, and in between.

use nalgebra::{Matrix3, SymmetricEigen, Vector3};

/// The principal axes of some vectors, in no particular order.
#[derive(Clone, Debug)]
pub(crate) struct PrincipalAxes {
    /// The axes as columns, of unit length and either sign.
    pub directions: Matrix3<f64>,
    /// For each axis the sum of the squared components of the vectors along it, in the squared unit of the vectors;
    /// divided by whatever [`spread`] was divided by.
    pub squares: Vector3<f64>,
}

impl PrincipalAxes {
    /// The axes of vectors whose [`spread`] this is.
    pub fn of_spread(spread: Matrix3<f64>) -> Self {
        let SymmetricEigen { eigenvectors, eigenvalues } = SymmetricEigen::new(spread);
        PrincipalAxes { directions: eigenvectors, squares: eigenvalues }
    }

    /// The mean of some points, and the axes of their offsets from it.
    pub fn of_points(points: impl Iterator<Item = Vector3<f64>> + Clone) -> (Vector3<f64>, Self) {
        let mean = mean_point(points.clone());
        (mean, Self::of_spread(spread(points.map(|p| (p - mean, 1.0)))))
    }

    /// The axis along which the vectors extend the least: the normal, of either sign, of the plane that fits best.
    pub fn normal(&self) -> Vector3<f64> {
        self.directions.column(self.squares.imin()).into_owned()
    }

    /// The roots of the squares, largest first.
    pub fn extents(&self) -> [f64; 3] {
        // Rounding makes a square of 0 negative now and then.
        let mut extents: [f64; 3] = self.squares.map(|square| square.max(0.0).sqrt()).into();
        extents.sort_by(|a, b| b.total_cmp(a));
        extents
    }
}

/// The mean of some points; not a number if there are none.
pub(crate) fn mean_point(points: impl Iterator<Item = Vector3<f64>>) -> Vector3<f64> {
    let (sum, count) = points.fold((Vector3::zeros(), 0.0), |(sum, count), p| (sum + p, count + 1.0));
    sum / count
}

/// The sum of w d d^T over some vectors d with their weights w: for offsets from a mean, the covariance times the
/// number of points.
pub(crate) fn spread(vectors: impl Iterator<Item = (Vector3<f64>, f64)>) -> Matrix3<f64> {
    vectors.fold(Matrix3::zeros(), |sum, (d, weight)| sum + d * d.transpose() * weight)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// A right-handed frame of unit vectors, turned by two angles.
    fn frame(p: f64, q: f64) -> [Vector3<f64>; 3] {
        [
            Vector3::new(p.cos(), p.sin() * q.cos(), p.sin() * q.sin()),
            Vector3::new(-p.sin(), p.cos() * q.cos(), p.cos() * q.sin()),
            Vector3::new(0.0, -q.sin(), q.cos()),
        ]
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]

        /// The corners of a turned and moved box: its edges are the axes, and along each all corners are half a side
        /// away from the middle.
        #[test]
        fn the_axes_of_a_box_are_its_edges(
            (p, q) in (0.0..3.0_f64, 0.0..3.0_f64),
            middle in prop::array::uniform3(-9.0..9.0_f64),
            side in (4.0..5.0_f64, 2.0..3.0_f64, 0.1..1.0_f64),
        ) {
            let (edges, half) = (frame(p, q), [side.0 / 2.0, side.1 / 2.0, side.2 / 2.0]);
            let corner = |i: usize| {
                let along = |a: usize| edges[a] * if i >> a & 1 == 1 { half[a] } else { -half[a] };
                Vector3::from(middle) + along(0) + along(1) + along(2)
            };
            let (mean, axes) = PrincipalAxes::of_points((0..8).map(corner));
            prop_assert!((mean - Vector3::from(middle)).norm() < 1e-12);
            prop_assert!((axes.normal().dot(&edges[2]).abs() - 1.0).abs() < 1e-9);
            for (got, want) in axes.extents().iter().zip(half) {
                prop_assert!((got - 8f64.sqrt() * want).abs() < 1e-9, "{got} is not root 8 times {want}");
            }
            for (direction, square) in axes.directions.column_iter().zip(axes.squares.iter()) {
                let along = (0..8).map(|i| direction.dot(&(corner(i) - mean)).powi(2)).sum::<f64>();
                prop_assert!((along - square).abs() < 1e-9, "{along} is not {square}");
            }
        }
    }

    #[test]
    fn a_weight_counts_as_so_many_vectors() {
        let vectors = [[1.0, 2.0, -1.0], [0.5, 0.0, 3.0], [-2.0, 1.0, 1.0]].map(Vector3::from);
        let weighted = spread(vectors.iter().copied().zip([1.0, 2.0, 3.0]));
        let repeated = [0, 1, 1, 2, 2, 2].map(|i| (vectors[i], 1.0));
        assert!((weighted - spread(repeated.into_iter())).norm() < 1e-12);
    }

    #[test]
    fn points_in_a_plane_or_in_one_place_have_a_normal() {
        let plane = [[0.0, 0.0, 2.0], [1.0, 0.0, 2.0], [0.0, 1.0, 2.0], [3.0, 4.0, 2.0]].map(Vector3::from);
        let (_, axes) = PrincipalAxes::of_points(plane.iter().copied());
        assert!((axes.normal().z.abs() - 1.0).abs() < 1e-12 && axes.extents()[2] < 1e-7);
        let (mean, axes) = PrincipalAxes::of_points(std::iter::repeat_n(Vector3::from([1.0; 3]), 5));
        assert_eq!((mean, axes.extents()), (Vector3::from([1.0; 3]), [0.0; 3]));
        assert!((axes.normal().norm() - 1.0).abs() < 1e-12);
    }
}
