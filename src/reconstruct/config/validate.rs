//! Whether options are in range and fit each other.

use super::{Config, MAX_DRAWN, MAX_FREQUENCY, MAX_STEPS, StartShape};
use crate::bsp::Parameterization;
use crate::error::{Error, ErrorKind};
use crate::field::{FieldActivation, octave_factor};
use crate::optim::{Decay, Schedule};

impl Config {
    /// Whether the options are in range and fit each other.
    ///
    /// # Errors
    /// [`ErrorKind::Config`] with the option and what to do about it.
    pub fn validate(&self) -> Result<(), Error> {
        self.validate_result()?;
        self.validate_parameterization()?;
        self.validate_training()
    }

    /// Whether those options are in range that a trained field and its mesh follow from.
    pub(in crate::reconstruct) fn validate_result(&self) -> Result<(), Error> {
        let f = &self.field;
        within("field.width", f.width, 1, 1024)?;
        within("field.depth", f.depth, 1, 32)?;
        within("field.octaves", f.octaves, 0, 16)?;
        positive("field.frequency", f.frequency, 1000.0)?;
        let highest = f.frequency * octave_factor(f.octaves.saturating_sub(1));
        let advice = "lower field.frequency or field.octaves: frequency 2^(octaves - 1) may be at most 1000";
        check("field.octaves", f.octaves == 0 || highest <= MAX_FREQUENCY, f.octaves, advice)?;
        positive("field.radius", f.radius, 0.57)?;
        if let FieldActivation::Softplus { beta } = f.activation {
            positive("field.activation", beta, 1e6)?;
        }
        if let Some(skip) = f.skip {
            let advice = "use a hidden layer from 1 to field.depth - 1, or none";
            check("field.skip", skip > 0 && skip < f.depth, skip, advice)?;
        }
        let advice = "use a share from 0 (keep every part) to 1 (keep the largest)";
        let fits = (0.0..=1.0).contains(&self.min_component);
        check("min_component", fits, self.min_component, advice)
    }

    fn validate_parameterization(&self) -> Result<(), Error> {
        let b = &self.bsp;
        within("bsp.channels", b.channels, 2, 1024)?;
        within("bsp.heads", b.heads, 1, b.channels)?;
        let advice = "use an even number that is a multiple of bsp.heads";
        check(
            "bsp.channels",
            b.channels.is_multiple_of(b.heads) && b.channels.is_multiple_of(2),
            b.channels,
            advice,
        )?;
        within("bsp.neighbours", b.neighbours, 1, 256)?;
        within("bsp.patch", b.patch, 1, 256)?;
        within_some("bsp.reach", b.reach, 4096, "all")?;
        positive("bsp.code_density", b.code_density, 100.0)?;
        let advice = "set bsp.layout = true and bsp.average_positions = false (and bsp.slack = 1, as the preset paper), \
                      or bsp.charts = false";
        check("bsp.charts", !b.charts || (b.layout && !b.average_positions), b.charts, advice)?;
        check("bsp.slack", (0.0..=100.0).contains(&b.slack), b.slack, "use a number from 0 to 100")?;
        check(
            "bsp.normal_weight",
            (0.0..=100.0).contains(&b.normal_weight),
            b.normal_weight,
            "use a number from 0 to 100",
        )?;
        if let Parameterization::Multiple { maps } = self.parameterization {
            within("parameterization", maps, 2, 256)?;
        }
        within_some("bsp_every", self.bsp_every, MAX_STEPS, "never")?;
        positive_some("start.dipole_radius", self.start.dipole_radius.map(f64::from), "auto")?;
        not_negative("start.regularity", self.start.regularity)?;
        positive_some("reference_area", self.reference_area, "off")?;
        positive("start.rate", self.start.rate, 1.0)?;
        for (key, rate) in [("field_rate", &self.field_rate), ("bsp_rate", &self.bsp_rate)] {
            check_rate(key, rate)?;
        }
        Ok(())
    }

    fn validate_training(&self) -> Result<(), Error> {
        let w = &self.weights;
        for (name, weight) in w.each() {
            not_negative(&format!("weights.{name}"), f64::from(weight))?;
        }
        if self.stages.is_empty() {
            let advice =
                "give a stage, such as stages = \"32:400\" (resolution:steps), or another start.shape";
            check("stages", self.start.shape != StartShape::Sphere, "no training of a sphere", advice)?;
        }
        let drawn = w.deform + w.pull + w.cover + w.on_points;
        let advice =
            "give weights.deform, weights.pull, weights.cover or weights.on_points a positive weight";
        check("weights", drawn > 0.0, "nothing draws the surface to the points", advice)?;
        for stage in &self.stages {
            let fits = (4..=1024).contains(&stage.resolution);
            check("stages", fits, format!("resolution {}", stage.resolution), "use 4 to 1024 cubes")?;
            let fits = (1..=MAX_STEPS).contains(&stage.steps);
            check("stages", fits, format!("{} steps", stage.steps), "use 1 to 10000000 steps")?;
        }
        let fits = w.deform_decay > 0.0 && w.deform_decay <= 1.0;
        check("weights.deform_decay", fits, w.deform_decay, "use more than 0 and at most 1 (constant)")?;
        let least = w.deform * w.deform_decay;
        let advice = "use 0, or so much that weights.deform times weights.deform_decay is at least 1e-20";
        check("weights.deform", w.deform == 0.0 || least >= 1e-20, w.deform, advice)?;
        within("stages", self.stages.len(), 0, 100)?;
        within("band.refresh", self.band.refresh, 1, 1_000_000)?;
        within("band.rings", self.band.rings, 0, 64)?;
        let shift = self.band.shift;
        check("band.shift", (0.0..=1.0).contains(&shift), shift, "use 0 (no shift) to 1")?;
        positive_some("batch.thin", self.batch.thin.map(f64::from), "off")?;
        within("batch.points", self.batch.points, 16, 1 << 24)?;
        within("batch.centres", self.batch.centres, 16, 1 << 20)?;
        within_some("surface_samples", self.surface_samples, MAX_DRAWN, "off")?;
        within("bsp_pretrain", self.bsp_pretrain, 0, MAX_STEPS)?;
        within("start.steps", self.start.steps, 0, MAX_STEPS)?;
        within_some("train_up_to", self.train_up_to, u32::MAX as usize, "all")?;
        positive_some("clip", self.clip, "off")
    }
}

fn check(
    key: &str,
    good: bool,
    value: impl std::fmt::Display,
    advice: impl Into<String>,
) -> Result<(), Error> {
    if good {
        return Ok(());
    }
    Err(Error::new(ErrorKind::Config, format!("{value} cannot be used"))
        .at_element(format!("option {key}"))
        .advise(advice))
}

fn within(key: &str, value: usize, least: usize, most: usize) -> Result<(), Error> {
    check(key, (least..=most).contains(&value), value, format!("use {least} to {most}"))
}

/// `None` is allowed, and has this word in texts.
fn within_some(key: &str, value: Option<usize>, most: usize, none: &str) -> Result<(), Error> {
    let Some(value) = value else { return Ok(()) };
    check(key, (1..=most).contains(&value), value, format!("use 1 to {most}, or {none}"))
}

/// `None` is allowed, and has this word in texts.
fn positive_some(key: &str, value: Option<f64>, none: &str) -> Result<(), Error> {
    let Some(value) = value else { return Ok(()) };
    let advice = format!("use a number above 0, up to 1e9, or {none}");
    check(key, value > 0.0 && value <= 1e9, value, advice)
}

fn positive(key: &str, value: f32, most: f32) -> Result<(), Error> {
    check(key, value > 0.0 && value <= most, value, format!("use a number above 0, up to {most}"))
}

fn not_negative(key: &str, value: f64) -> Result<(), Error> {
    check(key, (0.0..=1e9).contains(&value), value, "use a number from 0 to 1e9")
}

fn check_rate(key: &str, rate: &Schedule) -> Result<(), Error> {
    positive(&format!("{key}.base"), rate.base, 1.0)?;
    let decay = format!("{key}.decay");
    match rate.decay {
        Decay::Cosine { floor } => {
            let advice = "use a floor from 0 to 1, such as cosine:0.05";
            check(&decay, (0.0..=1.0).contains(&floor), floor, advice)
        }
        Decay::Step { every, factor } => {
            let advice = "use step:EVERY:FACTOR with EVERY above 0 and FACTOR from 0 to 1";
            check(&decay, every > 0 && (0.0..=1.0).contains(&factor), factor, advice)
        }
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::reconstruct::Preset;

    #[test]
    fn presets_are_valid() {
        for preset in Preset::ALL {
            Config::preset(preset).validate().unwrap();
        }
    }

    #[test]
    fn bad_options_are_named() {
        for (key, value) in [
            ("field.width", "0"),
            ("field.skip", "99"),
            ("field.octaves", "32"),
            ("field.octaves", "18446744073709551615"),
            ("field.activation", "softplus:-1"),
            ("bsp.channels", "63"),
            ("bsp.code_density", "NaN"),
            ("bsp.patch", "0"),
            ("bsp.charts", "true"),
            ("bsp.slack", "-1"),
            ("weights.para", "-1"),
            ("weights.on_points", "inf"),
            ("stages", "2:100"),
            ("reference_area", "-1"),
            ("stages", "32:0"),
            ("band.refresh", "0"),
            ("band.shift", "1.5"),
            ("band.shift", "NaN"),
            ("batch.points", "0"),
            ("field_rate.base", "0"),
            ("bsp_rate.decay", "cosine:2"),
            ("min_component", "1.5"),
            ("train_up_to", "0"),
            ("clip", "NaN"),
            ("parameterization", "multiple:1"),
        ] {
            let mut config = Config::preset(Preset::Default);
            config.set(key, value).unwrap();
            let error = config.validate().unwrap_err();
            assert_eq!(error.kind(), ErrorKind::Config, "{key} = {value}");
            assert_eq!(error.element(), Some(format!("option {key}").as_str()));
            assert!(error.advice().is_some());
        }
        // Texts of 0 mean `None`; a program can still write the number.
        let mut config = Config::preset(Preset::Default);
        (config.bsp.reach, config.bsp_every, config.surface_samples) = (Some(0), Some(0), Some(0));
        (config.reference_area, config.clip) = (Some(0.0), Some(0.0));
        (config.start.dipole_radius, config.batch.thin) = (Some(0.0), Some(0.0));
        for key in [
            "bsp.reach",
            "bsp_every",
            "start.dipole_radius",
            "reference_area",
            "batch.thin",
            "surface_samples",
            "clip",
        ] {
            let error = config.validate().unwrap_err();
            assert_eq!(error.element(), Some(format!("option {key}").as_str()));
            config.set(key, "0").unwrap();
        }
        config.validate().unwrap();
        let mut config = Config::preset(Preset::Paper);
        config.weights.deform = 0.0;
        assert_eq!(config.validate().unwrap_err().element(), Some("option weights"));
    }
}
