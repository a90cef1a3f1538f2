//! The array: its values, from a pool or not, and their shape.

use super::buffer::Buffer;
use super::{MatRef, Pool, Shape};
use std::fmt;

/// A dense row-major array of f32.
#[derive(Clone)]
pub struct Tensor {
    buffer: Buffer,
    shape: Shape,
}

impl Tensor {
    /// Zeros of a shape.
    ///
    /// # Panics
    /// If the shape has no dimension or more than [`MAX_RANK`](super::MAX_RANK).
    #[track_caller]
    pub fn zeros(dims: &[usize]) -> Self {
        Self::full(dims, 0.0)
    }

    /// One value everywhere.
    ///
    /// # Panics
    /// As [`zeros`](Self::zeros).
    #[track_caller]
    pub fn full(dims: &[usize], value: f32) -> Self {
        let shape = Shape::new(dims);
        Tensor { buffer: Buffer::owned(vec![value; shape.len()]), shape }
    }

    /// A 1x1 tensor.
    pub fn scalar(value: f32) -> Self {
        Self::full(&[1, 1], value)
    }

    /// Takes over row-major values.
    ///
    /// # Panics
    /// If the number of values is not the product of the dimensions.
    #[track_caller]
    pub fn from_vec(dims: &[usize], values: Vec<f32>) -> Self {
        let shape = Shape::new(dims);
        assert!(shape.len() == values.len(), "tensor: {} values for shape {shape:?}", values.len());
        Tensor { buffer: Buffer::owned(values), shape }
    }

    /// Copies points into n x 3.
    pub fn from_points(points: &[[f32; 3]]) -> Self {
        Self::from_vec(&[points.len(), 3], points.as_flattened().to_vec())
    }

    /// Copies n x 3 out as points.
    ///
    /// # Panics
    /// If the innermost dimension is not 3.
    #[track_caller]
    pub fn to_points(&self) -> Vec<[f32; 3]> {
        assert!(self.cols() == 3, "to_points: shape {:?}, 3 columns expected", self.shape);
        self.data().as_chunks::<3>().0.to_vec()
    }

    /// The dimensions, outermost first.
    pub fn dims(&self) -> &[usize] {
        self.shape.dims()
    }

    /// The shape.
    pub fn shape(&self) -> Shape {
        self.shape
    }

    /// The values as a matrix of [`rows`](Self::rows) x [`cols`](Self::cols), for products.
    pub(crate) fn as_mat(&self) -> MatRef<'_> {
        MatRef::window(self.data(), self.rows(), self.cols(), self.cols())
    }

    /// The innermost dimension.
    pub fn cols(&self) -> usize {
        self.shape.cols()
    }

    /// The product of all other dimensions.
    pub fn rows(&self) -> usize {
        self.shape.rows()
    }

    /// The number of elements.
    pub fn len(&self) -> usize {
        self.shape.len()
    }

    /// Whether there are no elements.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The values, row-major.
    pub fn data(&self) -> &[f32] {
        self.buffer.as_slice()
    }

    /// The values, row-major, to be changed.
    pub fn data_mut(&mut self) -> &mut [f32] {
        self.buffer.as_mut_slice()
    }

    /// One row.
    pub fn row(&self, i: usize) -> &[f32] {
        let c = self.cols();
        &self.data()[i * c..(i + 1) * c]
    }

    /// The only value of a one-element tensor.
    ///
    /// # Panics
    /// If there is not exactly one element.
    #[track_caller]
    pub fn item(&self) -> f32 {
        assert!(self.len() == 1, "item: shape {:?}, one element expected", self.shape);
        self.data()[0]
    }

    /// The same values under another shape.
    ///
    /// # Panics
    /// If the number of elements differs.
    #[track_caller]
    pub fn reshaped(mut self, dims: &[usize]) -> Self {
        let shape = Shape::new(dims);
        assert!(shape.len() == self.len(), "reshape: {:?} to {shape:?}", self.shape);
        self.shape = shape;
        self
    }

    /// Whether every value is finite.
    pub fn is_finite(&self) -> bool {
        // A sum of zero products is zero exactly if no value is NaN or infinite; it vectorises where `all` does not.
        self.data().chunks(1024).all(|c| c.iter().map(|x| x * 0.0).fold(0.0, |a, b| a + b) == 0.0)
    }

    /// A copy whose memory comes from `pool` and returns to it; its results do so too.
    pub fn into_pool(self, pool: &Pool) -> Self {
        let mut moved = Tensor { buffer: pool.take(self.len()), shape: self.shape };
        moved.data_mut().copy_from_slice(self.data());
        moved
    }

    /// A tensor from this one's pool whose values are whatever the memory held: to be overwritten whole.
    pub(crate) fn uninit_like(&self, dims: &[usize]) -> Tensor {
        let shape = Shape::new(dims);
        Tensor { buffer: self.buffer.sibling(shape.len()), shape }
    }

    /// Zeros from this tensor's pool.
    pub(crate) fn zeros_like_pool(&self, dims: &[usize]) -> Tensor {
        let mut t = self.uninit_like(dims);
        t.data_mut().fill(0.0);
        t
    }
}

impl fmt::Debug for Tensor {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Tensor{:?}", self.shape)?;
        let shown = &self.data()[..self.len().min(12)];
        write!(f, " {shown:?}{}", if shown.len() < self.len() { " ..." } else { "" })
    }
}

impl PartialEq for Tensor {
    fn eq(&self, other: &Self) -> bool {
        self.shape == other.shape && self.data() == other.data()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shape_counts() {
        let t = Tensor::zeros(&[2, 3, 4]);
        assert_eq!((t.rows(), t.cols(), t.len()), (6, 4, 24));
        assert_eq!(format!("{:?}", t.shape()), "[2x3x4]");
        assert_eq!(t.reshaped(&[24, 1]).rows(), 24);
    }

    #[test]
    #[should_panic(expected = "reshape: [2x3] to [4x2]")]
    fn reshape_names_both_shapes() {
        let _ = Tensor::zeros(&[2, 3]).reshaped(&[4, 2]);
    }

    #[test]
    fn finite_sees_every_value() {
        for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
            for at in [0, 1023, 1024, 2999] {
                let mut t = Tensor::full(&[3000, 1], f32::MAX);
                assert!(t.is_finite());
                t.data_mut()[at] = bad;
                assert!(!t.is_finite());
            }
        }
    }

    #[test]
    fn pooled_results_are_recycled() {
        let pool = Pool::default();
        let x = Tensor::full(&[10, 10], 1.0).into_pool(&pool);
        let first = pool.allocations();
        for _ in 0..5 {
            let y = x.uninit_like(&[10, 10]);
            drop(y);
        }
        assert_eq!(pool.allocations(), first + 1);
    }
}
