//! One iteration of training.

use super::model::{Reconstruction, grid};
use super::{Config, StartShape, Target};
use crate::autodiff::{Gradients, Tape, Var};
use crate::bsp::{Bsp, Parameterization};
use crate::error::{Error, ErrorKind};
use crate::gdo::{Field, FieldPass, GaussField, deform, fit_to_mesh};
use crate::geometry::{
    ActiveSet, BandTopology, Isosurface, KdTree, NarrowBandOptions, Normalizer, active_set, clean_cloud,
    extract,
};
use crate::loss::{Direction, eikonal, surface_term};
use crate::nn::Bound;
use crate::optim::{Adam, AdamOptions, clip_norm, gradient_norm};
use crate::tensor::Tensor;
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use std::time::Instant;

/// What happened in a step.
#[derive(Clone, Copy, Debug, Default)]
pub struct StepReport {
    pub step: usize,
    pub total: usize,
    pub resolution: usize,
    pub loss: f32,
    pub para: f32,
    pub deform: f32,
    pub surf: f32,
    pub eikonal: f32,
    pub points: f32,
    pub laplacian: f32,
    pub pull: f32,
    pub cover: f32,
    pub recoveries: usize,
    pub field_rate: f32,
    pub bsp_rate: f32,
    pub gradient_norm: f64,
    pub active_verts: usize,
    pub surface_verts: usize,
    pub seconds: f64,
}

/// Training in progress.
pub struct Trainer {
    config: Config,
    input: Vec<[f32; 3]>,
    normalizer: Normalizer,
    cloud: Vec<[f32; 3]>,
    field: Field,
    bsp: Bsp,
    adam_field: Adam,
    adam_bsp: Adam,
    pass: FieldPass,
    tape: Tape,
    step: usize,
    total: usize,
    band: ActiveSet,
    topology: BandTopology,
    band_resolution: usize,
    iso: Isosurface,
    surface: Vec<[f32; 3]>,
}

impl Trainer {
    /// TODO docs.
    pub fn new(points: &[[f32; 3]], config: &Config) -> Result<Self, Error> {
        Self::from_start(prepare(points, config)?)
    }

    pub(super) fn from_start(prepared: Prepared) -> Result<Self, Error> {
        let Prepared { config, cloud: input, normalizer, .. } = prepared;
        let cloud = normalizer.forward(&input);
        let mut rng = ChaCha8Rng::seed_from_u64(config.seed);
        let mut field = Field::new(config.field, &mut rng);
        let bsp = Bsp::new(config.bsp, &cloud, &mut rng);
        let mut pass = FieldPass::new();
        let start = config.start;
        if start.shape == StartShape::Gauss {
            let gauss = GaussField::fit(&cloud, start.width, start.regularity, config.seed)?;
            let grid = grid(48)?;
            let mut eval = |x: &[[f32; 3]]| Ok(gauss.sdf(x));
            let options = NarrowBandOptions { seeds: &cloud, ..Default::default() };
            let mesh = extract(&grid, &mut eval, &options)?.keep_large(0.02);
            fit_to_mesh(&mut field, &mut pass, &mesh, start.steps, start.rate, config.seed)?;
        }
        let adam_field = Adam::new(field.params().values(), AdamOptions::default());
        let adam_bsp = Adam::new(bsp.params().values(), AdamOptions::default());
        let total = config.stages.iter().map(|s| s.steps).sum();
        let mut t = Trainer {
            config,
            input,
            normalizer,
            cloud,
            field,
            bsp,
            adam_field,
            adam_bsp,
            pass,
            tape: Tape::new(),
            step: 0,
            total,
            band: ActiveSet::default(),
            topology: BandTopology::default(),
            band_resolution: 0,
            iso: Isosurface::default(),
            surface: Vec::new(),
        };
        if t.config.parameterization != Parameterization::None {
            for i in 0..t.config.bsp_pretrain {
                t.pretrain_bsp(i);
            }
        }
        Ok(t)
    }

    fn pretrain_bsp(&mut self, i: usize) {
        self.tape.clear();
        let p = self.bsp.params().bind(&mut self.tape, true);
        let q = self.tape.constant(Tensor::from_points(&self.cloud));
        let out = self.bsp.forward(&mut self.tape, &p, q);
        let loss = self.tape.chamfer(out.surface, q, Direction::BOTH);
        let gradients = p.collect(&mut self.tape.backward(loss));
        self.surface = self.tape.value(out.surface).to_points();
        self.tape.clear();
        let rate = self.config.bsp_rate.rate_at(i, self.config.bsp_pretrain);
        self.adam_bsp.step(self.bsp.params_mut().values_mut(), &gradients, rate);
    }

    pub fn is_done(&self) -> bool {
        self.step >= self.total
    }

    fn resolution(&self) -> usize {
        let mut left = self.step;
        for s in &self.config.stages {
            if left < s.steps {
                return s.resolution;
            }
            left -= s.steps;
        }
        self.config.stages.last().map_or(32, |s| s.resolution)
    }

    pub fn step(&mut self) -> Result<StepReport, Error> {
        let began = Instant::now();
        let resolution = self.resolution();
        if self.step % self.config.band.refresh == 0 || resolution != self.band_resolution {
            let grid = grid(resolution)?;
            let field = &self.field;
            let mut eval = |x: &[[f32; 3]]| Ok(field.sdf(x));
            self.band = active_set(&grid, &mut eval, &self.cloud, self.config.band.rings)?;
            self.topology = self.band.topology();
            self.band_resolution = resolution;
        }
        let w = self.config.weights;
        let v = self.band.positions.len();
        let n = self.cloud.len();
        let mut verts = self.band.positions.clone();
        verts.extend_from_slice(&self.cloud);
        let tape = &mut self.tape;
        tape.clear();
        let (sdf, gradient) = self.pass.forward(&self.field, &verts, tape.pool());
        let inside: Vec<bool> = sdf.data()[..v].iter().map(|&s| s < 0.0).collect();
        self.topology.march_into(&inside, &mut self.iso);
        if self.iso.faces.is_empty() {
            return Err(Error::new(ErrorKind::NoSurface, "the surface vanished during training"));
        }
        let sdf_all = tape.input(sdf);
        let gradient_all = tape.input(gradient);
        let s = tape.slice_rows(sdf_all, 0..v);
        let g = tape.slice_rows(gradient_all, 0..v);
        let sq = tape.slice_rows(sdf_all, v..v + n);
        let positions = tape.constant(Tensor::from_points(&verts[..v]));
        let moved = deform(tape, self.config.deformation, positions, s, g);
        let vbar = tape.edge_crossing(moved, s, &self.iso.edges[..]);
        let q = tape.constant(Tensor::from_points(&self.cloud));

        let train_bsp = self.config.parameterization != Parameterization::None
            && self.config.bsp_every > 0
            && self.step % self.config.bsp_every == 0;
        let mut bound = None;
        let surface = if self.config.parameterization == Parameterization::None {
            None
        } else if train_bsp {
            let p = self.bsp.params().bind(tape, true);
            let out = self.bsp.forward(tape, &p, q);
            bound = Some(p);
            self.surface = tape.value(out.surface).to_points();
            Some(out.surface)
        } else {
            Some(tape.constant(Tensor::from_points(&self.surface)))
        };
        let target = match (self.config.target, surface) {
            (Target::Surface, Some(s)) => s,
            (Target::SurfaceAndCloud, Some(s)) => tape.concat_rows([s, q]),
            _ => q,
        };
        let drawn = if self.config.surface_samples > 0 {
            sample_faces(
                tape,
                vbar,
                &self.iso.faces,
                self.config.surface_samples,
                self.config.seed,
                self.step,
            )
        } else {
            vbar
        };
        let mut report = StepReport {
            step: self.step,
            total: self.total,
            resolution,
            active_verts: v,
            surface_verts: self.iso.edges.len(),
            ..Default::default()
        };
        let mut loss = None;
        let mut add = |tape: &mut Tape, weight: f32, term: Var| -> f32 {
            let value = tape.value(term).item();
            if weight != 0.0 {
                let scaled = tape.scale(term, weight);
                loss = Some(match loss {
                    Some(l) => tape.add(l, scaled),
                    None => scaled,
                });
            }
            value
        };
        let term = tape.chamfer(drawn, target, Direction::BOTH);
        report.deform = add(tape, w.deform, term);
        if w.cover > 0.0 {
            let term = tape.chamfer(drawn, q, Direction { forward: 0.0, backward: 1.0 });
            add(tape, w.cover, term);
        }
        if train_bsp && let Some(s) = surface {
            let term = tape.chamfer(s, q, Direction::BOTH);
            report.para = add(tape, w.para, term);
        }
        let term = surface_term(tape, s);
        report.surf = add(tape, w.surf, term);
        if w.eikonal > 0.0 {
            let term = eikonal(tape, gradient_all);
            report.eikonal = add(tape, w.eikonal, term);
        }
        if w.points > 0.0 {
            let term = tape.abs(sq);
            let term = tape.mean(term);
            report.points = add(tape, w.points, term);
        }
        if w.laplacian > 0.0 {
            let term = tape.laplacian(vbar, &self.iso.faces[..]);
            add(tape, w.laplacian, term);
        }
        if w.pull > 0.0 {
            let t = tape.value(target).to_points();
            let (index, _) = KdTree::new(&t).nearest_all(&verts[..v]);
            let nearest = tape.gather_rows(target, index);
            let off = tape.sub(moved, nearest);
            let off = tape.square(off);
            let off = tape.sum_cols(off);
            let term = tape.mean(off);
            add(tape, w.pull, term);
        }
        let loss = loss.expect("some weight");
        report.loss = tape.value(loss).item();
        let mut gradients: Gradients = tape.backward(loss);
        let d_sdf = gradients.take(sdf_all).expect("depends");
        let d_gradient = gradients.take(gradient_all).unwrap_or_else(|| Tensor::zeros(&[v + n, 3]));
        let mut field_gradients = self.pass.backward(&d_sdf, &d_gradient);
        report.gradient_norm = if self.config.clip > 0.0 {
            clip_norm(&mut field_gradients, self.config.clip)
        } else {
            gradient_norm(&field_gradients)
        };
        if !report.loss.is_finite() || !report.gradient_norm.is_finite() {
            return Err(Error::new(ErrorKind::Diverged, "diverged"));
        }
        report.field_rate = self.config.field_rate.rate_at(self.step, self.total);
        report.bsp_rate = self.config.bsp_rate.rate_at(self.step, self.total);
        let bsp_gradients = bound.map(|p: Bound| p.collect(&mut gradients));
        self.tape.clear();
        self.pass.release();
        self.adam_field.step(self.field.params_mut().values_mut(), &field_gradients, report.field_rate);
        if let Some(g) = bsp_gradients {
            self.adam_bsp.step(self.bsp.params_mut().values_mut(), &g, report.bsp_rate);
        }
        self.step += 1;
        report.seconds = began.elapsed().as_secs_f64();
        Ok(report)
    }

    pub fn steps_done(&self) -> usize {
        self.step
    }

    pub fn total_steps(&self) -> usize {
        self.total
    }

    pub fn last_recovery(&self) -> Option<&str> {
        None
    }

    pub fn finish(self) -> Reconstruction {
        Reconstruction {
            config: self.config,
            normalizer: self.normalizer,
            cloud: self.input,
            field: self.field,
            surface: self.surface,
        }
    }
}

pub(super) struct Prepared {
    pub config: Config,
    pub cloud: Vec<[f32; 3]>,
    pub merged: usize,
    pub normalizer: Normalizer,
}

pub(super) fn prepare(points: &[[f32; 3]], config: &Config) -> Result<Prepared, Error> {
    config.validate()?;
    let clean = clean_cloud(points)?;
    let normalizer = Normalizer::of(&clean.points)?;
    Ok(Prepared {
        config: config.clone().for_points(clean.points.len()),
        cloud: clean.points,
        merged: clean.duplicates_merged,
        normalizer,
    })
}

fn sample_faces(tape: &mut Tape, vbar: Var, faces: &[[u32; 3]], count: usize, seed: u64, step: usize) -> Var {
    let x = tape.value(vbar).to_points();
    let mut sums = Vec::with_capacity(faces.len());
    let mut sum = 0.0f64;
    for f in faces {
        let [a, b, c] = f.map(|i| x[i as usize]);
        let u: [f64; 3] = std::array::from_fn(|d| f64::from(b[d] - a[d]));
        let v: [f64; 3] = std::array::from_fn(|d| f64::from(c[d] - a[d]));
        let n = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
        sum += (n[0] * n[0] + n[1] * n[1] + n[2] * n[2]).sqrt();
        sums.push(sum);
    }
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    rng.set_stream(step as u64 + 1);
    let mut index = [Vec::with_capacity(count), Vec::with_capacity(count), Vec::with_capacity(count)];
    let mut weight = [Vec::with_capacity(count), Vec::with_capacity(count), Vec::with_capacity(count)];
    for i in 0..count {
        // Stratified along the cumulative area.
        let at = (i as f64 + rng.random::<f64>()) / count as f64 * sum;
        let f = sums.partition_point(|&s| s < at).min(faces.len() - 1);
        let r = rng.random::<f32>().sqrt();
        let u = rng.random::<f32>();
        for (k, w) in [1.0 - r, r * (1.0 - u), r * u].into_iter().enumerate() {
            index[k].push(faces[f][k]);
            weight[k].push(w);
        }
    }
    let mut out = None;
    for (index, weight) in index.into_iter().zip(weight) {
        let corner = tape.gather_rows(vbar, index);
        let weight = tape.constant(Tensor::from_vec(&[count, 1], weight));
        let part = tape.mul(corner, weight);
        out = Some(match out {
            Some(o) => tape.add(o, part),
            None => part,
        });
    }
    out.expect("three corners")
}
