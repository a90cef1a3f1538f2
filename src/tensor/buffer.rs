//! Memory for tensors, recycled between steps.

use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

/// A store of freed buffers by size class; cheap to clone, all clones are one store.
///
/// Classes grow by a quarter of a power of two, so a buffer is at most a quarter larger than what was asked for.
#[derive(Clone, Debug, Default)]
pub struct Pool(Arc<FreeBuffers>);

#[derive(Debug, Default)]
struct FreeBuffers {
    free: Mutex<Vec<Vec<Vec<f32>>>>,
    allocations: AtomicUsize,
}

impl Pool {
    /// How many buffers were newly allocated so far; constant once a repeated step has warmed up.
    pub fn allocations(&self) -> usize {
        self.0.allocations.load(Ordering::Relaxed)
    }

    /// A buffer of `len` values, whatever they are.
    pub(super) fn take(&self, len: usize) -> Buffer {
        let (class, capacity) = class_of(len);
        let recycled = {
            let mut free = self.0.free.lock().unwrap_or_else(PoisonError::into_inner);
            free.get_mut(class).and_then(Vec::pop)
        };
        let values = recycled.unwrap_or_else(|| {
            self.0.allocations.fetch_add(1, Ordering::Relaxed);
            vec![0.0; capacity]
        });
        Buffer { values, len, pool: Some(self.clone()) }
    }

    fn give_back(&self, values: Vec<f32>) {
        let (class, capacity) = class_of(values.len());
        debug_assert_eq!(capacity, values.len());
        let mut free = self.0.free.lock().unwrap_or_else(PoisonError::into_inner);
        if free.len() <= class {
            free.resize_with(class + 1, Vec::new);
        }
        free[class].push(values);
    }
}

/// The size class of `len` and the capacity of its buffers.
fn class_of(len: usize) -> (usize, usize) {
    if len <= 8 {
        return (0, 8);
    }
    // 2^p < len <= 2^(p+1), cut into four steps of 2^(p-2).
    let p = (len - 1).ilog2() as usize;
    let step = 1usize << (p - 2);
    let quarters = (len - (1 << p)).div_ceil(step);
    ((p - 3) * 4 + quarters, (1 << p) + quarters * step)
}

/// The values of one tensor; goes back to its pool when dropped.
#[derive(Debug)]
pub(super) struct Buffer {
    values: Vec<f32>,
    len: usize,
    pool: Option<Pool>,
}

impl Buffer {
    pub(super) fn owned(values: Vec<f32>) -> Self {
        Buffer { len: values.len(), values, pool: None }
    }

    /// A buffer of `len` values, whatever they are, from the same pool; without a pool, zeros.
    pub(super) fn sibling(&self, len: usize) -> Buffer {
        match &self.pool {
            Some(pool) => pool.take(len),
            None => Buffer::owned(vec![0.0; len]),
        }
    }

    pub(super) fn as_slice(&self) -> &[f32] {
        &self.values[..self.len]
    }

    pub(super) fn as_mut_slice(&mut self) -> &mut [f32] {
        &mut self.values[..self.len]
    }
}

impl Clone for Buffer {
    fn clone(&self) -> Self {
        let mut copy = self.sibling(self.len);
        copy.as_mut_slice().copy_from_slice(self.as_slice());
        copy
    }
}

impl Drop for Buffer {
    fn drop(&mut self) {
        if let Some(pool) = self.pool.take() {
            pool.give_back(std::mem::take(&mut self.values));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn classes_are_tight_monotone_and_stable() {
        let mut last = (0, 0);
        for len in 0..5000 {
            let (class, capacity) = class_of(len);
            assert!(capacity >= len);
            assert!(len <= 8 || capacity * 4 <= len * 5 + 4, "{len} in {capacity}");
            assert_eq!(class_of(capacity), (class, capacity), "a buffer must return to its own class");
            assert!(class >= last.0 && (class > last.0 || last.1 == 0 || capacity == last.1));
            last = (class, capacity);
        }
    }
}
