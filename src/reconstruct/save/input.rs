//! The input points, which have 64 bits, in files whose tensors have 32.

use super::store::{Checksum, Store, damaged};
use crate::error::Error;
use crate::geometry::{Position, are_f32};
use crate::tensor::Tensor;

/// Names of the tensors (n x 3 each) whose sum is the input points: the coordinates rounded to 32 bits and, unless that
/// is exact, the rest rounded likewise, and the rest of that. Files before version 4 have the first only.
const INPUT: [&str; 3] = ["cloud", "cloud.low", "cloud.lowest"];

/// Puts the input points (n x 3) into a file.
pub(super) fn put(store: &mut Store, input: &[[f64; 3]]) {
    for (name, part) in INPUT.into_iter().zip(split(input)) {
        store.tensors.insert(name.into(), Tensor::from_points(&part));
    }
}

/// Names of the tensors that a file has or should have for its input points.
pub(super) fn names(store: &Store) -> impl Iterator<Item = &'static str> {
    INPUT.into_iter().filter(|name| store.tensors.contains_key(*name) || *name == INPUT[0])
}

/// Coordinates (n x 3) as sums of numbers of 32 bits: one if that holds them exactly, else three.
fn split(points: &[[f64; 3]]) -> Vec<Vec<[f32; 3]>> {
    let mut parts = Vec::new();
    let mut rest = points.to_vec();
    loop {
        let part: Vec<[f32; 3]> = rest.iter().map(|p| p.map(|x| x as f32)).collect();
        for (left, part) in rest.iter_mut().zip(&part) {
            (0..3).for_each(|a| left[a] -= f64::from(part[a]));
        }
        parts.push(part);
        if parts.len() == INPUT.len() || (parts.len() == 1 && rest.iter().flatten().all(|&x| x == 0.0)) {
            return parts;
        }
    }
}

/// The input points of a file, whose tensors must be there.
///
/// # Errors
/// [`Checkpoint`](crate::ErrorKind::Checkpoint) if it is not finite, or its parts are not of one length.
pub(super) fn read(store: &Store) -> Result<Vec<[f64; 3]>, Error> {
    let mut input: Vec<[f64; 3]> = store.tensors[INPUT[0]].to_points().iter().map(|p| p.wide()).collect();
    for name in &INPUT[1..] {
        let Some(part) = store.tensors.get(*name) else { continue };
        if part.rows() != input.len() {
            return Err(damaged(format!("{} rows for {} points", part.rows(), input.len()))
                .at_element(format!("tensor {name}")));
        }
        for (p, part) in input.iter_mut().zip(part.to_points()) {
            (0..3).for_each(|a| p[a] += f64::from(part[a]));
        }
    }
    if input.is_empty() || !input.as_flattened().iter().all(|x| x.is_finite()) {
        return Err(damaged("its input points are missing or not finite"));
    }
    Ok(input)
}

/// The number of points and a checksum of the bytes of their coordinates: of 32 bits if these hold all coordinates
/// exactly, as in files of earlier versions, else of 64.
pub(super) fn fingerprint(points: &[[f64; 3]]) -> String {
    let mut sum = Checksum::new();
    let narrow = are_f32(points);
    for &x in points.as_flattened() {
        if narrow { sum.add(&(x as f32).to_le_bytes()) } else { sum.add(&x.to_le_bytes()) }
    }
    format!("{} points, {:016x}", points.len(), sum.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_come_back_to_the_bit() {
        let narrow = vec![[0.1f32, -2.5, 1e30], [3e-20, 7.0, 0.0]];
        let wide = vec![[450_123.4, 5_411_234.6, -1e-3], [1.0 / 3.0, 2f64.powi(-40) + 1.0, 1e12 + 1e-3]];
        for (points, parts) in [(crate::geometry::widened(&narrow), 1), (wide, 3)] {
            let mut store = Store::default();
            put(&mut store, &points);
            assert_eq!((store.tensors.len(), names(&store).count()), (parts, parts));
            assert_eq!(read(&store).unwrap(), points);
            store.tensors.insert(INPUT[1].into(), Tensor::zeros(&[1, 3]));
            assert!(read(&store).is_err());
        }
        assert_eq!(names(&Store::default()).collect::<Vec<_>>(), ["cloud"]);
        // That of the same numbers in 32 bits, as earlier versions made it.
        let mut sum = Checksum::new();
        narrow.as_flattened().iter().for_each(|x| sum.add(&x.to_le_bytes()));
        let found = fingerprint(&crate::geometry::widened(&narrow));
        assert_eq!(found, format!("2 points, {:016x}", sum.0));
    }
}
