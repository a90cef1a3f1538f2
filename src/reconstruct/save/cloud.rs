//! Clouds of 64 bits in files whose tensors are of 32.

use super::store::{Checksum, Store, damaged};
use crate::error::Error;
use crate::geometry::{Position, are_f32};
use crate::tensor::Tensor;

/// The cloud, n x 3: the coordinates as 32 bits hold them and, where they do not hold all, twice what is left. Before
/// version 4 there was the first only.
const CLOUD: [&str; 3] = ["cloud", "cloud.low", "cloud.lowest"];
/// Puts a cloud (n x 3) into a file.
pub(super) fn put(store: &mut Store, cloud: &[[f64; 3]]) {
    for (name, part) in CLOUD.into_iter().zip(split(cloud)) {
        store.tensors.insert(name.into(), Tensor::from_points(&part));
    }
}

/// The tensors that a file has or should have for its cloud.
pub(super) fn names(store: &Store) -> impl Iterator<Item = &'static str> {
    CLOUD.into_iter().filter(|name| store.tensors.contains_key(*name) || *name == CLOUD[0])
}

/// Coordinates (n x 3) as sums of numbers of 32 bits: one if that holds them exactly, else three.
fn split(cloud: &[[f64; 3]]) -> Vec<Vec<[f32; 3]>> {
    let mut parts = Vec::new();
    let mut rest = cloud.to_vec();
    loop {
        let part: Vec<[f32; 3]> = rest.iter().map(|p| p.map(|x| x as f32)).collect();
        for (left, part) in rest.iter_mut().zip(&part) {
            (0..3).for_each(|a| left[a] -= f64::from(part[a]));
        }
        parts.push(part);
        if parts.len() == CLOUD.len() || (parts.len() == 1 && rest.iter().flatten().all(|&x| x == 0.0)) {
            return parts;
        }
    }
}

/// The cloud of a file whose tensors are there.
///
/// # Errors
/// [`Checkpoint`](crate::ErrorKind::Checkpoint) if it is not finite, or its parts are not of one length.
pub(super) fn read(store: &Store) -> Result<Vec<[f64; 3]>, Error> {
    let mut cloud: Vec<[f64; 3]> = store.tensors[CLOUD[0]].to_points().iter().map(|p| p.wide()).collect();
    for name in &CLOUD[1..] {
        let Some(part) = store.tensors.get(*name) else { continue };
        if part.rows() != cloud.len() {
            return Err(damaged(format!("{} rows for {} points", part.rows(), cloud.len()))
                .at_element(format!("tensor {name}")));
        }
        for (p, part) in cloud.iter_mut().zip(part.to_points()) {
            (0..3).for_each(|a| p[a] += f64::from(part[a]));
        }
    }
    if cloud.is_empty() || !cloud.as_flattened().iter().all(|x| x.is_finite()) {
        return Err(damaged("its cloud is empty or not finite"));
    }
    Ok(cloud)
}

/// The number of points and a checksum of their bits: of 32 where these hold all coordinates exactly, as in the files
/// of earlier versions.
pub(super) fn fingerprint(cloud: &[[f64; 3]]) -> String {
    let mut sum = Checksum::new();
    let narrow = are_f32(cloud);
    for &x in cloud.as_flattened() {
        if narrow { sum.add(&(x as f32).to_le_bytes()) } else { sum.add(&x.to_le_bytes()) }
    }
    format!("{} points, {:016x}", cloud.len(), sum.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn clouds_come_back_to_the_bit() {
        let narrow = vec![[0.1f32, -2.5, 1e30], [3e-20, 7.0, 0.0]];
        let wide = vec![[450_123.4, 5_411_234.6, -1e-3], [1.0 / 3.0, 2f64.powi(-40) + 1.0, 1e12 + 1e-3]];
        for (cloud, parts) in [(crate::geometry::widened(&narrow), 1), (wide, 3)] {
            let mut store = Store::default();
            put(&mut store, &cloud);
            assert_eq!((store.tensors.len(), names(&store).count()), (parts, parts));
            assert_eq!(read(&store).unwrap(), cloud);
            store.tensors.insert(CLOUD[1].into(), Tensor::zeros(&[1, 3]));
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
