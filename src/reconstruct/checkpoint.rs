//! Saving a run or its result, and taking it up again.

use super::bridges::Bridges;
use super::model::{FoundShape, Shape};
use super::saved_cloud;
use super::saved_options;
use super::step::FAR;
use super::store::{Store, damaged};
use super::trainer::{Learned, RECOVERIES, Snapshot, blank_field, prepare};
use super::{Config, Reconstruction, Trainer};
use crate::error::{Error, ErrorKind};
use crate::geometry::{Normalizer, Position, TriangleMesh};
use crate::nn::Params;
use crate::optim::{Adam, AdamOptions};
use crate::tensor::Tensor;
use rand::SeedableRng;
use rand::rngs::ChaCha8Rng;
use std::collections::BTreeMap;
use std::path::Path;

/// What a file holds, and in which versions of its form this program reads it.
pub(super) struct Kind {
    pub name: &'static str,
    /// The version that is written, and the last that is read.
    version: u32,
    /// The first version that is read.
    oldest: u32,
}

pub(super) const CHECKPOINT: Kind = Kind { name: "checkpoint", version: 5, oldest: 4 };
/// Files of version 2 are read by all later programs. Options may come, go and change their names within a version, as
/// far as [`saved_options`] says what stands for those that are missing; the version grows with a change of meaning.
pub(super) const RECONSTRUCTION: Kind = Kind { name: "reconstruction", version: 4, oldest: 2 };
/// Vertices and faces (as numbers) of a result that is the first shape itself; each n x 3.
const FOUND: [&str; 2] = ["shape.verts", "shape.faces"];
/// Points that a result is finished for, n x 3: those of the cloud without their noise.
const FINISH: &str = "finish.points";

impl Trainer {
    /// Saves everything that the rest of the run depends on, so that a run resumed from the file ends in the same
    /// bytes as one that was never stopped. The same state gives the same file.
    ///
    /// The file is in the safetensors format: parameters and optimiser moments now and at the last good state, S, and,
    /// as metadata, options, step and a fingerprint of the cloud, under one checksum. It appears whole or not at all.
    /// The figures of [`Reconstruction::coverage`] and the codes of [`Trainer::coded`] follow from that state and are
    /// not in it: a resumed run has them, at the step it was saved at and at its end.
    ///
    /// # Errors
    /// [`ErrorKind::Io`] if the file cannot be written.
    pub fn save_checkpoint(&self, path: impl AsRef<Path>) -> Result<(), Error> {
        self.to_store().write(path.as_ref())
    }

    /// Takes up the run that [`save_checkpoint`](Self::save_checkpoint) saved, for the same `points` (n x 3) and
    /// options; `finish` and `mesh.min_component`, which come after the training, may be others.
    /// [`Saved`](super::Saved) knows the options of a file.
    ///
    /// # Errors
    /// [`ErrorKind::Io`] if the file cannot be read, [`ErrorKind::Checkpoint`] if it is damaged or belongs to another
    /// cloud or other options (the first that differs is named), and as [`Trainer::new`].
    pub fn resume<P: Position>(
        path: impl AsRef<Path>,
        points: &[P],
        config: &Config,
    ) -> Result<Trainer, Error> {
        let path = path.as_ref();
        let mut prepared = prepare(points, config)?;
        let store = Store::read(path)?;
        let resume = || -> Result<Trainer, Error> {
            let version = CHECKPOINT.check(&store)?;
            check_config(&saved_options::of_checkpoint(&store, version), &prepared.config)?;
            let cloud = store.get("cloud")?;
            if cloud != saved_cloud::fingerprint(&prepared.input) {
                // Earlier versions rounded every cloud to 32 bits.
                let rounded: Vec<[f32; 3]> = points.iter().map(|p| Position::of_wide(p.wide())).collect();
                prepared = prepare(&rounded, config)?;
                if cloud != saved_cloud::fingerprint(&prepared.input) {
                    return Err(Error::new(ErrorKind::Checkpoint, "it belongs to another cloud")
                        .advise("resume with the points that the run was started with"));
                }
            }
            let mut trainer = Trainer::blank(prepared);
            let mut expected = trainer.to_store().tensors;
            for name in ["now.bridges", "good.bridges"] {
                let rows = store.tensors.get(name).map_or(0, Tensor::rows);
                expected.insert(name.into(), Tensor::zeros(&[rows, 4]));
            }
            store.check_tensors(&expected)?;
            trainer.recoveries = store.parse("recoveries")?;
            if trainer.recoveries > RECOVERIES {
                return Err(damaged(format!("{} recoveries", trainer.recoveries)));
            }
            let now = read_snapshot(&store, "now", &trainer)?;
            trainer.good = read_snapshot(&store, "good", &trainer)?;
            if trainer.good.step > now.step || now.step > trainer.total_steps() {
                let message = format!("step {} after good step {}", now.step, trainer.good.step);
                return Err(damaged(message));
            }
            trainer.restore(&now);
            trainer.find_shape()?;
            trainer.rebuild_band()?;
            Ok(trainer)
        };
        resume().map_err(|e| e.in_file(path))
    }

    fn to_store(&self) -> Store {
        let mut store = Store::default();
        CHECKPOINT.put(&mut store);
        saved_options::put(&mut store, &self.config);
        store.put("cloud", saved_cloud::fingerprint(&self.input));
        store.put("recoveries", self.recoveries);
        put_snapshot(&mut store, "now", &self.snapshot());
        put_snapshot(&mut store, "good", &self.good);
        store
    }
}

impl Reconstruction {
    /// Saves the result: the field, the cloud, S and the options, in the format of [`Trainer::save_checkpoint`]. The
    /// figures of [`Reconstruction::coverage`] are not saved.
    ///
    /// # Errors
    /// [`ErrorKind::Io`] if the file cannot be written.
    pub fn save(&self, path: impl AsRef<Path>) -> Result<(), Error> {
        self.to_store().write(path.as_ref())
    }

    /// The bytes that [`save`](Self::save) writes. [`ErrorKind::Checkpoint`] if they cannot be encoded; no case is
    /// known.
    pub fn to_bytes(&self) -> Result<Vec<u8>, Error> {
        self.to_store().encode()
    }

    fn to_store(&self) -> Store {
        let mut store = Store::default();
        RECONSTRUCTION.put(&mut store);
        saved_options::put(&mut store, &self.config);
        let frame = self.normalizer.to_array().map(|v| format!("{:016x}", v.to_bits()));
        store.put("frame", frame.join(" "));
        match &self.shape {
            Shape::Learned(field) => {
                for (_, name, value) in field.params().iter() {
                    store.tensors.insert(name.into(), value.clone());
                }
            }
            Shape::Found(FoundShape { mesh, .. }) => {
                store.tensors.insert(FOUND[0].into(), Tensor::from_points(&mesh.verts));
                // Exact up to 2^24 vertices; first shapes have some ten thousand.
                let faces: Vec<[f32; 3]> = mesh.faces.iter().map(|f| f.map(|v| v as f32)).collect();
                store.tensors.insert(FOUND[1].into(), Tensor::from_points(&faces));
            }
        }
        if let Some(finish) = &self.finish {
            store.tensors.insert(FINISH.into(), Tensor::from_points(finish.points()));
        }
        saved_cloud::put(&mut store, &self.cloud);
        store.tensors.insert("surface".into(), Tensor::from_points(&self.surface));
        store
    }

    /// Loads a result that [`save`](Self::save) saved, with this version of the crate or an earlier one; it gives the
    /// same bytes. Where the file's options are not quite those of this version, [`notices`](Self::notices) says so.
    ///
    /// # Errors
    /// [`ErrorKind::Io`] if the file cannot be read, [`ErrorKind::Checkpoint`] if it is damaged or something else.
    pub fn load(path: impl AsRef<Path>) -> Result<Reconstruction, Error> {
        let path = path.as_ref();
        let store = Store::read(path)?;
        Self::of_store(&store).map_err(|e| e.in_file(path))
    }

    /// Reads a result from the bytes of a file, as [`load`](Self::load) does from its path.
    ///
    /// # Errors
    /// [`ErrorKind::Checkpoint`] if they are damaged or something else.
    pub fn from_bytes(bytes: &[u8]) -> Result<Reconstruction, Error> {
        Self::of_store(&Store::decode(bytes)?)
    }

    pub(super) fn of_store(store: &Store) -> Result<Reconstruction, Error> {
        let version = RECONSTRUCTION.check(store)?;
        let (config, notices) = saved_options::of_result(store, version)?;

        let frame: Result<Vec<u64>, _> =
            store.get("frame")?.split(' ').map(|v| u64::from_str_radix(v, 16)).collect();
        let frame: Option<[u64; 4]> = frame.ok().and_then(|f| f.try_into().ok());
        let frame = frame.ok_or_else(|| damaged("its frame is not four numbers"))?;
        let normalizer = Normalizer::from_array(frame.map(f64::from_bits))
            .map_err(|e| damaged("its frame cannot be used").caused_by(e))?;

        let mut field = blank_field(&config, &mut ChaCha8Rng::seed_from_u64(config.seed));
        let found = store.tensors.contains_key(FOUND[0]).then_some(FOUND);
        let finished = store.tensors.contains_key(FINISH).then_some(FINISH);
        let mut expected: BTreeMap<String, Tensor> = match found {
            Some(_) => BTreeMap::new(),
            None => field.params().iter().map(|(_, name, value)| (name.to_string(), value.clone())).collect(),
        };
        let cloud = saved_cloud::names(store);
        for name in ["surface"].into_iter().chain(cloud).chain(found.into_iter().flatten()).chain(finished) {
            let rows = store.tensors.get(name).map_or(0, Tensor::rows);
            expected.insert(name.into(), Tensor::zeros(&[rows, 3]));
        }
        store.check_tensors(&expected)?;
        let points = |name: &str| store.tensors[name].to_points();
        let surface = points("surface");
        let cloud = saved_cloud::read(store)?;
        let shape = match found {
            Some([verts, faces]) => Shape::Found(read_found(points(verts), &points(faces))?),
            None => {
                read_params(store, "", field.params_mut());
                Shape::Learned(field)
            }
        };
        let finish = match finished.map(points) {
            Some(points) if near(&points) => shape.finished_for(&points, &config),
            Some(_) => return Err(damaged("the points that it is finished for are not finite")),
            None => None,
        };
        Ok(Reconstruction { config, normalizer, cloud, shape, finish, surface, coverage: None, notices })
    }
}

fn read_found(verts: Vec<[f32; 3]>, faces: &[[f32; 3]]) -> Result<FoundShape, Error> {
    let count = verts.len() as f32;
    let number = |v: f32| v.fract() == 0.0 && (0.0..count).contains(&v);
    if !faces.iter().flatten().all(|&v| number(v)) || !near(&verts) {
        return Err(damaged("its shape is not a mesh"));
    }
    let faces = faces.iter().map(|f| f.map(|v| v as u32)).collect();
    FoundShape::new(TriangleMesh { verts, faces })
        .map_err(|e| damaged("its shape is not a mesh").caused_by(e))
}

fn near(points: &[[f32; 3]]) -> bool {
    // Written so that NaN is refused.
    points.as_flattened().iter().all(|x| x.abs() < FAR)
}

impl Kind {
    fn put(&self, store: &mut Store) {
        store.put("kind", format!("{} {}", self.name, self.version));
    }

    /// The version of a file, which has to be of this kind.
    pub fn check(&self, store: &Store) -> Result<u32, Error> {
        let Kind { name, version, oldest } = self;
        let found = store.get("kind")?;
        let advice = match found.split_once(' ').map(|(kind, v)| (kind == *name, v.parse::<u32>())) {
            Some((true, Ok(v))) if (*oldest..=*version).contains(&v) => return Ok(v),
            Some((true, Ok(v))) if v > *version => {
                "a later version of this program wrote it: read it with that"
            }
            Some((true, _)) => "an early version of this program wrote it: start anew",
            _ => "resume from checkpoints, load reconstructions",
        };
        let message = format!("it is a {found}, not a {name} {version}");
        Err(Error::new(ErrorKind::Checkpoint, message).advise(advice))
    }
}

/// Options that say nothing about the training and may be others when it goes on.
const MAY_CHANGE: [&str; 2] = ["finish", "mesh.min_component"];

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
    // What it did cannot be known, and the run would not go on as it began.
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

fn put_snapshot(store: &mut Store, name: &str, snapshot: &Snapshot) {
    store.put(&format!("{name}.step"), snapshot.step);
    put_learned(store, &format!("{name}.field"), &snapshot.field);
    if let Some(map) = &snapshot.map {
        put_learned(store, &format!("{name}.map"), map);
        store.tensors.insert(format!("{name}.surface"), Tensor::from_points(&snapshot.surface));
    }
    let Bridges { points, depths, looked } = &snapshot.bridges;
    store.put(&format!("{name}.looked"), looked);
    let rows: Vec<f32> = points.iter().zip(depths).flat_map(|(p, &d)| [p[0], p[1], p[2], d]).collect();
    store.tensors.insert(format!("{name}.bridges"), Tensor::from_vec(&[points.len(), 4], rows));
}

fn put_learned(store: &mut Store, name: &str, learned: &Learned) {
    for (_, param, value) in learned.params.iter() {
        store.tensors.insert(format!("{name}.value.{param}"), value.clone());
    }
    for (state, tensor) in learned.adam.state(learned.params.names()) {
        store.tensors.insert(format!("{name}.{state}"), tensor);
    }
}

/// Reads a snapshot of the shape of the trainer's present state, whose tensors have been checked to be there.
fn read_snapshot(store: &Store, name: &str, like: &Trainer) -> Result<Snapshot, Error> {
    let like = like.snapshot();
    let learned = |like: &Learned, name: &str| read_learned(store, name, like);
    let map = like.map.as_ref().map(|map| learned(map, &format!("{name}.map"))).transpose()?;
    let surface = store.tensors.get(&format!("{name}.surface")).map(Tensor::to_points);
    Ok(Snapshot {
        step: store.parse(&format!("{name}.step"))?,
        field: learned(&like.field, &format!("{name}.field"))?,
        map,
        surface: surface.unwrap_or_default(),
        bridges: read_bridges(store, name)?,
    })
}

fn read_learned(store: &Store, name: &str, like: &Learned) -> Result<Learned, Error> {
    let mut params = like.params.clone();
    read_params(store, &format!("{name}.value."), &mut params);
    let mut adam = Adam::new(params.values(), AdamOptions::default());
    adam.restore(params.names(), |state| store.tensors.get(&format!("{name}.{state}")).cloned())?;
    Ok(Learned { params, adam })
}

/// Reads all parameters, whose tensors have been checked to be there.
fn read_params(store: &Store, prefix: &str, params: &mut Params) {
    let ids: Vec<_> = params.iter().map(|(id, name, _)| (id, format!("{prefix}{name}"))).collect();
    for (id, name) in ids {
        *params.value_mut(id) = store.tensors[&name].clone();
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::{ball, bits, noisy, poison, run, tiny};
    use super::*;
    use crate::bsp::Parameterization;
    use crate::gdo::Deformation;
    use crate::reconstruct::ablations::with_charts;
    use crate::reconstruct::{Batch, Finishing};
    use std::path::PathBuf;

    fn file(name: &str) -> PathBuf {
        std::env::temp_dir().join(format!("bijective-sdf-{name}-{}.safetensors", std::process::id()))
    }

    #[test]
    fn a_resumed_run_ends_in_the_same_bytes() {
        let points = ball(70);
        let path = file("resume");
        let mut blocks = tiny();
        blocks.batch = Batch { thin: 0.25, points: 40, centres: 30 };
        blocks.surface_samples = 50;
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
        trainer.bridges = Bridges { points: points_inside, depths: vec![0.05, 0.1], looked: 9 };
        trainer.save_checkpoint(&path).unwrap();
        let mut resumed = Trainer::resume(&path, &points, &tiny()).unwrap();
        assert_eq!(resumed.bridges, trainer.bridges);
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
    fn other_clouds_options_and_damaged_files_are_refused() {
        let points = ball(50);
        let path = file("damage");
        let mut trainer = Trainer::new(&points, &tiny()).unwrap();
        trainer.step().unwrap();
        trainer.save_checkpoint(&path).unwrap();

        let mut other = tiny();
        other.weights.points = 0.5;
        let error = Trainer::resume(&path, &points, &other).err().unwrap();
        assert_eq!((error.kind(), error.element()), (ErrorKind::Checkpoint, Some("option weights.points")));
        assert_eq!(error.file(), Some(path.as_path()));
        let error = Trainer::resume(&path, &ball(51), &tiny()).err().unwrap();
        assert!(error.kind() == ErrorKind::Checkpoint && error.message().contains("another cloud"));
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
    fn other_kinds_and_versions_are_refused() {
        let advice = |kind: &str| {
            let mut store = Store::default();
            store.put("kind", kind);
            RECONSTRUCTION.check(&store).map_err(|e| e.advice().unwrap().to_string())
        };
        (2..5).for_each(|v| assert_eq!(advice(&format!("reconstruction {v}")), Ok(v)));
        assert!(advice("reconstruction 5").unwrap_err().contains("later version"));
        assert!(advice("reconstruction 1").unwrap_err().contains("early version"));
        for other in ["checkpoint 2", "reconstruction", ""] {
            assert!(advice(other).unwrap_err().contains("resume from checkpoints"), "{other}");
        }
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

    #[test]
    fn a_result_is_loaded_though_its_options_are_not_quite_ours() {
        let path = file("aged");
        let result = run(&ball(50), &tiny());
        result.save(&path).unwrap();
        let mut store = Store::read(&path).unwrap();
        store.values.retain(|(key, _)| key != "config.weights.bridge");
        store.put("config.weights.later", 1);
        store.write(&path).unwrap();
        let loaded = Reconstruction::load(&path).unwrap();
        assert!(bits(&loaded) == bits(&result));
        assert_eq!(loaded.notices().len(), 2, "{:?}", loaded.notices());
        std::fs::remove_file(path).unwrap();
    }

    #[test]
    fn a_damaged_shape_or_finish_is_refused() {
        let path = file("shape");
        let result = run(&ball(50), &Config { stages: Vec::new(), ..tiny() });
        result.save(&path).unwrap();
        let good = Store::read(&path).unwrap();
        std::fs::remove_file(path).unwrap();
        assert!(Reconstruction::of_store(&good).is_ok());
        for (name, value) in [
            (FOUND[0], f32::NAN),
            (FOUND[1], -1.0),
            (FOUND[1], 0.5),
            (FOUND[1], 1e7),
            (FINISH, f32::INFINITY),
        ] {
            let mut store = Store { values: good.values.clone(), tensors: good.tensors.clone() };
            store.tensors.get_mut(name).unwrap().data_mut()[4] = value;
            let error = Reconstruction::of_store(&store).unwrap_err();
            assert_eq!(error.kind(), ErrorKind::Checkpoint, "{value} in {name}");
        }
        let mut store = Store { values: good.values.clone(), tensors: good.tensors.clone() };
        store.tensors.remove(FOUND[1]);
        assert_eq!(Reconstruction::of_store(&store).unwrap_err().kind(), ErrorKind::Checkpoint);
    }

    #[test]
    fn a_loaded_result_is_the_one_that_was_saved() {
        let path = file("result");
        let offset = Config { deformation: Deformation::Offset, ..tiny() };
        let bare = Config { finish: Finishing::None, ..tiny() };
        let found = Config { stages: Vec::new(), ..tiny() };
        for config in [tiny(), offset, bare, found] {
            let result = run(&ball(50), &config);
            assert_eq!(result.finish.is_some(), config.finish == Finishing::Points);
            assert_eq!(matches!(result.shape, Shape::Found(_)), config.stages.is_empty());
            result.save(&path).unwrap();
            let loaded = Reconstruction::load(&path).unwrap();
            assert!(bits(&loaded) == bits(&result));
            assert_eq!((loaded.cloud(), loaded.config()), (result.cloud(), result.config()));
            assert!(loaded.notices().is_empty() && result.notices().is_empty());
            let error = Trainer::resume(&path, &ball(50), &tiny()).err().unwrap();
            assert_eq!(error.kind(), ErrorKind::Checkpoint);
        }
        std::fs::remove_file(path).unwrap();
    }
}
