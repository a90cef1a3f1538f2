//! What can be chosen, and the presets.

use crate::bsp::BspConfig;
use crate::gdo::{Activation, Deformation, FieldConfig};
use crate::optim::{Decay, Schedule};

/// The shape that the field starts as.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Start {
    /// A sphere.
    Sphere,
    /// The parametric Gauss formula of the cloud.
    Gauss { width: f32, regularity: f64, steps: usize },
}

/// What the extracted surface is drawn to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Target {
    /// The parameterized surface S (equation 5 of the paper).
    Surface,
    /// S united with the cloud Q, as in the authors' code.
    SurfaceAndCloud,
    /// The cloud alone: the ablation without BSP.
    Cloud,
}

/// Weights of the loss terms.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Weights {
    pub para: f32,
    pub deform: f32,
    pub surf: f32,
    pub eikonal: f32,
    pub laplacian: f32,
    pub points: f32,
    pub pull: f32,
    pub cover: f32,
    pub deform_end: f32,
    pub deform_back: f32,
    pub prune: f32,
    pub prune_margin: f32,
}

/// Part of the training, at one grid resolution.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Stage {
    pub resolution: usize,
    pub steps: usize,
}

/// A named configuration.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Preset {
    Paper,
    Fast,
    Default,
    Fine,
}

#[derive(Clone, Debug, PartialEq)]
pub struct Config {
    pub seed: u64,
    pub field: FieldConfig,
    pub bsp: BspConfig,
    pub start: Start,
    pub target: Target,
    pub deformation: Deformation,
    pub weights: Weights,
    pub stages: Vec<Stage>,
    pub refresh: usize,
    pub rings: usize,
    pub surface_samples: usize,
    pub bsp_pretrain: usize,
    pub bsp_every: usize,
    pub field_rate: Schedule,
    pub bsp_rate: Schedule,
    pub clip: f64,
}

impl Config {
    pub fn preset(_: Preset) -> Self {
        Config {
            seed: 0,
            field: FieldConfig {
                width: 128,
                depth: 4,
                octaves: 3,
                frequency: 2.0,
                activation: Activation::Softplus { beta: 100.0 },
                skip: None,
                radius: 0.35,
            },
            bsp: BspConfig {
                channels: 64,
                heads: 4,
                neighbours: 8,
                patch: 10,
                sphere: 1.0,
                reach: 12,
                average_positions: true,
            },
            start: Start::Gauss { width: 0.5, regularity: 0.05, steps: 300 },
            target: Target::SurfaceAndCloud,
            deformation: Deformation::Projection,
            weights: Weights {
                para: 10.0,
                deform: 1.0,
                surf: 0.01,
                eikonal: 0.01,
                laplacian: 0.0,
                points: 0.0,
                pull: 0.0,
                cover: 0.0,
                deform_end: 0.0,
                deform_back: 1.0,
                prune: 0.0,
                prune_margin: 2.0,
            },
            stages: vec![Stage { resolution: 32, steps: 300 }],
            refresh: 5,
            rings: 1,
            surface_samples: 0,
            bsp_pretrain: 100,
            bsp_every: 2,
            field_rate: Schedule { base: 5e-4, warmup: 20, decay: Decay::Cosine { floor: 0.05 } },
            bsp_rate: Schedule { base: 1e-3, warmup: 20, decay: Decay::Cosine { floor: 0.05 } },
            clip: 0.0,
        }
    }
}
