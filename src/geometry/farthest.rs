//! Well-spread subsets of points.

use super::vec3;
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};

/// Indices of `count` well-spread points among `points` (n x 3): the first is drawn with `seed`, each next one is the
/// point farthest from those already chosen, the smallest index among equally far ones. No index is repeated. O(n
/// count).
///
/// # Panics
/// If `count` exceeds the number of points.
#[track_caller]
pub fn farthest_point_sample(points: &[[f32; 3]], count: usize, seed: u64) -> Vec<u32> {
    assert!(count <= points.len(), "farthest_point_sample: {count} asked of {} points", points.len());
    let mut chosen = Vec::with_capacity(count);
    if count == 0 {
        return chosen;
    }
    let mut next = ChaCha8Rng::seed_from_u64(seed).random_range(0..points.len());
    let mut dist_sq = vec![f32::INFINITY; points.len()];
    loop {
        chosen.push(next as u32);
        if chosen.len() == count {
            return chosen;
        }
        // Below every distance, so that duplicates of a chosen point still come before the point itself.
        dist_sq[next] = -1.0;
        let from = points[next];
        let mut best = -1.0;
        for (i, (p, d)) in points.iter().zip(&mut dist_sq).enumerate() {
            *d = d.min(vec3::dist_sq(*p, from));
            if *d > best {
                (best, next) = (*d, i);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn farthest_points_follow_the_definition() {
        let points = crate::geometry::fibonacci_sphere(60);
        for count in 0..=12 {
            let got = farthest_point_sample(&points, count, 4);
            assert_eq!(got.len(), count);
            // The naive twin measures to every chosen point anew.
            for j in 1..count {
                let gap = |i: usize| {
                    got[..j]
                        .iter()
                        .map(|&c| vec3::dist_sq(points[i], points[c as usize]))
                        .fold(f32::INFINITY, f32::min)
                };
                let want = (0..points.len()).rev().max_by(|&a, &b| gap(a).total_cmp(&gap(b))).unwrap();
                assert_eq!(got[j] as usize, want);
            }
        }
        let mut all = farthest_point_sample(&[[1.0; 3]; 7], 7, 0);
        all.sort_unstable();
        assert_eq!(all, [0, 1, 2, 3, 4, 5, 6]);
    }

    #[test]
    #[should_panic(expected = "3 asked of 2 points")]
    fn too_many_farthest_points_are_refused() {
        farthest_point_sample(&[[0.0; 3]; 2], 3, 0);
    }
}
