//! The named configurations, with all their numbers but those of [`FieldConfig::default`] and
//! [`BspConfig::default`].

use crate::bsp::{BspConfig, Parameterization};
use crate::error::{Error, ErrorKind};
use crate::field::{FieldActivation, FieldConfig};
use crate::gdo::Deformation;
use crate::optim::{Decay, Schedule};
use crate::reconstruct::config::{Band, Batch, Config, Finishing, Stage, Start, StartShape, Target, Weights};
use crate::start::USUAL_AREA;
use std::fmt;
use std::str::FromStr;

/// A named configuration. How long they take and how good the results are: `README.md` and `benches/compare.md`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum Preset {
    /// The first shape that the others begin with, finished: no training.
    Start,
    /// The terms and weights of the paper and the field of its authors' code, with codes and patches that begin spread
    /// out (`benches/paper.md`); what the paper leaves open keeps a run short.
    Paper,
    /// A quick look: fewer steps than `default`, on a coarser grid.
    Fast,
    /// For a few hundred points; departs from the paper where that measured better (`benches/paper.md`).
    Default,
    /// A wider field, more steps and more samples.
    Fine,
}

impl Preset {
    /// All presets.
    pub const ALL: [Preset; 5] = [Preset::Start, Preset::Paper, Preset::Fast, Preset::Default, Preset::Fine];

    /// The name: `start`, `paper`, `fast`, `default` or `fine`.
    pub fn name(self) -> &'static str {
        match self {
            Preset::Start => "start",
            Preset::Paper => "paper",
            Preset::Fast => "fast",
            Preset::Default => "default",
            Preset::Fine => "fine",
        }
    }
}

impl fmt::Display for Preset {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for Preset {
    type Err = Error;

    fn from_str(s: &str) -> Result<Self, Error> {
        Preset::ALL.into_iter().find(|p| p.name() == s).ok_or_else(|| {
            Error::new(ErrorKind::Config, format!("there is no preset {s:?}"))
                .at_element("option preset")
                .advise("use start, paper, fast, default or fine")
        })
    }
}

impl Config {
    /// The options of a preset.
    pub fn preset(preset: Preset) -> Config {
        match preset {
            Preset::Start => start(),
            Preset::Paper => paper(),
            Preset::Fast => fast(),
            Preset::Default => default(),
            Preset::Fine => fine(),
        }
    }
}

impl Default for Config {
    fn default() -> Self {
        default()
    }
}

/// The terms and weights of the paper, with our layout, charts and slack (`benches/paper.md`). It leaves the rates, the
/// steps and the grid open; these keep a run short.
fn paper() -> Config {
    Config {
        train_up_to: None,
        denoise: false,
        field: FieldConfig {
            width: 256,
            depth: 8,
            octaves: 3,
            frequency: 1.0,
            activation: FieldActivation::Relu,
            skip: None,
            radius: 0.35,
        },
        bsp: BspConfig {
            channels: 128,
            reach: None,
            average_positions: false,
            layout: true,
            charts: true,
            slack: 1.0,
            normal_weight: 0.0,
            ..default().bsp
        },
        bsp_pretrain: 0,
        bsp_every: Some(1),
        start: Start { shape: StartShape::Sphere, ..default().start },
        target: Target::Surface,
        weights: Weights { para: 10.0, deform: 1.0, surf: 0.01, ..Weights::NONE },
        stages: vec![Stage { resolution: 48, steps: 300 }],
        reference_area: None,
        field_rate: Schedule { base: 5e-4, warmup: 40, decay: Decay::Cosine { floor: 0.05 } },
        bsp_rate: Schedule { base: 1e-3, warmup: 40, decay: Decay::Cosine { floor: 0.05 } },
        surface_samples: None,
        finish: Finishing::None,
        min_component: 0.0,
        ..default()
    }
}

fn start() -> Config {
    Config { parameterization: Parameterization::None, stages: Vec::new(), ..default() }
}

fn fast() -> Config {
    Config { stages: vec![Stage { resolution: 32, steps: 90 }], ..default() }
}

fn default() -> Config {
    Config {
        seed: 0,
        scale_with_points: true,
        train_up_to: Some(1000),
        denoise: true,
        field: FieldConfig::default(),
        parameterization: Parameterization::Bsp,
        bsp: BspConfig::default(),
        bsp_pretrain: 30,
        bsp_pretrain_on_shape: true,
        bsp_every: Some(6),
        start: Start {
            shape: StartShape::Plate,
            dipole_radius: None,
            regularity: 0.05,
            steps: 200,
            rate: 2e-3,
        },
        target: Target::SurfaceAndCloud,
        deformation: Deformation::Projection,
        weights: Weights {
            para: 10.0,
            deform: 0.5,
            deform_decay: 1.0,
            eikonal: 0.001,
            laplacian: 0.01,
            on_points: 0.02,
            cover: 1.0,
            bridge: 0.01,
            ..Weights::NONE
        },
        stages: vec![Stage { resolution: 32, steps: 60 }, Stage { resolution: 48, steps: 60 }],
        reference_area: Some(USUAL_AREA),
        band: Band { refresh: 4, rings: 0, shift: 1.0 },
        batch: Batch { thin: Some(0.25), points: 4096, centres: 1024 },
        surface_samples: Some(4000),
        field_rate: Schedule { base: 5e-4, warmup: 20, decay: Decay::Cosine { floor: 0.05 } },
        bsp_rate: Schedule { base: 1e-3, warmup: 20, decay: Decay::Cosine { floor: 0.05 } },
        clip: None,
        finish: Finishing::Points,
        min_component: 0.01,
    }
}

fn fine() -> Config {
    Config {
        field: FieldConfig { width: 128, ..default().field },
        bsp_pretrain: 100,
        bsp_every: Some(2),
        start: Start { steps: 400, ..default().start },
        stages: [32, 48].map(|resolution| Stage { resolution, steps: 200 }).to_vec(),
        surface_samples: Some(8000),
        ..default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_round_trip() {
        for preset in Preset::ALL {
            assert_eq!(preset.to_string().parse::<Preset>().unwrap(), preset);
        }
        let error = "best".parse::<Preset>().unwrap_err();
        assert_eq!((error.kind(), error.element()), (ErrorKind::Config, Some("option preset")));
    }
}
