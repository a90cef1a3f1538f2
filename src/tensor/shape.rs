//! The dimensions of a tensor.

use std::fmt;

/// The most dimensions a tensor can have.
pub const MAX_RANK: usize = 4;

/// The dimensions of a tensor, outermost first.
#[derive(Clone, Copy, PartialEq, Eq)]
pub struct Shape {
    dims: [usize; MAX_RANK],
    rank: usize,
}

impl Shape {
    /// A shape of these dimensions.
    ///
    /// # Panics
    /// If there are none or more than [`MAX_RANK`], or the product of those that are not 0 overflows.
    #[track_caller]
    pub fn new(dims: &[usize]) -> Self {
        assert!(
            !dims.is_empty() && dims.len() <= MAX_RANK,
            "tensor: {} dimensions, 1 to {MAX_RANK} expected",
            dims.len()
        );
        // Without those that are 0, so that the number of rows fits, too.
        let len = dims.iter().try_fold(1usize, |len, &d| len.checked_mul(d.max(1)));
        assert!(len.is_some(), "tensor: {dims:?} are more values than can be counted");
        let mut shape = Shape { dims: [1; MAX_RANK], rank: dims.len() };
        shape.dims[..dims.len()].copy_from_slice(dims);
        shape
    }

    /// The dimensions, outermost first.
    pub fn dims(&self) -> &[usize] {
        &self.dims[..self.rank]
    }

    /// The number of elements.
    pub fn len(&self) -> usize {
        self.dims().iter().product()
    }

    /// Whether there are no elements.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The innermost dimension.
    pub fn cols(&self) -> usize {
        self.dims[self.rank - 1]
    }

    /// The product of all other dimensions.
    pub fn rows(&self) -> usize {
        self.dims[..self.rank - 1].iter().product()
    }
}

impl fmt::Debug for Shape {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let dims: Vec<String> = self.dims().iter().map(ToString::to_string).collect();
        write!(f, "[{}]", dims.join("x"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_that_overflow_are_refused() {
        assert_eq!(Shape::new(&[usize::MAX, 0]).len(), 0);
        assert_eq!(Shape::new(&[usize::MAX, 1]).len(), usize::MAX);
        for dims in [&[usize::MAX, 2][..], &[1 << 33, 1 << 31], &[usize::MAX, usize::MAX, 0]] {
            let refused = std::panic::catch_unwind(|| Shape::new(dims)).unwrap_err();
            let message = refused.downcast_ref::<String>().unwrap();
            assert!(message.contains("more values than can be counted"), "{message}");
        }
    }
}
