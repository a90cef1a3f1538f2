//! A checked file of named values and tensors in the safetensors format.
//!
//! The format's metadata holds one entry, `bijective_sdf`: lines of `key=value`, the last of which is a checksum over
//! the other lines and over names, shapes and bytes of all tensors. One entry only, because several would be written
//! in a random order, and the same state is to give the same bytes.

use crate::error::{Error, ErrorKind};
use crate::io::write_atomic;
use crate::tensor::Tensor;
use safetensors::tensor::{Dtype, SafeTensors, TensorView, serialize};
use std::collections::{BTreeMap, HashMap};
use std::path::Path;

/// Whether bytes begin like a file of this program: a header's length, and in the header the one entry of the metadata.
pub(super) fn looks_like_store(bytes: &[u8]) -> bool {
    let header = bytes.first_chunk::<8>().map_or(0, |b| u64::from_le_bytes(*b));
    let head = &bytes[8.min(bytes.len())..bytes.len().min(8 + 4096)];
    let names = |part: &[u8]| head.windows(part.len()).any(|w| w == part);
    (1..=MAX_HEADER).contains(&header)
        && head.first() == Some(&b'{')
        && names(b"__metadata__")
        && names(ENTRY.as_bytes())
}

/// Header bytes at most: thousands of tensors fit.
const MAX_HEADER: u64 = 1 << 24;
const ENTRY: &str = "bijective_sdf";

/// The content of a saved file: named texts and named tensors.
#[derive(Debug, Default)]
pub(in crate::reconstruct) struct Store {
    /// In the order of writing; keys hold no `=` and nothing holds a line break.
    pub values: Vec<(String, String)>,
    pub tensors: BTreeMap<String, Tensor>,
}

impl Store {
    pub fn put(&mut self, key: &str, value: impl ToString) {
        let value = value.to_string();
        debug_assert!(!key.contains(['=', '\n']) && !value.contains('\n'));
        self.values.push((key.into(), value));
    }

    /// The value of a key.
    pub fn get(&self, key: &str) -> Result<&str, Error> {
        let found = self.values.iter().find(|(k, _)| k == key);
        found.map(|(_, v)| v.as_str()).ok_or_else(|| damaged(format!("it has no {key}")))
    }

    /// The value of a key, read as what it should be.
    pub fn parse<T: std::str::FromStr>(&self, key: &str) -> Result<T, Error> {
        let text = self.get(key)?;
        text.parse().map_err(|_| damaged(format!("{text:?} is no value of {key}")))
    }

    /// Refuses any but exactly these tensors.
    pub fn check_tensors(&self, expected: &BTreeMap<String, Tensor>) -> Result<(), Error> {
        if let Some(name) = expected.keys().find(|name| !self.tensors.contains_key(*name)) {
            return Err(damaged("it is missing").at_element(format!("tensor {name}")));
        }
        for (name, found) in &self.tensors {
            let at = |e: Error| e.at_element(format!("tensor {name}"));
            match expected.get(name) {
                None => return Err(at(damaged("nothing has this name"))),
                Some(like) if like.shape() != found.shape() => {
                    let (found, like) = (found.shape(), like.shape());
                    return Err(at(damaged(format!("shape {found:?} found, {like:?} expected"))));
                }
                Some(_) => {}
            }
        }
        Ok(())
    }

    fn lines(&self) -> String {
        self.values.iter().map(|(k, v)| format!("{k}={v}\n")).collect()
    }

    fn checksum(&self) -> u64 {
        let mut sum = Checksum::new();
        sum.add(self.lines().as_bytes());
        for (name, tensor) in &self.tensors {
            sum.add(name.as_bytes());
            for &d in tensor.dims() {
                sum.add(&(d as u64).to_le_bytes());
            }
            for v in tensor.data() {
                sum.add(&v.to_le_bytes());
            }
        }
        sum.0
    }

    /// Writes the file so that a failure at any moment leaves the old one, or none.
    pub fn write(&self, path: &Path) -> Result<(), Error> {
        let file = self.encode().map_err(|e| e.in_file(path))?;
        write_atomic(path, |out| out.write_all(&file).map_err(|e| Error::cannot_write(path, e)))
    }

    /// The bytes of the file.
    pub fn encode(&self) -> Result<Vec<u8>, Error> {
        let failed = |e: safetensors::SafeTensorError| {
            Error::new(ErrorKind::Checkpoint, "cannot be encoded").caused_by(e.to_string())
        };
        let bytes: Vec<(&String, &Tensor, Vec<u8>)> = self
            .tensors
            .iter()
            .map(|(name, t)| (name, t, t.data().iter().flat_map(|v| v.to_le_bytes()).collect()))
            .collect();
        let mut views = Vec::with_capacity(bytes.len());
        for (name, tensor, bytes) in &bytes {
            let view = TensorView::new(Dtype::F32, tensor.dims().to_vec(), bytes).map_err(failed)?;
            views.push((name, view));
        }
        let entry = format!("{}checksum={:016x}\n", self.lines(), self.checksum());
        let metadata = HashMap::from([(ENTRY.to_string(), entry)]);
        serialize(views, Some(metadata)).map_err(failed)
    }

    /// Reads a file and checks it whole.
    pub fn read(path: &Path) -> Result<Store, Error> {
        let bytes = std::fs::read(path).map_err(|e| Error::cannot_read(path, e))?;
        Self::decode(&bytes).map_err(|e| e.in_file(path))
    }

    /// Reads the bytes of a file and checks them whole.
    pub fn decode(bytes: &[u8]) -> Result<Store, Error> {
        if !bytes.is_empty() && !looks_like_store(bytes) && !bytes.starts_with(&[0; 8]) {
            return Err(Error::new(ErrorKind::Checkpoint, "it is neither a field nor a checkpoint of this program")
                .advise("give the file of --save-field or --checkpoint; of a point cloud a field has to be made first"));
        }
        let header = bytes.first_chunk::<8>().map_or(0, |b| u64::from_le_bytes(*b));
        if header == 0 || header > MAX_HEADER || header > bytes.len() as u64 {
            return Err(damaged(format!("{} bytes with a header of {header}", bytes.len())));
        }
        let broken =
            |e: safetensors::SafeTensorError| damaged("not a file of tensors").caused_by(e.to_string());
        let (_, metadata) = SafeTensors::read_metadata(bytes).map_err(broken)?;
        let entry = metadata.metadata().as_ref().and_then(|m| m.get(ENTRY));
        let entry = entry.ok_or_else(|| damaged("not a file of this program"))?;
        let mut store = Store::default();
        for line in entry.lines() {
            let (key, value) = line.split_once('=').ok_or_else(|| damaged(format!("no = in {line:?}")))?;
            store.put(key, value);
        }
        let (last, checksum) = store.values.pop().ok_or_else(|| damaged("it has no values"))?;
        for (name, view) in SafeTensors::deserialize(bytes).map_err(broken)?.iter() {
            let shape = view.shape();
            if view.dtype() != Dtype::F32 || shape.len() != 2 {
                let message = format!("{} of shape {shape:?}", view.dtype());
                return Err(damaged(message).at_element(format!("tensor {name}")));
            }
            let values = view.data().as_chunks::<4>().0.iter().map(|b| f32::from_le_bytes(*b)).collect();
            store.tensors.insert(name.into(), Tensor::from_vec(shape, values));
        }
        if last != "checksum" || checksum != format!("{:016x}", store.checksum()) {
            return Err(damaged("the checksum does not agree with the content"));
        }
        Ok(store)
    }
}

pub(in crate::reconstruct) fn damaged(message: impl Into<String>) -> Error {
    Error::new(ErrorKind::Checkpoint, message)
        .advise("the file is damaged or was written by another version; start anew or take an earlier file")
}

/// FNV-1a, 64 bits (Fowler, Noll, Vo): every step is a bijection, so a change of one byte never goes unseen.
#[derive(Clone, Copy, Debug)]
pub(in crate::reconstruct) struct Checksum(pub u64);

impl Checksum {
    pub fn new() -> Self {
        Checksum(0xcbf2_9ce4_8422_2325)
    }

    pub fn add(&mut self, bytes: &[u8]) {
        for &b in bytes {
            self.0 = (self.0 ^ u64::from(b)).wrapping_mul(0x0000_0100_0000_01b3);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sample() -> Store {
        let mut store = Store::default();
        store.put("kind", "test");
        store.put("config.field.width", 64);
        store.tensors.insert("b".into(), Tensor::from_vec(&[2, 2], vec![1.0, -0.5, 1e-20, 7.0]));
        store.tensors.insert("a".into(), Tensor::zeros(&[1, 3]));
        store
    }

    fn bytes(store: &Store, name: &str) -> Vec<u8> {
        let path = std::env::temp_dir().join(format!("bijective-sdf-store-{name}-{}", std::process::id()));
        store.write(&path).unwrap();
        let bytes = std::fs::read(&path).unwrap();
        std::fs::remove_file(path).unwrap();
        bytes
    }

    #[test]
    fn reads_what_was_written_and_writes_the_same_bytes_again() {
        let store = sample();
        let first = bytes(&store, "again");
        let read = Store::decode(&first).unwrap();
        assert_eq!((&read.values, &read.tensors), (&store.values, &store.tensors));
        assert_eq!(first, bytes(&read, "again"));
        assert_eq!(Checksum::new().0, 0xcbf2_9ce4_8422_2325);
        let mut sum = Checksum::new();
        sum.add(b"a");
        assert_eq!(sum.0, 0xaf63_dc4c_8601_ec8c);
    }

    #[test]
    fn every_damaged_byte_and_every_truncation_is_an_error() {
        let good = bytes(&sample(), "damage");
        for cut in 0..good.len() {
            let error = Store::decode(&good[..cut]).unwrap_err();
            assert_eq!(error.kind(), ErrorKind::Checkpoint);
        }
        let mut longer = good.clone();
        longer.push(0);
        assert_eq!(Store::decode(&longer).unwrap_err().kind(), ErrorKind::Checkpoint);
        for i in 0..good.len() {
            for bit in 0..8 {
                let mut bad = good.clone();
                bad[i] ^= 1 << bit;
                let error = Store::decode(&bad).expect_err(&format!("byte {i}, bit {bit}"));
                assert_eq!(error.kind(), ErrorKind::Checkpoint);
            }
        }
    }

    #[test]
    fn another_set_of_tensors_is_refused() {
        let store = sample();
        store.check_tensors(&store.tensors).unwrap();
        for change in 0..3 {
            let mut expected = store.tensors.clone();
            match change {
                0 => drop(expected.remove("a")),
                1 => drop(expected.insert("c".into(), Tensor::zeros(&[1, 1]))),
                _ => drop(expected.insert("a".into(), Tensor::zeros(&[3, 1]))),
            }
            assert_eq!(store.check_tensors(&expected).unwrap_err().kind(), ErrorKind::Checkpoint);
        }
    }
}
