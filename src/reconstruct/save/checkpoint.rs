//! Saving the state of a run, and taking it up again.

use super::input as saved_input;
use super::kind::CHECKPOINT;
use super::options as saved_options;
use super::params::read_params;
use super::store::{Store, damaged};
use crate::error::{Error, ErrorKind};
use crate::geometry::{Position, widened};
use crate::nn::Params;
use crate::optim::Adam;
use crate::reconstruct::bridges::Bridges;
use crate::reconstruct::frame::WorkingFrame;
use crate::reconstruct::setup::prepare;
use crate::reconstruct::state::{State, fresh_adam};
use crate::reconstruct::trainer::{MAX_RECOVERIES, find_band};
use crate::reconstruct::{Config, Hints, Phase, Trainer};
use crate::tensor::Tensor;
use std::path::Path;

impl Trainer {
    /// Saves everything that the rest of the run depends on, so that a run resumed from the file ends in the same
    /// bytes as one that was never stopped. The same state gives the same file.
    ///
    /// The file is in the safetensors format: parameters and optimiser moments now and at the last good state, S, and,
    /// as metadata, options, step and a fingerprint of the input points, under one checksum. It appears whole or not at
    /// all. The figures of [`Reconstruction::coverage`](crate::Reconstruction::coverage) and the codes of
    /// [`Trainer::coded`] follow from that state and are not in it: a resumed run has them, at the step it was saved at
    /// and at its end.
    ///
    /// # Errors
    /// [`ErrorKind::Io`] if the file cannot be written.
    pub fn save_checkpoint(&self, path: impl AsRef<Path>) -> Result<(), Error> {
        self.to_store().write(path.as_ref())
    }

    /// Takes up the run that [`save_checkpoint`](Self::save_checkpoint) saved, for the same `points` (n x 3) and
    /// options; only `finish`, which comes after the training, may be another.
    /// [`Saved`](crate::reconstruct::Saved) knows the options of a file.
    ///
    /// # Errors
    /// [`ErrorKind::Io`] if the file cannot be read, [`ErrorKind::Checkpoint`] if it is damaged or belongs to other
    /// points or other options (the first that differs is named), and as [`Trainer::new`].
    pub fn resume<P: Position>(
        path: impl AsRef<Path>,
        points: &[P],
        config: &Config,
    ) -> Result<Trainer, Error> {
        Self::resume_with_hints(path, points, config, &Hints::default())
    }

    /// The same for a run that was started with [hints](Trainer::with_hints), which must be the same again.
    ///
    /// # Errors
    /// As [`resume`](Self::resume).
    ///
    /// # Panics
    /// As [`Trainer::with_hints`].
    #[track_caller]
    pub fn resume_with_hints<P: Position>(
        path: impl AsRef<Path>,
        points: &[P],
        config: &Config,
        hints: &Hints<'_>,
    ) -> Result<Trainer, Error> {
        let path = path.as_ref();
        let prepared = prepare(points, config, hints)?;
        let store = Store::read(path)?;
        let resume = || -> Result<Trainer, Error> {
            let version = CHECKPOINT.check(&store)?;
            check_config(&saved_options::of_checkpoint(&store, version), &prepared.config)?;
            let input = store.get("cloud")?;
            if input != saved_input::fingerprint(&prepared.input) {
                return Err(Error::new(ErrorKind::Checkpoint, "it belongs to other input points")
                    .advise("resume with the points that the run was started with"));
            }
            let stretch = stretched(&prepared.frame);
            if store.get(STRETCH).ok() != stretch.as_deref() {
                let message = match store.get(STRETCH) {
                    Ok(factors) => format!("its axes were stretched by {factors}"),
                    Err(_) => "its axes were not stretched".to_string(),
                };
                return Err(Error::new(ErrorKind::Checkpoint, message)
                    .advise("resume with the same anisotropy as the run was started with"));
            }
            let normals = prepared.normals.as_deref().map(fingerprint_of_normals);
            let advice = match (store.get(NORMALS).ok(), normals.as_deref()) {
                (then, now) if then == now => None,
                (Some(_), None) => Some("it was started with normals or an origin; give them again"),
                (None, Some(_)) => {
                    Some("it was started without normals and without an origin; leave them out")
                }
                _ => Some("it was started with other normals or another origin; give those again"),
            };
            if let Some(advice) = advice {
                return Err(Error::new(ErrorKind::Checkpoint, "its points had other sides").advise(advice));
            }
            let mut trainer = Trainer::from_prepared(prepared)?;
            let mut expected = trainer.to_store().tensors;
            for name in ["now.bridges", "good.bridges"] {
                let rows = store.tensors.get(name).map_or(0, Tensor::rows);
                expected.insert(name.into(), Tensor::zeros(&[rows, 4]));
            }
            store.check_tensors(&expected)?;
            trainer.recoveries = store.parse("recoveries")?;
            if trainer.recoveries > MAX_RECOVERIES {
                return Err(damaged(format!("{} recoveries", trainer.recoveries)));
            }
            let now = read_state(&store, "now", &trainer.state)?;
            let good = read_state(&store, "good", &trainer.state)?;
            if good.step > now.step || now.step > trainer.total_steps() {
                return Err(damaged(format!("step {} after good step {}", now.step, good.step)));
            }
            // The band is the one that was searched for at the good state; a state of an earlier phase has none.
            if let (true, (Phase::Train, step)) = (now.step > good.step, trainer.config().phase_at(good.step))
            {
                let resolution = trainer.setup.resolution_at(step);
                trainer.band = Some(find_band(&trainer.setup, &good, resolution, &|| false)?);
            }
            (trainer.state, trainer.good) = (now, good);
            Ok(trainer)
        };
        resume().map_err(|e| e.in_file(path))
    }

    fn to_store(&self) -> Store {
        let mut store = Store::default();
        CHECKPOINT.put(&mut store);
        saved_options::put(&mut store, &self.setup.config);
        store.put("cloud", saved_input::fingerprint(&self.setup.input));
        if let Some(stretch) = stretched(&self.setup.frame) {
            store.put(STRETCH, stretch);
        }
        if let Some(normals) = &self.setup.normals {
            store.put(NORMALS, fingerprint_of_normals(normals));
        }
        store.put("recoveries", self.recoveries);
        put_state(&mut store, "now", &self.state);
        put_state(&mut store, "good", &self.good);
        store
    }
}

/// The fingerprint of given normals.
const NORMALS: &str = "normals";

/// The factors that the axes were stretched by; absent if they were not.
const STRETCH: &str = "anisotropy";

fn stretched(frame: &WorkingFrame) -> Option<String> {
    (!frame.is_plain()).then(|| frame.stretch().map(|x| x.to_string()).join(" "))
}

fn fingerprint_of_normals(normals: &[[f32; 3]]) -> String {
    saved_input::fingerprint(&widened(normals))
}

/// Options that do not affect the training and may be changed when it is resumed. `min_component` is none of them: gaps
/// are bridged during the training between the parts of the surface that it leaves.
const MAY_CHANGE: [&str; 1] = ["finish"];

/// Refuses to go on with other options than those of a checkpoint.
fn check_config(stored: &[(String, String)], config: &Config) -> Result<(), Error> {
    let refused = |key: &str, message: String, advice: &str| {
        let error = Error::new(ErrorKind::Checkpoint, message).at_element(format!("option {key}"));
        Err(error.advise(advice))
    };
    let entries = config.entries();
    for (key, value) in &entries {
        let Some((_, stored)) = stored.iter().find(|(k, _)| k == key) else {
            return Err(damaged(format!("it has no config.{key}")));
        };
        if stored != value && !MAY_CHANGE.contains(key) {
            let message = format!("{stored} in the checkpoint, {value} here");
            return refused(key, message, "resume with the options that the run was started with");
        }
    }
    // An option that this version does not know may have changed the training: the run would not go on as it began.
    match stored.iter().find(|(k, _)| entries.iter().all(|(key, _)| k != key)) {
        Some((key, _)) => {
            let message = "unknown to this version".to_string();
            refused(key, message, "resume with the version of this program that wrote the checkpoint")
        }
        None => Ok(()),
    }
}

fn read_bridges(store: &Store, name: &str) -> Result<Bridges, Error> {
    let tensor = &store.tensors[&format!("{name}.bridges")];
    if !tensor.is_finite() {
        return Err(damaged("its bridges are not finite"));
    }
    let rows = tensor.data().as_chunks::<4>().0;
    Ok(Bridges {
        points: rows.iter().map(|r| [r[0], r[1], r[2]]).collect(),
        depths: rows.iter().map(|r| r[3]).collect(),
        looked: store.parse(&format!("{name}.looked"))?,
    })
}

fn put_state(store: &mut Store, name: &str, state: &State) {
    store.put(&format!("{name}.step"), state.step);
    put_learned(store, &format!("{name}.field"), state.field.params(), &state.field_adam);
    if let (Some(map), Some(adam)) = (&state.map, &state.map_adam) {
        put_learned(store, &format!("{name}.map"), map.params(), adam);
        store.tensors.insert(format!("{name}.surface"), Tensor::from_points(&state.surface));
    }
    let Bridges { points, depths, looked } = &state.bridges;
    store.put(&format!("{name}.looked"), looked);
    let rows: Vec<f32> = points.iter().zip(depths).flat_map(|(p, &d)| [p[0], p[1], p[2], d]).collect();
    store.tensors.insert(format!("{name}.bridges"), Tensor::from_vec(&[points.len(), 4], rows));
}

fn put_learned(store: &mut Store, name: &str, params: &Params, adam: &Adam) {
    for (_, param, value) in params.iter() {
        store.tensors.insert(format!("{name}.value.{param}"), value.clone());
    }
    for (moments, tensor) in adam.state(params.names()) {
        store.tensors.insert(format!("{name}.{moments}"), tensor);
    }
}

/// Reads a state of the shape of another one; its tensors have been checked to be there.
fn read_state(store: &Store, name: &str, like: &State) -> Result<State, Error> {
    let mut state = like.clone();
    state.step = store.parse(&format!("{name}.step"))?;
    read_learned(store, &format!("{name}.field"), state.field.params_mut(), &mut state.field_adam)?;
    if let (Some(map), Some(adam)) = (&mut state.map, &mut state.map_adam) {
        read_learned(store, &format!("{name}.map"), map.params_mut(), adam)?;
    }
    let surface = store.tensors.get(&format!("{name}.surface")).map(Tensor::to_points);
    state.surface = surface.unwrap_or_default();
    state.bridges = read_bridges(store, name)?;
    Ok(state)
}

fn read_learned(store: &Store, name: &str, params: &mut Params, adam: &mut Adam) -> Result<(), Error> {
    read_params(store, &format!("{name}.value."), params);
    *adam = fresh_adam(params);
    adam.restore(params.names(), |moments| store.tensors.get(&format!("{name}.{moments}")).cloned())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bsp::Parameterization;
    use crate::gdo::Deformation;
    use crate::geometry::AnalyticShape;
    use crate::reconstruct::tests::ablations::with_charts;
    use crate::reconstruct::tests::{ball, bits, noisy, poison, quick, run, tiny};
    use crate::reconstruct::{Batch, Finishing, Reconstruction};
    use std::path::PathBuf;

    fn file(name: &str) -> PathBuf {
        std::env::temp_dir().join(format!("bijective-sdf-{name}-{}.safetensors", std::process::id()))
    }

    #[test]
    fn a_resumed_run_ends_in_the_same_bytes() {
        let points = ball(70);
        let path = file("resume");
        let mut blocks = tiny();
        blocks.batch = Batch { thin: Some(0.25), points: 40, centres: 30 };
        blocks.surface_samples = Some(50);
        let sparse = Config { parameterization: Parameterization::None, ..tiny() };
        let upsample = Config { parameterization: Parameterization::Upsample, ..blocks.clone() };
        let offset = Config { deformation: Deformation::Offset, ..tiny() };
        let (scattered, finer) = noisy(70);
        assert!(Trainer::new(&scattered, &finer).unwrap().noise_removed() > 0.0);
        // In every phase (30, 5 and 12 steps; none to pretrain without a parameterization), at its ends and between two
        // searches for the band.
        let stops = &[0, 1, 25, 30, 33, 35, 36, 39][..];
        let charts = with_charts(tiny());
        let small = Config { batch: blocks.batch, ..charts.clone() };
        let exact = [tiny(), blocks, sparse, upsample, offset, charts, small]
            .map(|config| (points.clone(), config, stops));
        for (points, config, stops) in exact.into_iter().chain([(scattered, finer, &stops[6..])]) {
            let straight = bits(&run(&points, &config));
            for &stop in stops {
                let mut trainer = Trainer::new(&points, &config).unwrap();
                for _ in 0..stop {
                    trainer.step().unwrap();
                }
                trainer.save_checkpoint(&path).unwrap();
                drop(trainer);
                let mut resumed = Trainer::resume(&path, &points, &config).unwrap();
                assert_eq!(resumed.steps_done(), stop);
                // Saving at once gives the same file.
                let before = std::fs::read(&path).unwrap();
                resumed.save_checkpoint(&path).unwrap();
                assert!(before == std::fs::read(&path).unwrap());
                while !resumed.is_done() {
                    resumed.step().unwrap();
                }
                assert!(bits(&resumed.finish()) == straight, "stopped at step {stop}");
            }
        }
        std::fs::remove_file(path).unwrap();
    }

    #[test]
    fn bridges_are_kept() {
        let points = ball(60);
        let path = file("bridges");
        let mut trainer = Trainer::new(&points, &tiny()).unwrap();
        for _ in 0..37 {
            trainer.step().unwrap();
        }
        let clear = trainer.to_store();
        let points_inside = vec![[0.7, 0.1, 0.0], [0.6, 0.2, 0.1]];
        trainer.state.bridges = Bridges { points: points_inside, depths: vec![0.05, 0.1], looked: 9 };
        trainer.save_checkpoint(&path).unwrap();
        let mut resumed = Trainer::resume(&path, &points, &tiny()).unwrap();
        assert_eq!(resumed.state.bridges, trainer.state.bridges);
        let end = |trainer: &mut Trainer| {
            while !trainer.is_done() {
                trainer.step().unwrap();
            }
            let mut tensors = trainer.to_store().tensors;
            tensors.retain(|name, _| !name.ends_with(".bridges"));
            tensors
        };
        let with = end(&mut trainer);
        assert!(end(&mut resumed) == with);
        clear.write(&path).unwrap();
        assert!(end(&mut Trainer::resume(&path, &points, &tiny()).unwrap()) != with);

        let mut bad = clear;
        bad.tensors.insert("good.bridges".into(), Tensor::from_vec(&[1, 4], vec![f32::NAN; 4]));
        bad.write(&path).unwrap();
        let error = Trainer::resume(&path, &points, &tiny()).err().unwrap();
        assert!(error.kind() == ErrorKind::Checkpoint && error.to_string().contains("bridges"), "{error}");
        std::fs::remove_file(path).unwrap();
    }

    /// A training that bridges a gap on its way ends in the same state, whatever else the options are that may change.
    #[test]
    fn options_that_may_change_do_not_touch_the_training() {
        let points = AnalyticShape::TwoSpheres { radius: 0.21, distance: 0.48 }.sample(250, 3).0;
        let trained = |config: &Config| {
            let mut trainer = Trainer::new(&points, config).unwrap();
            while !trainer.is_done() {
                trainer.step().unwrap();
            }
            trainer.to_store().tensors
        };
        let usual = trained(&quick());
        assert!(usual["now.bridges"].rows() > 0);
        let other = |key: &str| match key {
            "finish" => Config { finish: Finishing::None, ..quick() },
            "min_component" => Config { min_component: 1.0, ..quick() },
            _ => panic!("no other value of {key} to try"),
        };
        for key in MAY_CHANGE {
            assert!(trained(&other(key)) == usual, "{key}");
        }
        // As an example of one that does.
        assert!(trained(&other("min_component")) != usual);
    }

    #[test]
    fn a_recovery_after_resuming_is_the_one_that_would_have_been() {
        let points = ball(60);
        let path = file("recovery");
        let finish = |mut trainer: Trainer| {
            poison(&mut trainer, false, f32::NAN);
            while !trainer.is_done() {
                trainer.step().unwrap();
            }
            assert_eq!(trainer.recoveries, 2);
            bits(&trainer.finish())
        };
        // In the start, across the beginning of the training, and within it.
        for (bad, network, stop) in [(23, false, 7), (34, true, 5), (38, true, 4)] {
            let mut trainer = Trainer::new(&points, &tiny()).unwrap();
            for _ in 0..bad {
                trainer.step().unwrap();
            }
            poison(&mut trainer, network, f32::NAN);
            for _ in 0..stop {
                trainer.step().unwrap();
            }
            trainer.save_checkpoint(&path).unwrap();
            let resumed = Trainer::resume(&path, &points, &tiny()).unwrap();
            assert!(finish(trainer) == finish(resumed), "wrong at {bad}");
        }
        std::fs::remove_file(path).unwrap();
    }

    #[test]
    fn other_points_options_and_damaged_files_are_refused() {
        let points = ball(50);
        let path = file("damage");
        let mut trainer = Trainer::new(&points, &tiny()).unwrap();
        trainer.step().unwrap();
        trainer.save_checkpoint(&path).unwrap();

        let mut other = tiny();
        other.weights.on_points = 0.5;
        let error = Trainer::resume(&path, &points, &other).err().unwrap();
        assert_eq!(
            (error.kind(), error.element()),
            (ErrorKind::Checkpoint, Some("option weights.on_points"))
        );
        assert_eq!(error.file(), Some(path.as_path()));
        let parts = Config { min_component: 0.5, ..tiny() };
        let error = Trainer::resume(&path, &points, &parts).err().unwrap();
        assert_eq!(error.element(), Some("option min_component"));
        assert!(Trainer::resume(&path, &points, &Config { finish: Finishing::None, ..tiny() }).is_ok());
        let error = Trainer::resume(&path, &ball(51), &tiny()).err().unwrap();
        assert!(error.kind() == ErrorKind::Checkpoint && error.message().contains("other input points"));
        let error = Reconstruction::load(&path).err().unwrap();
        assert_eq!(error.kind(), ErrorKind::Checkpoint);
        let error = Trainer::resume(file("nothing"), &points, &tiny()).err().unwrap();
        assert_eq!(error.kind(), ErrorKind::Io);

        let good = std::fs::read(&path).unwrap();
        for i in (0..good.len()).step_by(good.len() / 40) {
            let mut bad = good.clone();
            bad[i] ^= 0x11;
            std::fs::write(&path, &bad).unwrap();
            let error = Trainer::resume(&path, &points, &tiny()).err().unwrap();
            assert_eq!(error.kind(), ErrorKind::Checkpoint, "byte {i}: {error}");
            std::fs::write(&path, &good[..i]).unwrap();
            let error = Trainer::resume(&path, &points, &tiny()).err().unwrap();
            assert_eq!(error.kind(), ErrorKind::Checkpoint, "cut at {i}: {error}");
        }
        std::fs::remove_file(path).unwrap();
    }

    #[test]
    fn a_checkpoint_of_a_version_with_more_options_is_not_gone_on_with() {
        let points = ball(50);
        let path = file("later");
        let mut store = Trainer::new(&points, &tiny()).unwrap().to_store();
        store.put("config.weights.later", 1);
        store.write(&path).unwrap();
        let error = Trainer::resume(&path, &points, &tiny()).err().unwrap();
        assert_eq!((error.kind(), error.element()), (ErrorKind::Checkpoint, Some("option weights.later")));
        std::fs::remove_file(path).unwrap();
    }
}
