//! Strays among the points, and what else makes a cloud doubtful: told always, strays removed as the user wants.

use bijective_sdf::geometry::{CleanCloud, format_shortest};
use bijective_sdf::start::{Sampling, Suspicion, find_outliers};
use clap::ValueEnum;

/// What to do with points that belong to no surface.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub enum Outliers {
    /// Leave out points that almost certainly belong to no surface
    #[default]
    Auto,
    /// Also leave out points that probably belong to no surface
    Remove,
    /// Keep all, but tell of them
    Keep,
}

impl Outliers {
    /// The name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Outliers::Auto => "auto",
            Outliers::Remove => "remove",
            Outliers::Keep => "keep",
        }
    }
}

/// The most places that a message lists.
const MAX_SHOWN: usize = 3;
/// The fewest points whose shape is judged: fewer look flat or straight by chance.
const MIN_POINTS: usize = 20;
/// A cloud whose third extent is below this share of its first is nearly flat, which is worth a warning. (Below 1e-6 it
/// is refused.)
const NEARLY_FLAT: f64 = 1e-4;

/// The numbers of the strays among distinct points, ascending, and what to say of them.
pub fn strays(points: &[[f64; 3]], outliers: Outliers) -> (Vec<u32>, Option<String>) {
    let suspicion = if outliers == Outliers::Remove { Suspicion::High } else { Suspicion::Low };
    let found = find_outliers(points, suspicion);
    if found.is_empty() {
        return (found, None);
    }
    let place = |i: &u32| format!("({})", points[*i as usize].map(format_shortest).join(", "));
    let places: Vec<String> = found.iter().take(MAX_SHOWN).map(place).collect();
    let more = if found.len() > MAX_SHOWN { ", ..." } else { "" };
    let (what, advice) = match outliers {
        Outliers::Keep => ("belong", "--outliers auto leaves them out"),
        _ => ("were left out: they belong", "--outliers keep takes them in"),
    };
    let (n, of) = (found.len(), points.len());
    let text = format!("{n} of {of} points {what} to no surface, at {}{more}; {advice}", places.join(", "));
    (found, Some(text))
}

/// `points` (or any list with one entry a point) without the entries at the indices `left_out`, which ascend.
pub fn without<T: Copy>(points: &[T], left_out: &[u32]) -> Vec<T> {
    let mut left_out = left_out.iter().peekable();
    let kept = |(i, _): &(u32, &T)| left_out.next_if(|&&out| out == *i).is_none();
    (0..).zip(points).filter(kept).map(|(_, p)| *p).collect()
}

/// What makes it doubtful that a surface is found, in a sentence each; `stretched` says whether the axes are multiplied
/// by factors of the user's.
pub fn doubts(clean: &CleanCloud, stretched: bool) -> Vec<String> {
    let mut told = Vec::new();
    let n = clean.points.len();
    if n < MIN_POINTS {
        told.push(format!("{n} points are few: the shape between them is a guess; a few hundred are better"));
    }
    let [first, _, third] = clean.extents;
    if third < NEARLY_FLAT * first {
        told.push(format!(
            "the points are nearly in one plane: they extend {third:.1e} across and {first:.1e} along it; a surface \
             needs points on all of its sides"
        ));
    }
    let seen = Sampling::of(&clean.points);
    if seen.fills_volume {
        told.push(
            "the points seem to fill a volume: a surface goes through all of them, inner ones too; keep those of the \
             boundary only"
                .into(),
        );
    }
    if seen.on_curves {
        told.push(
            "the points lie along curves: what is between these is a guess, and neighbouring curves may come out as \
             tubes; points spread over the surface are better"
                .into(),
        );
    }
    if let Some(uneven) = seen.uneven.filter(|_| !stretched) {
        let factors = uneven.anisotropy.map(format_shortest).join(",");
        told.push(format!(
            "the points lie on slices or lines {:.0} times as far apart as the points on them: --anisotropy {factors} \
             may join what comes out in parts or with holes",
            uneven.ratio
        ));
    } else if seen.parts.len() > 1 {
        let sizes: Vec<String> = seen.parts.iter().map(usize::to_string).collect();
        told.push(format!(
            "the points lie in {} parts far apart, of {} points: if they are not one surface, reconstruct each alone",
            sizes.len(),
            sizes.join(", ")
        ));
    }
    told
}

#[cfg(test)]
mod tests {
    use super::*;
    use bijective_sdf::geometry::{AnalyticShape, clean_cloud, widened};

    #[test]
    fn strays_are_told_and_left_out_unless_they_are_to_stay() {
        let mut points = widened(&AnalyticShape::Sphere { radius: 1.0 }.sample(100, 1).0);
        assert_eq!(strays(&points, Outliers::Auto), (Vec::new(), None));
        points.insert(7, [2.5, 0.5, -2.0]);
        for outliers in [Outliers::Auto, Outliers::Remove, Outliers::Keep] {
            let (found, text) = strays(&points, outliers);
            let text = text.unwrap();
            assert!(
                found == [7] && text.starts_with("1 of 101 points") && text.contains("(2.5, 0.5, -2)"),
                "{text}"
            );
            assert_eq!(text.contains("left out:"), outliers != Outliers::Keep);
        }
        let kept = without(&points, &[7]);
        assert!(kept.len() == 100 && kept[7] == points[8]);
    }

    #[test]
    fn doubtful_clouds_are_told() {
        let of = |points: &[[f32; 3]]| doubts(&clean_cloud(points).unwrap(), false);
        let sphere = AnalyticShape::Sphere { radius: 1.0 }.sample(200, 1).0;
        assert_eq!(of(&sphere), [""; 0]);
        assert!(of(&sphere[..12])[0].contains("12 points are few"));
        let flat: Vec<[f32; 3]> = sphere.iter().map(|p| [p[0], p[1], 1e-5 * p[2]]).collect();
        assert!(of(&flat)[0].contains("nearly in one plane"));
        let rings = |i: usize| {
            let angle = std::f32::consts::TAU * (i % 60) as f32 / 60.0;
            [angle.cos(), angle.sin(), 2.5 * (i / 60) as f32]
        };
        let told = of(&(0..300).map(rings).collect::<Vec<_>>());
        assert!(told.iter().any(|t| t.contains("--anisotropy 1,1,0.2")), "{told:?}");
        let apart: Vec<[f32; 3]> =
            sphere.iter().enumerate().map(|(i, p)| [p[0] + 20.0 * (i % 2) as f32, p[1], p[2]]).collect();
        let told = of(&apart);
        assert!(told.len() == 1 && told[0].contains("2 parts far apart, of 100, 100 points"), "{told:?}");
    }
}
