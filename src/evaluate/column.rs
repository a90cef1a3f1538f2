//! Columns of tables: which number, times what, in which unit.

use super::compare::Report;
use super::metrics::Metrics;

/// A column of a table over shapes. Lengths are in units of the frame of the comparison.
#[derive(Clone, Copy, Debug)]
pub struct Column {
    /// The heading, which says the factor, as in `10 CD_L1`.
    pub name: &'static str,
    /// What the number is and in which unit it is printed.
    pub unit: &'static str,
    value: fn(&Report) -> Option<f64>,
}

impl Column {
    /// The number for one shape, if it was measured.
    pub fn value(&self, report: &Report) -> Option<f64> {
        (self.value)(report)
    }
}

const fn column(name: &'static str, unit: &'static str, value: fn(&Report) -> Option<f64>) -> Column {
    Column { name, unit, value }
}

pub(super) const CD_L1: Column =
    column("10 CD_L1", "half the sum of both mean distances, in tenths of a unit", |r| {
        Some(10.0 * r.metrics.cd_l1())
    });
pub(super) const CD_L2: Column = column(
    "100 CD_L2",
    "half the sum of both mean squared distances, in hundredths of a squared unit",
    |r| Some(100.0 * r.metrics.cd_l2()),
);
pub(super) const NC: Column = column("NC", "mean |n . n'| of both directions, 0 to 1", |r| r.metrics.nc());
pub(super) const NC_NTPS: Column =
    column("NC ntps", "mean |n_x n'_x| + |n_y n'_y| + |n_z n'_z| of both directions", |r| {
        r.metrics.nc_ntps()
    });
pub(super) const HD: Column = column("HD", "largest distance of both directions", |r| Some(r.metrics.hd()));
pub(super) const CD: Column =
    column("CD", "half the sum of both mean distances", |r| Some(r.metrics.cd_l1()));
pub(super) const CD_FROM_SCAN: Column =
    column("CD scan", "mean distance from the scan to the prediction", |r| Some(r.scan?.to_pred.mean));
pub(super) const HD_FROM_SCAN: Column =
    column("HD scan", "largest distance from the scan to the prediction", |r| Some(r.scan?.to_pred.max));
pub(super) const CD_SQ_SUM: Column =
    column("1000 CD^2", "sum of both mean squared distances, in thousandths of a squared unit", |r| {
        Some(1000.0 * (r.metrics.to_gt.mean_sq + r.metrics.to_pred.mean_sq))
    });
pub(super) const CD_SQ_TO_SCAN: Column = column(
    "1000 CD^2 scan",
    "mean squared distance from the prediction to the scan, in thousandths of a squared unit",
    |r| Some(1000.0 * r.scan?.to_gt.mean_sq),
);

/// What [`Table::of_reports`](super::Table::of_reports) shows.
pub(super) const USUAL_COLUMNS: [Column; 11] = [
    CD_L1,
    CD_L2,
    NC,
    HD,
    column("F", "F-score at the threshold, 0 to 1", |r| Some(r.metrics.fscores()[1].f)),
    column("F half", "F-score at half the threshold", |r| Some(r.metrics.fscores()[0].f)),
    column("F twice", "F-score at twice the threshold", |r| Some(r.metrics.fscores()[2].f)),
    column("10 acc", "mean distance from prediction to ground truth, in tenths of a unit", |r| {
        Some(10.0 * r.metrics.acc())
    }),
    column("10 comp", "mean distance from ground truth to prediction, in tenths of a unit", |r| {
        Some(10.0 * r.metrics.comp())
    }),
    column("floor", "the 10 CD_L1 that a perfect prediction scores", |r| Some(10.0 * r.floor?.cd_l1())),
    column("10 CD_L1 surf", "10 CD_L1 from samples to triangles, without the floor", |r| {
        Some(10.0 * r.surface?.cd_l1())
    }),
];

/// The rest of what is measured.
pub(super) const FURTHER_COLUMNS: [Column; 16] = [
    NC_NTPS,
    column("precision", "part of the prediction within the threshold", |r| part(r, 1, false)),
    column("recall", "part of the ground truth within the threshold", |r| part(r, 1, true)),
    column("precision half", "part of the prediction within half the threshold", |r| part(r, 0, false)),
    column("recall half", "part of the ground truth within half the threshold", |r| part(r, 0, true)),
    column("precision twice", "part of the prediction within twice the threshold", |r| part(r, 2, false)),
    column("recall twice", "part of the ground truth within twice the threshold", |r| part(r, 2, true)),
    column("100 CD_L2 surf", "100 CD_L2 from samples to triangles", |r| Some(100.0 * r.surface?.cd_l2())),
    column("NC surf", "NC from samples to triangles", |r| r.surface.as_ref().and_then(Metrics::nc)),
    column("HD surf", "HD from samples to triangles", |r| Some(r.surface?.hd())),
    column("F surf", "F-score from samples to triangles", |r| Some(r.surface?.fscore().f)),
    CD,
    CD_SQ_SUM,
    CD_FROM_SCAN,
    HD_FROM_SCAN,
    CD_SQ_TO_SCAN,
];

fn part(r: &Report, threshold: usize, recall: bool) -> Option<f64> {
    let score = r.metrics.fscores()[threshold];
    Some(if recall { score.recall } else { score.precision })
}
