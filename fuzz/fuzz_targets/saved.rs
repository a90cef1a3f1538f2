//! Changed checkpoints and saved results, under a right checksum: a typed error, or a state that can be used.
//!
//! The bytes are edits of a genuine file of each kind: to its lines of options and counts, to the shapes, names and
//! values of its tensors. They are also read as a file by themselves.
#![no_main]

use bijective_sdf::ErrorKind;
use bijective_sdf::reconstruct::{Config, Reconstruction, Stage, StartShape, Trainer};
use libfuzzer_sys::fuzz_target;
use safetensors::SafeTensors;
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::LazyLock;

struct Genuine {
    directory: PathBuf,
    points: Vec<[f32; 3]>,
    config: Config,
    checkpoint: File,
    result: File,
}

static GENUINE: LazyLock<Genuine> = LazyLock::new(|| {
    let directory = std::env::temp_dir().join(format!("bijective-sdf-fuzz-{}", std::process::id()));
    std::fs::create_dir_all(&directory).unwrap();
    let points: Vec<[f32; 3]> = (0..16)
        .map(|i| {
            let (z, turn) = (1.0 - (2 * i + 1) as f32 / 16.0, i as f32 * 2.4);
            let r = (1.0 - z * z).sqrt();
            [r * turn.cos(), r * turn.sin(), z]
        })
        .collect();
    let mut config = Config::default();
    config.start.shape = StartShape::Sphere;
    (config.field.width, config.field.depth, config.field.octaves) = (4, 1, 1);
    (config.bsp.channels, config.bsp.heads, config.bsp.patch, config.bsp_pretrain) = (2, 1, 2, 1);
    config.stages = vec![Stage { resolution: 6, steps: 3 }];
    (config.surface_samples, config.reference_area) = (Some(20), None);
    let mut trainer = Trainer::new(&points, &config).unwrap();
    for _ in 0..3 {
        trainer.step().unwrap();
    }
    let path = directory.join("genuine");
    trainer.save_checkpoint(&path).unwrap();
    let checkpoint = File::read(&path);
    trainer.finish().save(&path).unwrap();
    let result = File::read(&path);
    Genuine { directory, points, config, checkpoint, result }
});

fuzz_target!(|data: &[u8]| {
    let genuine = &*GENUINE;
    let path = genuine.directory.join("file");
    let edited = |file: &File| {
        let mut file = file.clone();
        file.edit(data);
        file.encode()
    };
    for (bytes, changed) in [(data.to_vec(), true), (edited(&genuine.result), !data.is_empty())] {
        std::fs::write(&path, bytes).unwrap();
        match Reconstruction::load(&path) {
            Err(e) => assert!(changed && e.kind() == ErrorKind::Checkpoint, "{e}"),
            Ok(result) => try_result(&result),
        }
    }
    for (bytes, changed) in [(data.to_vec(), true), (edited(&genuine.checkpoint), !data.is_empty())] {
        std::fs::write(&path, bytes).unwrap();
        match Trainer::resume(&path, &genuine.points, &genuine.config) {
            Err(e) => {
                let kinds = [ErrorKind::Checkpoint, ErrorKind::NoSurface, ErrorKind::Diverged];
                assert!(changed && kinds.contains(&e.kind()), "{e}");
            }
            Ok(mut trainer) => {
                if !trainer.is_done()
                    && let Err(e) = trainer.step()
                {
                    assert!(matches!(e.kind(), ErrorKind::Diverged | ErrorKind::NoSurface), "{e}");
                }
                let _ = trainer.finish();
            }
        }
    }
});

fn try_result(result: &Reconstruction) {
    assert_eq!(result.sdf(&[[0.0f64; 3], [1.0, 2.0, 3.0]]).len(), 2);
    if let Err(e) = result.mesh(6) {
        assert!(matches!(e.kind(), ErrorKind::NoSurface | ErrorKind::Diverged), "{e}");
    }
    let path = GENUINE.directory.join("again");
    result.save(&path).unwrap();
    assert_eq!(Reconstruction::load(&path).unwrap().config().entries(), result.config().entries());
}

/// What a file holds.
#[derive(Clone)]
struct File {
    lines: Vec<(String, String)>,
    /// Dimensions and values by name.
    tensors: BTreeMap<String, ([usize; 2], Vec<u8>)>,
}

impl File {
    fn read(path: &PathBuf) -> File {
        let bytes = std::fs::read(path).unwrap();
        let (_, metadata) = SafeTensors::read_metadata(&bytes).unwrap();
        let text = &metadata.metadata().as_ref().unwrap()["bijective_sdf"];
        let mut lines: Vec<(String, String)> = text
            .lines()
            .map(|line| line.split_once('=').unwrap())
            .map(|(k, v)| (k.into(), v.into()))
            .collect();
        assert_eq!(lines.pop().unwrap().0, "checksum");
        let tensors = SafeTensors::deserialize(&bytes).unwrap();
        let tensors = tensors
            .iter()
            .map(|(name, view)| (name.to_string(), (view.shape().try_into().unwrap(), view.data().to_vec())));
        let file = File { lines, tensors: tensors.collect() };
        std::fs::write(path, file.encode()).unwrap();
        file
    }

    /// Each edit takes four bytes and what text it needs: what to do, where (two), and how much.
    fn edit(&mut self, mut data: &[u8]) {
        while let Some((&[what, at, high, much], rest)) = data.split_first_chunk() {
            let at = usize::from(at) + 256 * usize::from(high);
            let (text, rest) = rest.split_at(rest.len().min(usize::from(much) % 24));
            let text: String = String::from_utf8_lossy(text).chars().filter(|c| !c.is_control()).collect();
            data = rest;
            let line = at % self.lines.len().max(1);
            let name = self.tensors.keys().nth(at % self.tensors.len().max(1)).cloned().unwrap_or_default();
            match what % 7 {
                0 if !self.lines.is_empty() => self.lines[line].1 = text,
                1 if !self.lines.is_empty() => drop(self.lines.remove(line)),
                2 => self.lines.insert(line, (text.replace('=', ""), "1".into())),
                3 => drop(self.tensors.remove(&name)),
                4 => {
                    if let Some(tensor) = self.tensors.remove(&name) {
                        self.tensors.insert(text, tensor);
                    }
                }
                5 => {
                    if let Some((dims, values)) = self.tensors.get_mut(&name) {
                        dims[at % 2] = usize::from(much);
                        values.resize(4 * dims[0] * dims[1], at as u8);
                    }
                }
                6 => {
                    let bits = f32::from_bits(u32::from(much) << 24 | (at as u32) << 8).to_le_bytes();
                    if let Some((_, values)) = self.tensors.get_mut(&name)
                        && !values.is_empty()
                    {
                        let place = at % (values.len() / 4) * 4;
                        values[place..place + 4].copy_from_slice(&bits);
                    }
                }
                _ => {}
            }
        }
    }

    /// The file, with a right checksum (FNV-1a).
    fn encode(&self) -> Vec<u8> {
        let text: String = self.lines.iter().map(|(k, v)| format!("{k}={v}\n")).collect();
        let mut sum = 0xcbf2_9ce4_8422_2325u64;
        let mut add = |bytes: &[u8]| {
            bytes.iter().for_each(|&b| sum = (sum ^ u64::from(b)).wrapping_mul(0x0000_0100_0000_01b3));
        };
        add(text.as_bytes());
        let (mut header, mut data) = (String::new(), Vec::new());
        for (name, (dims, values)) in &self.tensors {
            add(name.as_bytes());
            dims.iter().for_each(|&d| add(&(d as u64).to_le_bytes()));
            add(values);
            let (from, to) = (data.len(), data.len() + values.len());
            let [rows, cols] = dims;
            header += &format!(
                ",\"{}\":{{\"dtype\":\"F32\",\"shape\":[{rows},{cols}],\"data_offsets\":[{from},{to}]}}",
                escaped(name)
            );
            data.extend_from_slice(values);
        }
        let text = escaped(&format!("{text}checksum={sum:016x}\n"));
        let header = format!("{{\"__metadata__\":{{\"bijective_sdf\":\"{text}\"}}{header}}}");
        [&(header.len() as u64).to_le_bytes()[..], header.as_bytes(), &data].concat()
    }
}

/// As the inside of a string in JSON.
fn escaped(text: &str) -> String {
    text.replace('\\', "\\\\").replace('"', "\\\"").replace('\n', "\\n")
}
