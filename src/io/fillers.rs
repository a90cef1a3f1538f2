//! Rows that hold no point: numbers that are not finite, and values that stand for "no return".
//!
//! What is certain is left out with a warning that says how many rows; what may be a point is kept with a warning.

use std::collections::HashMap;

use super::Loaded;

/// Numbers that programs write where they have no value; each is certain only where it lies far off the others.
const FILLERS: [f64; 15] = [
    -9999.0,
    -99_999.0,
    -999_999.0,
    -9_999_999.0,
    -32_768.0,
    -32_767.0,
    -999.0,
    9999.0,
    99_999.0,
    999_999.0,
    32_767.0,
    65_535.0,
    999.0,
    -10_000.0,
    -1e10,
];
/// Beyond this a number is a filler, not a place: the largest floats, and 1e30 or 1.70141e38 of grids.
const HUGE: f64 = 1e30;
/// A filler lies outside the range of the other coordinates on its axis by more than this many lengths of that range.
const FAR: f64 = 3.0;

/// Leaves out the rows that hold no point. With `keep`, only what is not finite.
pub(super) fn drop_rows(loaded: &mut Loaded, keep: bool) {
    let total = loaded.verts.len();
    let finite = |p: &[f64; 3]| p.iter().all(|x| x.is_finite());
    retain(loaded, finite, |n| {
        format!("left out {n} of {total} points: x, y or z is missing or not a finite number")
    });
    if keep || loaded.verts.is_empty() {
        return;
    }
    if loaded.verts.iter().any(|p| p.iter().all(|x| x.abs() < HUGE)) {
        let small = |p: &[f64; 3]| p.iter().all(|x| x.abs() < HUGE);
        retain(loaded, small, |n| {
            format!(
                "left out {n} of {total} points: a coordinate is beyond {HUGE:e}, which stands for no value"
            )
        });
    }
    drop_fillers(loaded, total);
    origins(loaded, total);
    repeated(loaded);
}

/// Keeps the rows that `fits` likes; if any went, a warning says so.
fn retain(loaded: &mut Loaded, fits: impl Fn(&[f64; 3]) -> bool, text: impl Fn(usize) -> String) {
    let gone = loaded.verts.iter().filter(|p| !fits(p)).count();
    if gone == 0 {
        return;
    }
    if !loaded.normals.is_empty() {
        let mut kept = loaded.verts.iter().map(&fits);
        loaded.normals.retain(|_| kept.next().unwrap_or(false));
    }
    for attribute in &mut loaded.attributes {
        let mut kept = loaded.verts.iter().map(&fits);
        attribute.values.retain(|_| kept.next().unwrap_or(false));
    }
    loaded.verts.retain(&fits);
    loaded.left_out += gone;
    loaded.warnings.push(text(gone));
}

/// Least and largest number on an axis among those of `fits`.
fn range(verts: &[[f64; 3]], axis: usize, fits: impl Fn(f64) -> bool) -> Option<[f64; 2]> {
    let values = verts.iter().map(|p| p[axis]).filter(|&x| fits(x));
    values.fold(None, |range: Option<[f64; 2]>, x| {
        Some(range.map_or([x, x], |[low, high]| [low.min(x), high.max(x)]))
    })
}

/// Whether `x` lies outside a range by more than [`FAR`] times its length, or a tenth of the cloud's if that is more.
fn is_far(x: f64, [low, high]: [f64; 2], longest: f64) -> bool {
    let length = (high - low).max(0.1 * longest);
    length > 0.0 && (low - x).max(x - high) > FAR * length
}

/// Leaves out -9999 and the like.
fn drop_fillers(loaded: &mut Loaded, total: usize) {
    let is_filler = |x: f64| FILLERS.contains(&x);
    if !loaded.verts.iter().flatten().any(|&x| is_filler(x)) {
        return;
    }
    let others = [0, 1, 2].map(|axis| range(&loaded.verts, axis, |x| !is_filler(x)));
    let longest = others.iter().flatten().map(|[low, high]| high - low).fold(0.0, f64::max);
    let mut found: Vec<(f64, usize)> = Vec::new();
    let mut within: Vec<(f64, usize)> = Vec::new();
    for (axis, others) in others.iter().enumerate() {
        let Some(others) = *others else { continue };
        for filler in FILLERS {
            let count = loaded.verts.iter().filter(|p| p[axis] == filler).count();
            // -999 and the positive ones may be real coordinates: they need two rows to count as fillers.
            let needed = if filler < -9000.0 { 1 } else { 2 };
            let list = if count == 0 {
                continue;
            } else if is_far(filler, others, longest) && count >= needed {
                &mut found
            } else {
                &mut within
            };
            match list.iter_mut().find(|(m, _)| *m == filler) {
                Some((_, n)) => *n += count,
                None => list.push((filler, count)),
            }
        }
    }
    for (filler, count) in within {
        if count >= 3 && filler < 0.0 && !found.iter().any(|(m, _)| *m == filler) {
            loaded.warnings.push(format!(
                "{count} coordinates are {filler}, which often stands for no value; they were kept, as the others are \
                 of that size"
            ));
        }
    }
    if found.is_empty() {
        return;
    }
    let names = found.iter().map(|(m, _)| m.to_string()).collect::<Vec<_>>().join(" or ");
    let gone = |p: &[f64; 3]| {
        (0..3).any(|a| {
            found.iter().any(|(m, _)| *m == p[a]) && others[a].is_some_and(|o| is_far(p[a], o, longest))
        })
    };
    retain(
        loaded,
        |p| !gone(p),
        |n| {
            format!(
                "left out {n} of {total} points: a coordinate is {names}, far from all others, which stands for no value \
             (--assume keeps them)"
            )
        },
    );
}

/// Leaves out 0 0 0 where it is repeated as nothing else is, or far from the others.
fn origins(loaded: &mut Loaded, total: usize) {
    let is_zero = |p: &[f64; 3]| *p == [0.0; 3];
    let count = loaded.verts.iter().filter(|p| is_zero(p)).count();
    if count == 0 || count == loaded.verts.len() {
        return;
    }
    let rest: Vec<[f64; 3]> = loaded.verts.iter().copied().filter(|p| !is_zero(p)).collect();
    let ranges = [0, 1, 2].map(|axis| range(&rest, axis, |_| true).unwrap_or_default());
    let longest = ranges.iter().map(|[low, high]| high - low).fold(0.0, f64::max);
    let far = rest.len() > 3 && ranges.iter().any(|&r| is_far(0.0, r, longest));
    let repeated = count >= 3 && {
        let mut times: HashMap<[u64; 3], usize> = HashMap::new();
        rest.iter().for_each(|p| *times.entry(p.map(f64::to_bits)).or_default() += 1);
        count >= 3 * times.values().copied().max().unwrap_or(1)
    };
    if far || repeated {
        let why = if far { "far from all others" } else { "repeated as no other point is" };
        retain(
            loaded,
            |p| !is_zero(p),
            |n| {
                format!(
                    "left out {n} of {total} points: they are 0 0 0, {why}, which stands for no return (--assume keeps \
                 them)"
                )
            },
        );
    }
}

/// Warns of a value at the end of an axis that several points share, far from all others.
fn repeated(loaded: &mut Loaded) {
    for (axis, name) in ["x", "y", "z"].into_iter().enumerate() {
        let Some([low, high]) = range(&loaded.verts, axis, |_| true) else { return };
        for end in [low, high] {
            let Some(others) = range(&loaded.verts, axis, |x| x != end) else { continue };
            let count = loaded.verts.iter().filter(|p| p[axis] == end).count();
            if count >= 3
                && 2 * count < loaded.verts.len()
                && others[1] > others[0]
                && is_far(end, others, 0.0)
            {
                loaded.warnings.push(format!(
                    "{count} points have {name} = {end}, far from all others; if that stands for no value, remove them"
                ));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(extra: &[[f64; 3]], keep: bool) -> (usize, Vec<String>) {
        // Points of no pattern in a box of sides 2, 2 and 1.
        let mut verts: Vec<[f64; 3]> = (0..40_u32)
            .map(|i| {
                let hash = |k: u32| f64::from((i * 3 + k).wrapping_mul(2_654_435_761) >> 16) / 65_536.0;
                [2.0 * hash(0) - 1.0, 2.0 * hash(1) - 1.0, hash(2) + 0.25]
            })
            .collect();
        verts.extend_from_slice(extra);
        let normals = vec![[0.0; 3]; verts.len()];
        let mut loaded = Loaded { verts, normals, ..Loaded::default() };
        drop_rows(&mut loaded, keep);
        assert_eq!(loaded.verts.len(), loaded.normals.len());
        assert_eq!(loaded.verts.len() + loaded.left_out, 40 + extra.len());
        (loaded.left_out, loaded.warnings)
    }

    #[test]
    fn rows_without_a_point_are_left_out_and_counted() {
        let nan = f64::NAN;
        let cases: [(&[[f64; 3]], usize, &str); 9] = [
            (
                &[[nan, 0.0, 0.0], [nan; 3], [0.0, f64::INFINITY, 0.0]],
                3,
                "left out 3 of 43 points: x, y or z is",
            ),
            (&[[0.5, 0.5, -9999.0]], 1, "a coordinate is -9999"),
            (&[[-9999.0; 3], [0.5, -99_999.0, 0.5]], 2, "-99999"),
            (&[[0.0, 0.0, 3.402_823_5e38], [f64::MAX; 3]], 2, "beyond 1e30"),
            (&[[999.0; 3], [999.0; 3]], 2, "is 999"),
            (&[[0.0; 3], [0.0; 3], [0.0; 3]], 3, "they are 0 0 0, repeated"),
            (&[[0.5, 0.5, -32_768.0]], 1, "-32768"),
            (&[], 0, ""),
            (&[[0.0; 3]], 0, ""),
        ];
        for (extra, count, part) in cases {
            let (gone, warnings) = of(extra, false);
            assert_eq!(gone, count, "{extra:?}");
            assert!(warnings.concat().contains(part), "{warnings:?}");
            assert_eq!(warnings.len(), usize::from(count > 0), "{warnings:?}");
        }
        assert_eq!(of(&[[-9999.0; 3], [nan; 3]], true).0, 1, "kept if asked for");
    }

    #[test]
    fn what_may_be_a_point_is_kept() {
        assert_eq!(of(&[[999.0, 0.5, 0.5]], false).0, 0);
        let (gone, warnings) = of(&[[0.5, 0.5, -50.0]; 3], false);
        assert!(gone == 0 && warnings[0].contains("3 points have z = -50"), "{warnings:?}");
        // Among numbers of that size.
        let verts: Vec<[f64; 3]> = (0..40).map(|i| [f64::from(i) * 1000.0 - 20_000.0, 1.0, 0.5]).collect();
        let mut loaded = Loaded { verts, ..Loaded::default() };
        loaded.verts.extend([[-9999.0, 1.0, 0.5]; 3]);
        drop_rows(&mut loaded, false);
        assert!(loaded.left_out == 0 && loaded.warnings[0].contains("3 coordinates are -9999"));
        // A file that was joined with itself repeats everything.
        let verts = [[[0.0; 3]; 3], [[1.0, 0.0, 0.0]; 3], [[0.0, 1.0, 1.0]; 3]].concat();
        let mut loaded = Loaded { verts, ..Loaded::default() };
        drop_rows(&mut loaded, false);
        assert_eq!((loaded.left_out, loaded.warnings.len()), (0, 0));
    }

    #[test]
    fn an_origin_far_from_map_coordinates_is_left_out() {
        let verts: Vec<[f64; 3]> = (0..40)
            .map(|i| [450_000.0 + f64::from(i % 7), 5e6 + f64::from(i % 5), f64::from(i % 3)])
            .collect();
        let mut loaded = Loaded { verts, ..Loaded::default() };
        loaded.verts.push([0.0; 3]);
        drop_rows(&mut loaded, false);
        assert!(loaded.left_out == 1 && loaded.warnings[0].contains("far from all others"));
    }
}
