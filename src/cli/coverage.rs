//! How well S covers the points, the sphere and the truth, as text and JSON.

use bijective_sdf::bsp::{CodeCoverage, Coverage};
use bijective_sdf::evaluate::PointsReport;

use super::json::Object;

/// A coverage as a JSON object; `null` for none.
pub fn coverage_json(coverage: Option<&Coverage>) -> String {
    let Some(c) = coverage else { return "null".to_string() };
    let count = |n: Option<usize>| n.map_or("null".to_string(), |n| n.to_string());
    Object::new()
        .count("points", c.points)
        .count("surface_points", c.surface)
        .count("distinct", c.distinct)
        .number("distinct_share", c.distinct_share())
        .number("q_to_s", c.q_to_s)
        .number("s_to_q", c.s_to_q)
        .number("mean_code", c.codes.map(|codes| codes.mean_code))
        .raw("sphere_codes", count(c.codes.map(|codes| codes.sphere)))
        .raw("used_codes", count(c.codes.map(|codes| codes.used)))
        .number("evenness", c.codes.as_ref().map(CodeCoverage::evenness))
        .raw("near_pairs", count(c.codes.map(|codes| codes.near_pairs)))
        .number("folded", c.codes.as_ref().and_then(CodeCoverage::folded))
        .finish()
}

/// Evenness of the codes below which they are in one spot.
const CROWDED: f64 = 0.1;

/// A coverage in some lines.
pub fn coverage_text(c: &Coverage) -> Vec<String> {
    let mut lines = vec![format!(
        "S: {} of {} points distinct ({:.1} %), Q to S {:.5}, S to Q {:.5} of the longest side",
        c.distinct,
        c.surface,
        100.0 * c.distinct_share(),
        c.q_to_s,
        c.s_to_q
    )];
    if let Some(codes) = &c.codes {
        lines.push(format!(
            "codes: mean {:.3} long, {} of the sphere's {} in patches ({:.1} %)",
            codes.mean_code,
            codes.used,
            codes.sphere,
            100.0 * codes.evenness()
        ));
        if codes.evenness() < CROWDED {
            lines.push("the codes crowd in one spot of the sphere; --preset paper spreads them".into());
        } else if let Some(folded) = codes.folded() {
            lines.push(format!(
                "where two points of S lie in one place, their codes are far apart in {:.1} % of the pairs",
                100.0 * folded
            ));
        }
    }
    lines
}

/// How a cloud Q and its S, if there is one, lie to a truth.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TruthCoverage {
    pub q: PointsReport,
    pub s: Option<PointsReport>,
}

impl TruthCoverage {
    /// From the reports on Q and, if there is an S, on S.
    pub fn of(reports: &[PointsReport]) -> Option<TruthCoverage> {
        Some(TruthCoverage { q: *reports.first()?, s: reports.get(1).copied() })
    }

    /// As a JSON object.
    pub fn json(&self) -> String {
        let s = self.s.as_ref();
        Object::new()
            .number("q_to_truth", self.q.to_gt)
            .number("truth_to_q", self.q.from_gt)
            .number("s_to_truth", s.map(|s| s.to_gt))
            .number("truth_to_s", s.map(|s| s.from_gt))
            .number("floor", s.and_then(|s| s.floor))
            .number("scale", self.q.scale)
            .count("gt_samples", self.q.gt_samples)
            .finish()
    }
}

#[cfg(test)]
pub mod tests {
    use super::*;
    use bijective_sdf::bsp::{ParameterizedSurface, SphereCodes};

    /// Round figures, with or without those of codes.
    pub fn some_coverage(with_codes: bool) -> Coverage {
        let points = vec![[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        let surface = points.repeat(2);
        let codes = with_codes.then(|| SphereCodes {
            points: points.clone(),
            patches: surface.clone(),
            index: vec![0, 1, 2, 3, 4, 5],
            sphere: 8,
        });
        let mut coverage = ParameterizedSurface { points, surface, codes }.coverage().unwrap();
        (coverage.q_to_s, coverage.s_to_q) = (0.25, 0.5);
        if let Some(codes) = &mut coverage.codes {
            (codes.mean_code, codes.near_pairs, codes.folded_pairs) = (0.5, 0, 0);
        }
        coverage
    }

    #[test]
    fn what_is_not_there_is_null() {
        let c = some_coverage(false);
        assert_eq!(
            coverage_json(Some(&c)),
            "{\"points\":3,\"surface_points\":6,\"distinct\":3,\"distinct_share\":0.5,\"q_to_s\":0.25,\"s_to_q\":0.5,\
             \"mean_code\":null,\"sphere_codes\":null,\"used_codes\":null,\"evenness\":null,\"near_pairs\":null,\
             \"folded\":null}"
        );
        assert_eq!((coverage_json(None), coverage_text(&c).len()), ("null".to_string(), 1));
        let lines = coverage_text(&some_coverage(true));
        assert!(lines[0].contains("3 of 6 points distinct (50.0 %)") && lines[1].ends_with("(75.0 %)"));
        assert_eq!(lines.len(), 2);
        // Folds are told where points lie in one place, but not where all codes do.
        let mut c = some_coverage(true);
        let mut last = |near_pairs, folded_pairs, used| {
            let codes = c.codes.as_mut().unwrap();
            (codes.near_pairs, codes.folded_pairs, codes.used) = (near_pairs, folded_pairs, used);
            coverage_text(&c).pop().unwrap()
        };
        assert!(last(4, 1, 6).contains("25.0 % of the pairs"));
        assert!(last(4, 1, 0).contains("crowd"));
    }
}
