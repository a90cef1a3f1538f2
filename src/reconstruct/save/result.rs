//! Saving a result, and loading it again.

use super::input as saved_input;
use super::kind::RECONSTRUCTION;
use super::options as saved_options;
use super::params::read_params;
use super::store::{Store, damaged};
use crate::error::Error;
use crate::geometry::{Normalizer, TriangleMesh};
use crate::random::Random;
use crate::reconstruct::Reconstruction;
use crate::reconstruct::final_shape::{FinalShape, FoundShape};
use crate::reconstruct::frame::WorkingFrame;
use crate::reconstruct::phases::MAX_COORDINATE;
use crate::reconstruct::setup::initial_field;
use crate::tensor::Tensor;
use std::collections::BTreeMap;
use std::path::Path;

/// Vertices and faces (as numbers) of a result that is the first shape itself; each n x 3.
const FOUND: [&str; 2] = ["shape.verts", "shape.faces"];
/// Factors of the axes; present in a result that was found with stretched axes.
const STRETCH: &str = "anisotropy";
/// Present in a result whose distance is negative outside of its mesh.
const TURNED: &str = "turned";
/// The denoised points (n x 3, working frame) that a result was finished for; present if it was.
const FINISH: &str = "finish.points";

impl Reconstruction {
    /// Saves the result: the field, the input points, S and the options, in the format of
    /// [`Trainer::save_checkpoint`](crate::Trainer::save_checkpoint). The figures of [`Reconstruction::coverage`] are
    /// not saved.
    ///
    /// # Errors
    /// [`Io`](crate::ErrorKind::Io) if the file cannot be written.
    pub fn save(&self, path: impl AsRef<Path>) -> Result<(), Error> {
        self.to_store().write(path.as_ref())
    }

    /// The bytes that [`save`](Self::save) writes. [`Checkpoint`](crate::ErrorKind::Checkpoint) if they cannot be
    /// encoded; no case is known.
    pub fn to_bytes(&self) -> Result<Vec<u8>, Error> {
        self.to_store().encode()
    }

    fn to_store(&self) -> Store {
        let mut store = Store::default();
        RECONSTRUCTION.put(&mut store);
        saved_options::put(&mut store, &self.config);
        let frame = self.frame.normalizer().to_array().map(|v| format!("{:016x}", v.to_bits()));
        store.put("frame", frame.join(" "));
        if !self.frame.is_plain() {
            store.put(STRETCH, self.frame.stretch().map(|v| v.to_string()).join(" "));
        }
        if self.turned {
            store.put(TURNED, true);
        }
        match &self.shape {
            FinalShape::Learned(field) => {
                for (_, name, value) in field.params().iter() {
                    store.tensors.insert(name.into(), value.clone());
                }
            }
            FinalShape::Found(FoundShape { mesh, .. }) => {
                store.tensors.insert(FOUND[0].into(), Tensor::from_points(&mesh.verts));
                // Exact up to 2^24 vertices; first shapes have some ten thousand.
                let faces: Vec<[f32; 3]> = mesh.faces.iter().map(|f| f.map(|v| v as f32)).collect();
                store.tensors.insert(FOUND[1].into(), Tensor::from_points(&faces));
            }
        }
        if let Some(finish) = &self.finish {
            store.tensors.insert(FINISH.into(), Tensor::from_points(finish.points()));
        }
        saved_input::put(&mut store, &self.input);
        store.tensors.insert("surface".into(), Tensor::from_points(&self.surface));
        store
    }

    /// Loads a result that [`save`](Self::save) saved, with this version of the crate or an earlier one; it gives the
    /// same bytes. Where the file's options are not quite those of this version, [`notices`](Self::notices) says so.
    ///
    /// # Errors
    /// [`Io`](crate::ErrorKind::Io) if the file cannot be read, [`Checkpoint`](crate::ErrorKind::Checkpoint) if it is
    /// damaged or something else.
    pub fn load(path: impl AsRef<Path>) -> Result<Reconstruction, Error> {
        let path = path.as_ref();
        let store = Store::read(path)?;
        Self::of_store(&store).map_err(|e| e.in_file(path))
    }

    /// Reads a result from the bytes of a file, as [`load`](Self::load) does from its path.
    ///
    /// # Errors
    /// [`Checkpoint`](crate::ErrorKind::Checkpoint) if they are damaged or something else.
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
        let stretch: Vec<f64> = match store.get(STRETCH) {
            Ok(text) => text.split(' ').filter_map(|v| v.parse().ok()).collect(),
            Err(_) => vec![1.0; 3],
        };
        let stretch: Option<[f64; 3]> = stretch.try_into().ok();
        let stretch = stretch.filter(|s| s.iter().all(|x| (1e-6..=1e6).contains(x)));
        let frame = WorkingFrame::of_parts(
            normalizer,
            stretch.ok_or_else(|| damaged("its axes are not stretched by three factors"))?,
        );

        let mut field = initial_field(&config, &mut Random::new(config.seed));
        let found = store.tensors.contains_key(FOUND[0]).then_some(FOUND);
        let finished = store.tensors.contains_key(FINISH).then_some(FINISH);
        let mut expected: BTreeMap<String, Tensor> = match found {
            Some(_) => BTreeMap::new(),
            None => field.params().iter().map(|(_, name, value)| (name.to_string(), value.clone())).collect(),
        };
        let input = saved_input::names(store);
        for name in ["surface"].into_iter().chain(input).chain(found.into_iter().flatten()).chain(finished) {
            let rows = store.tensors.get(name).map_or(0, Tensor::rows);
            expected.insert(name.into(), Tensor::zeros(&[rows, 3]));
        }
        store.check_tensors(&expected)?;
        let points = |name: &str| store.tensors[name].to_points();
        let surface = points("surface");
        let input = saved_input::read(store)?;
        let shape = match found {
            Some([verts, faces]) => FinalShape::Found(read_found(points(verts), &points(faces))?),
            None => {
                read_params(store, "", field.params_mut());
                FinalShape::Learned(field)
            }
        };
        let finish = match finished.map(points) {
            Some(points) if near(&points) => shape.finished_for(&points, &config)?,
            Some(_) => return Err(damaged("the points that it is finished for are not finite")),
            None => None,
        };
        let turned = store.get(TURNED).is_ok();
        let coverage = None;
        Ok(Reconstruction { config, frame, input, shape, finish, surface, coverage, turned, notices })
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
    points.as_flattened().iter().all(|x| x.abs() < MAX_COORDINATE)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::error::ErrorKind;
    use crate::gdo::Deformation;
    use crate::reconstruct::tests::{ball, bits, run, tiny};
    use crate::reconstruct::{Config, Finishing, Trainer};
    use std::path::PathBuf;

    fn file(name: &str) -> PathBuf {
        std::env::temp_dir().join(format!("bijective-sdf-{name}-{}.safetensors", std::process::id()))
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
            assert_eq!(matches!(result.shape, FinalShape::Found(_)), config.stages.is_empty());
            result.save(&path).unwrap();
            let loaded = Reconstruction::load(&path).unwrap();
            assert!(bits(&loaded) == bits(&result));
            assert_eq!((loaded.input_points(), loaded.config()), (result.input_points(), result.config()));
            assert!(loaded.notices().is_empty() && result.notices().is_empty());
            let error = Trainer::resume(&path, &ball(50), &tiny()).err().unwrap();
            assert_eq!(error.kind(), ErrorKind::Checkpoint);
        }
        std::fs::remove_file(path).unwrap();
    }
}
