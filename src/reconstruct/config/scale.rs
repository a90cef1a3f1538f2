//! Options adapted to the number of points.

use crate::bsp::Parameterization;
use crate::field::octave_factor;
use crate::reconstruct::config::{MAX_DRAWN, MAX_FREQUENCY, MAX_STEPS};
use crate::reconstruct::{Config, StartShape};

/// The most points that the presets were made for.
const USUAL_POINTS: usize = 2048;
/// The most that grid resolutions are multiplied by.
const MAX_RESOLUTION_FACTOR: f64 = 6.0;
/// Cubes a side that the finest grid does not grow beyond; finer ones stay.
const MAX_RESOLUTION: f64 = 192.0;
/// Width of the field at the usual number of points, which the rule scales.
const USUAL_WIDTH: f64 = 64.0;
/// Width that the rule does not make a field grow beyond; wider ones stay.
const MAX_WIDTH: usize = 128;
/// The most octaves that are added.
const MAX_ADDED_OCTAVES: usize = 3;
/// The most that numbers of steps are multiplied by.
const MAX_STEPS_FACTOR: f64 = 2.0;
/// The most that the number of samples on the surface is multiplied by.
const MAX_SAMPLES_FACTOR: f64 = 8.0;
/// Points that a patch attends to for more points than usual, if it would attend to all otherwise.
const LOCAL_REACH: usize = 16;

impl Config {
    /// Adapts the options to n input points.
    ///
    /// Beyond [`train_up_to`](Self::train_up_to) nothing is trained: there are no stages and there is no S. Otherwise
    /// nothing changes up to 2,048 points; beyond, with s = n / 2048:
    ///
    /// | option | rule | because |
    /// |---|---|---|
    /// | resolution of each stage | times s^(1/2), at most 6 times, the finest up to 192 (`reference_area` comes on top: up to 192, or down to half for a large area) | a grid finer than the points resolves nothing, and the distance between neighbouring points on a surface falls with s^(1/2); a step's time and memory grow with the square |
    /// | `field.width` | at least 64 s^(1/3), up to 128 | a network of 64 smooths a street of 14,623 points to a blob, on a fine grid just as on a coarse one |
    /// | `field.octaves` | log2(s) / 2 more, at most 3 | an octave for each halving of the detail |
    /// | `surface_samples` | times s, at most 8 times | as many as a step sees points, and more |
    /// | steps of the start and of each stage | times s^(1/4), at most twice | a larger field learns a larger shape more slowly |
    /// | `bsp.reach` | 16 where it is `all` | attention of all to all costs n^2 |
    ///
    /// The patches and their sphere stay. The points that a step uses are bounded by `batch`, more points than that are
    /// thinned, and a step works on every active vertex of the grid. Nothing is made smaller here.
    ///
    /// Clears `scale_with_points`, so nothing is adapted twice; without it nothing changes.
    pub fn for_points(mut self, n: usize) -> Config {
        if !self.scale_with_points {
            return self;
        }
        let trains = self.trains(n);
        self.scale_with_points = false;
        if !trains && !self.stages.is_empty() {
            self.stages.clear();
            self.parameterization = Parameterization::None;
            return self;
        }
        if n <= USUAL_POINTS {
            return self;
        }
        let s = n as f64 / USUAL_POINTS as f64;
        let longer = |steps: usize| {
            let scaled = steps as f64 * s.powf(0.25).min(MAX_STEPS_FACTOR);
            (scaled.round() as usize).min(MAX_STEPS).max(steps)
        };
        let finest = self.stages.iter().map(|s| s.resolution).max().unwrap_or(1) as f64;
        let growth = s.sqrt().min(MAX_RESOLUTION_FACTOR).min(MAX_RESOLUTION / finest).max(1.0);
        for stage in &mut self.stages {
            let scaled = (stage.resolution as f64 * growth / 4.0).round() as usize * 4;
            stage.resolution = scaled.max(stage.resolution);
            stage.steps = longer(stage.steps);
        }
        self.surface_samples = self.surface_samples.map(|samples| {
            let drawn = (samples as f64 * s.min(MAX_SAMPLES_FACTOR)).round() as usize;
            drawn.min(MAX_DRAWN)
        });
        self.start.steps = longer(self.start.steps);
        let width = (USUAL_WIDTH * s.cbrt() / 16.0).round() as usize * 16;
        self.field.width = self.field.width.max(width.min(MAX_WIDTH));
        let finer = ((s.log2() / 2.0).round() as usize).min(MAX_ADDED_OCTAVES);
        for _ in 0..finer {
            let field = &mut self.field;
            if field.octaves > 0 && field.frequency * octave_factor(field.octaves) <= MAX_FREQUENCY {
                field.octaves += 1;
            }
        }
        self.bsp.reach = self.bsp.reach.or(Some(LOCAL_REACH));
        self
    }

    /// Whether anything is trained for n input points: there are stages, and `train_up_to` allows it.
    pub fn trains(&self, n: usize) -> bool {
        let limit = match self.start.shape {
            // A sphere is no result.
            StartShape::Sphere => None,
            _ if !self.scale_with_points => None,
            _ => self.train_up_to,
        };
        !self.stages.is_empty() && limit.is_none_or(|limit| n <= limit)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::reconstruct::{Preset, Stage};

    /// A preset that trains for any number of points.
    fn trained(preset: Preset) -> Config {
        Config { train_up_to: None, ..Config::preset(preset) }
    }

    #[test]
    fn many_points_keep_their_first_shape_unless_that_is_a_sphere() {
        for preset in Preset::ALL {
            let config = Config::preset(preset);
            let small = config.clone().for_points(1000);
            let large = config.clone().for_points(1001);
            assert_eq!(config.trains(1000), preset != Preset::Start);
            assert_eq!(config.trains(1001), preset == Preset::Paper);
            assert_eq!(large.stages.is_empty(), preset != Preset::Paper);
            assert_eq!(small.stages, config.stages);
            large.validate().unwrap();
            let fixed = Config { scale_with_points: false, ..config };
            assert_eq!(fixed.clone().for_points(5000), fixed);
        }
        // Where there are no stages, nothing else is changed: S is what the map makes before any step.
        let mut config = Config::preset(Preset::Default);
        config.stages.clear();
        assert_eq!(config.for_points(1500).parameterization, Parameterization::Bsp);
    }

    #[test]
    fn usual_sizes_change_nothing_and_larger_ones_nothing_twice() {
        for preset in Preset::ALL {
            let config = trained(preset);
            for n in [1, 300, USUAL_POINTS] {
                let usual = Config { scale_with_points: false, ..config.clone() };
                assert_eq!(config.clone().for_points(n), usual);
            }
            let large = config.clone().for_points(120_610);
            large.validate().unwrap();
            // One without stages has none to change.
            assert!(large.stages != config.stages || config.stages.is_empty());
            assert_eq!(large.clone().for_points(120_610), large);
        }
    }

    #[test]
    fn the_street_gets_what_the_table_says() {
        let config = trained(Preset::Fine).for_points(14_623);
        let stages = [Stage { resolution: 84, steps: 327 }, Stage { resolution: 128, steps: 327 }];
        assert_eq!(config.stages, stages);
        assert_eq!((config.field.width, config.field.octaves, config.start.steps), (128, 4, 654));
        assert_eq!(config.surface_samples, Some(57_121));
    }

    #[test]
    fn nothing_shrinks_with_more_points() {
        for preset in Preset::ALL {
            let mut before = trained(preset).for_points(1);
            for n in (11..27).map(|power| 1usize << power) {
                let now = trained(preset).for_points(n + 1);
                now.validate().unwrap();
                let stages = now.stages.iter().zip(&before.stages);
                assert!(stages.clone().all(|(a, b)| a.resolution >= b.resolution && a.steps >= b.steps));
                assert!(now.field.width >= before.field.width && now.field.octaves >= before.field.octaves);
                assert!(now.start.steps >= before.start.steps);
                before = now;
            }
        }
    }

    #[test]
    fn options_at_their_limits_stay_valid() {
        let mut config = trained(Preset::Default);
        config.field.octaves = 9;
        config.field.frequency = 3.9;
        config.stages = vec![Stage { resolution: 256, steps: MAX_STEPS }];
        config.surface_samples = Some(MAX_DRAWN);
        config.validate().unwrap();
        let scaled = config.for_points(1 << 24);
        scaled.validate().unwrap();
        assert_eq!(scaled.stages, [Stage { resolution: 256, steps: MAX_STEPS }]);
        assert_eq!(scaled.field.octaves, 9);
    }

    #[test]
    fn octaves_out_of_range_are_left_to_validation() {
        for octaves in [31, 32, 1000, usize::MAX] {
            let mut config = trained(Preset::Default);
            config.field.octaves = octaves;
            let scaled = config.for_points(1 << 20);
            assert_eq!(scaled.field.octaves, octaves);
            assert_eq!(scaled.validate().unwrap_err().element(), Some("option field.octaves"));
        }
    }
}
