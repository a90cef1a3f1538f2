//! What the runs of a plan came to: means, counts, and what is wrong with which.

use std::collections::HashMap;

use bijective_sdf::evaluate::percentile;

use super::super::failure::Failure;
use super::plan::{Job, Plan};
use super::record::{Cover, Figures, Record};
use super::setting::Setting;

/// A 10 x CD_L1 above this is a failure.
pub const FAILED_CD: f64 = 0.3;

/// A plan with the records there are.
#[derive(Clone, Copy, Debug)]
pub struct Results<'a> {
    /// All runs.
    pub plan: &'a Plan<'a>,
    /// Those made, by fingerprint.
    pub records: &'a HashMap<String, Record>,
}

impl<'a> Results<'a> {
    /// The record of a run.
    pub fn record(&self, job: &Job<'_>) -> Option<&'a Record> {
        self.records.get(&job.fingerprint)
    }

    /// The runs of a setting that there are records of.
    pub fn made(&self, setting: &Setting) -> Vec<(&'a Job<'a>, &'a Record)> {
        self.plan.of(setting).filter_map(|job| Some((job, self.record(job)?))).collect()
    }

    /// That runs failed, if some did; it has the exit code of the last one in the order of the plan.
    pub fn failure(&self) -> Option<Failure> {
        let failed = |job: &'a Job<'a>| Some((job, self.record(job)?.failure.as_ref()?));
        let failed: Vec<_> = self.plan.jobs.iter().filter_map(failed).collect();
        let (job, last) = failed.last()?;
        let text = format!(
            "{} of {} runs failed, the last of them {} {} seed {}: {}",
            failed.len(),
            self.plan.jobs.len(),
            job.setting.name,
            job.shape.name,
            job.seed,
            last.text
        );
        Some(Failure::Runs(text, last.exit_code))
    }

    /// All shapes and seeds of a setting together.
    pub fn summary(&self, setting: &Setting) -> Summary {
        let planned = self.plan.of(setting).count();
        Summary::of(self.made(setting).into_iter().map(|(_, record)| record), planned)
    }

    /// CD_L1 against that of the first setting, where both have a result for a shape and a seed; nothing for the first.
    pub fn against_first(&self, setting: &Setting) -> Option<Against> {
        let first = self.plan.settings.first().filter(|first| first.name != setting.name)?;
        let run = |job: &Job<'a>| (job.shape.name.as_str(), job.seed);
        let made = self.made(first).into_iter();
        let base: HashMap<_, f64> = made.filter_map(|(job, record)| Some((run(job), record.cd()?))).collect();
        // In the order of the plan, so that the sum is the same each time.
        let made = self.made(setting).into_iter();
        let pairs: Vec<(f64, f64)> =
            made.filter_map(|(job, record)| Some((record.cd()?, *base.get(&run(job))?))).collect();
        let log = mean(pairs.iter().map(|(cd, base)| (cd / base).ln()))?;
        let yes = pairs.iter().filter(|(cd, base)| cd < base).count();
        Some(Against { ratio: log.exp(), better: Share { yes, all: pairs.len() } })
    }

    /// The mean over the seeds of 10 x CD_L1 of a shape.
    pub fn mean_cd(&self, setting: &Setting, shape: &str) -> Option<f64> {
        let of_shape = self.made(setting).into_iter().filter(|(job, _)| job.shape.name == shape);
        mean(of_shape.filter_map(|(_, record)| record.cd()))
    }
}

impl Record {
    /// 10 x CD_L1.
    pub fn cd(&self) -> Option<f64> {
        self.figures.map(|f| 10.0 * f.cd_l1)
    }

    /// Whether there is no result, or one far off.
    pub fn is_failure(&self) -> bool {
        self.failure.is_some() || self.cd().is_some_and(|cd| cd > FAILED_CD)
    }

    /// Whether there is a mesh that is closed and oriented.
    pub fn is_closed(&self) -> bool {
        self.result.is_some_and(|r| r.closed && r.oriented)
    }

    /// What is wrong, worst first; the last may be a genus, which is no fault that counts.
    pub fn faults(&self) -> Vec<String> {
        let mut faults = Vec::new();
        faults.extend(self.failure.iter().map(|failure| failure.text.clone()));
        faults.extend(self.cd().filter(|&cd| cd > FAILED_CD).map(|cd| format!("10 CD_L1 {cd:.3}")));
        if let Some(result) = self.result {
            for (good, what) in [(result.closed, "not closed"), (result.oriented, "not oriented")] {
                if !good {
                    faults.push(what.to_string());
                }
            }
            if let Some(truth) = self.truth {
                if result.components != truth.components {
                    let plural = if result.components == 1 { "" } else { "s" };
                    faults.push(format!(
                        "{} component{plural} instead of {}",
                        result.components, truth.components
                    ));
                }
                if let (Some(genus), Some(want)) = (result.genus, truth.genus)
                    && genus != want
                {
                    faults.push(format!("genus {genus} instead of {want}"));
                }
            }
        }
        faults
    }

    /// Whether a fault other than the genus is there.
    pub fn is_bad(&self) -> bool {
        let parts = self.result.zip(self.truth).is_some_and(|(r, t)| r.components != t.components);
        self.is_failure() || !self.is_closed() || parts
    }
}

/// So many of so many.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Share {
    pub yes: usize,
    pub all: usize,
}

/// A setting against another, run by run.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Against {
    /// The geometric mean of the ratios.
    pub ratio: f64,
    /// Runs that are better, of those compared.
    pub better: Share,
}

/// The runs of a setting together. Means and percentiles are over those that have the figure.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Summary {
    /// Runs made, of those planned.
    pub runs: Share,
    /// 10 x CD_L1: mean, 5th, 50th and 95th percentile.
    pub cd_l1: [Option<f64>; 4],
    /// 100 x CD_L2.
    pub cd_l2: Option<f64>,
    pub nc: Option<f64>,
    pub hd: Option<f64>,
    pub f: Option<f64>,
    /// 10 x CD_L1 of perfect predictions.
    pub floor: Option<f64>,
    /// Closed and oriented, of the runs made.
    pub closed: Share,
    /// One component, of the runs whose truth has one.
    pub single: Share,
    /// Errors, and 10 x CD_L1 above 0.3.
    pub failures: usize,
    /// Wall time of a run: mean and most.
    pub seconds: [Option<f64>; 2],
    /// Means of what is known of S.
    pub cover: Cover,
}

impl Summary {
    fn of<'a>(records: impl Iterator<Item = &'a Record>, planned: usize) -> Summary {
        let records: Vec<&Record> = records.collect();
        let figures: Vec<Figures> = records.iter().filter_map(|r| r.figures).collect();
        let cds: Vec<f64> = records.iter().filter_map(|r| r.cd()).collect();
        let share = |all: &[&Record], yes: fn(&Record) -> bool| Share {
            yes: all.iter().filter(|r| yes(r)).count(),
            all: all.len(),
        };
        let covered = |of: fn(&Cover) -> Option<f64>| mean(records.iter().filter_map(|r| of(&r.cover)));
        let one: Vec<&Record> =
            records.iter().copied().filter(|r| r.truth.is_some_and(|t| t.components == 1)).collect();
        Summary {
            runs: Share { yes: records.len(), all: planned },
            cd_l1: [
                mean(cds.iter().copied()),
                percentile(&cds, 5.0),
                percentile(&cds, 50.0),
                percentile(&cds, 95.0),
            ],
            cd_l2: mean(figures.iter().map(|f| 100.0 * f.cd_l2)),
            nc: mean(figures.iter().filter_map(|f| f.nc)),
            hd: mean(figures.iter().map(|f| f.hd)),
            f: mean(figures.iter().map(|f| f.f)),
            floor: mean(figures.iter().filter_map(|f| f.floor).map(|x| 10.0 * x)),
            closed: share(&records, Record::is_closed),
            single: share(&one, |r| r.result.is_some_and(|r| r.components == 1)),
            failures: records.iter().filter(|r| r.is_failure()).count(),
            seconds: [
                mean(records.iter().map(|r| r.seconds)),
                records.iter().map(|r| r.seconds).max_by(f64::total_cmp),
            ],
            cover: Cover {
                mean_code: covered(|c| c.mean_code),
                evenness: covered(|c| c.evenness),
                folded: covered(|c| c.folded),
                distinct: covered(|c| c.distinct),
                q_to_s: covered(|c| c.q_to_s),
                s_to_q: covered(|c| c.s_to_q),
                s_to_truth: covered(|c| c.s_to_truth),
                truth_to_s: covered(|c| c.truth_to_s),
                truth_to_q: covered(|c| c.truth_to_q),
                floor: covered(|c| c.floor),
            },
        }
    }
}

fn mean(values: impl Iterator<Item = f64>) -> Option<f64> {
    let (sum, count) = values.fold((0.0, 0usize), |(sum, count), x| (sum + x, count + 1));
    (count > 0).then(|| sum / count as f64)
}

#[cfg(test)]
pub mod tests {
    use super::super::inputs::ShapeFiles;
    use super::super::plan::tests::setting;
    use super::super::record::{Form, RunFailure};
    use super::*;

    pub const WHOLE: Form = Form { components: 1, genus: Some(0), closed: true, oriented: true };

    pub fn record(cd_l1: f64, result: Form, truth: Form) -> Record {
        Record {
            fingerprint: String::new(),
            failure: None,
            seconds: 2.0,
            threads: 1,
            build: None,
            mesh: None,
            surface: None,
            cover: Cover::default(),
            figures: Some(Figures {
                cd_l1,
                cd_l2: 0.0002,
                nc: Some(0.9),
                hd: 0.05,
                f: 0.5,
                floor: Some(0.001),
            }),
            result: Some(result),
            truth: Some(truth),
        }
    }

    #[test]
    fn the_last_failure_of_the_plan_decides_the_exit_code() {
        let shape = ShapeFiles { name: "a".into(), cloud: "a.xyz".into(), truth: None };
        let setting = setting("default");
        let job = |seed: u64| Job { shape: &shape, setting: &setting, seed, fingerprint: seed.to_string() };
        let plan = Plan { shapes: &[], settings: &[], jobs: (0..4).map(job).collect(), notes: Vec::new() };
        // The last run is not made yet, and what the plan does not ask for does not count.
        let mut records: HashMap<String, Record> =
            ["0", "1", "2", "7"].map(|print| (print.into(), record(0.01, WHOLE, WHOLE))).into();
        let mut fail = |print: &str, exit_code| {
            records.get_mut(print).unwrap().failure =
                Some(RunFailure { text: "no surface".into(), exit_code });
            Results { plan: &plan, records: &records }.failure().map(|f| (f.code(), f.text()))
        };
        assert_eq!(fail("7", 2), None);
        assert_eq!(fail("1", 3).unwrap().0, 3);
        assert_eq!(fail("0", 1).unwrap().0, 3);
        let text = "3 of 4 runs failed, the last of them default a seed 2: no surface";
        assert_eq!(fail("2", 1), Some((1, text.to_string())));
    }

    #[test]
    fn faults_are_named_and_counted() {
        let good = record(0.01, WHOLE, WHOLE);
        assert!(good.faults().is_empty() && !good.is_bad() && !good.is_failure());
        let genus = record(0.01, Form { genus: Some(2), ..WHOLE }, WHOLE);
        assert_eq!(genus.faults(), ["genus 2 instead of 0"]);
        assert!(!genus.is_bad());
        let parts = record(0.01, Form { components: 3, ..WHOLE }, WHOLE);
        assert_eq!(parts.faults(), ["3 components instead of 1"]);
        assert!(parts.is_bad() && !parts.is_failure());
        let open = record(0.031, Form { closed: false, oriented: false, genus: None, ..WHOLE }, WHOLE);
        assert_eq!(open.faults(), ["10 CD_L1 0.310", "not closed", "not oriented"]);
        assert!(open.is_bad() && open.is_failure());
        let mut failed = record(0.01, WHOLE, WHOLE);
        let failure = RunFailure { text: "no surface".into(), exit_code: 1 };
        (failed.failure, failed.figures, failed.result) = (Some(failure), None, None);
        failed.seconds = 5.0;
        assert_eq!(failed.faults(), ["no surface"]);
        assert!(failed.is_bad() && failed.is_failure());

        let two = Form { components: 2, ..WHOLE };
        let both = record(0.03, two, two);
        assert!(!both.is_bad());
        let s = Summary::of([&good, &genus, &parts, &open, &failed, &both].into_iter(), 8);
        assert_eq!(s.runs, Share { yes: 6, all: 8 });
        assert_eq!(s.closed, Share { yes: 4, all: 6 });
        assert_eq!(s.single, Share { yes: 3, all: 5 });
        assert_eq!(s.failures, 2);
        let near = |a: Option<f64>, b: f64| assert!((a.unwrap() - b).abs() < 1e-9, "{a:?} {b}");
        near(s.cd_l1[0], (0.1 + 0.1 + 0.1 + 0.31 + 0.3) / 5.0);
        near(s.cd_l1[2], 0.1);
        near(s.cd_l2, 0.02);
        near(s.nc, 0.9);
        near(s.floor, 0.01);
        near(s.seconds[0], 2.5);
        near(s.seconds[1], 5.0);
        assert_eq!(
            Summary::of([].into_iter(), 3),
            Summary { runs: Share { yes: 0, all: 3 }, ..Summary::default() }
        );
    }
}
