//! The file of all runs: it only grows, line by line, so that a run that is killed loses nothing but itself.

use std::collections::HashMap;
use std::fs::{self, File, OpenOptions};
use std::io::{ErrorKind as IoKind, Write};
use std::path::{Path, PathBuf};

use bijective_sdf::{Error, ErrorKind};

use super::super::failure::Failure;
use super::record::Record;

/// What a file of runs holds.
#[derive(Debug, Default)]
pub struct StoredRuns {
    /// The runs by fingerprint; of two with the same, the later one.
    pub records: HashMap<String, Record>,
    /// Bytes of whole lines.
    whole: u64,
    /// Bytes of a line that was not finished.
    pub torn: u64,
}

/// Reads a file of runs; one that is not there holds none.
pub fn read(path: &Path) -> Result<StoredRuns, Failure> {
    let bytes = match fs::read(path) {
        Ok(bytes) => bytes,
        Err(e) if e.kind() == IoKind::NotFound => return Ok(StoredRuns::default()),
        Err(e) => return Err(Failure::cannot_read(path, e)),
    };
    // A line is there once its end is: what follows the last end was being written when the program was killed.
    let whole = bytes.iter().rposition(|&b| b == b'\n').map_or(0, |at| at + 1);
    let mut stored =
        StoredRuns { whole: whole as u64, torn: (bytes.len() - whole) as u64, ..StoredRuns::default() };
    for (i, line) in bytes[..whole].split(|&b| b == b'\n').enumerate() {
        if line.is_empty() {
            continue;
        }
        let record =
            std::str::from_utf8(line).map_err(|e| e.to_string()).and_then(Record::read).map_err(|text| {
                let error = Error::new(ErrorKind::Data, format!("not the line of a run: {text}"));
                let error = error.in_file(path).at_line(i as u64 + 1);
                Failure::Input(error.advise("remove the line, and its run is made again"))
            })?;
        stored.records.insert(record.fingerprint.clone(), record);
    }
    Ok(stored)
}

/// A file of runs that is written to.
#[derive(Debug)]
pub struct RunFile {
    path: PathBuf,
    file: File,
}

impl RunFile {
    /// Opens the file behind what [`read`] found in it; a torn line is cut off.
    pub fn open(path: &Path, stored: &StoredRuns) -> Result<RunFile, Failure> {
        let opened = OpenOptions::new().create(true).append(true).open(path);
        let file = opened
            .and_then(|file| {
                if stored.torn > 0 {
                    file.set_len(stored.whole)?;
                }
                Ok(file)
            })
            .map_err(|e| Failure::cannot_write(path, e))?;
        Ok(RunFile { path: path.to_path_buf(), file })
    }

    /// Appends a line; it is on the disk when this returns.
    pub fn append(&mut self, line: &str) -> Result<(), Failure> {
        let text = format!("{line}\n");
        self.file
            .write_all(text.as_bytes())
            .and_then(|()| self.file.sync_data())
            .map_err(|e| Failure::cannot_write(&self.path, e))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn line(fingerprint: &str, seconds: f64) -> String {
        format!(
            "{{\"fingerprint\":\"{fingerprint}\",\"shape\":\"a\",\"setting\":\"b\",\"seed\":0,\
             \"status\":\"ok\",\"seconds\":{seconds},\"threads\":1}}"
        )
    }

    #[test]
    fn a_torn_line_is_dropped_and_the_rest_stays() {
        let path = std::env::temp_dir().join(format!("bijective-sdf-suite-{}.jsonl", std::process::id()));
        let _ = fs::remove_file(&path);
        let stored = read(&path).unwrap();
        assert_eq!((stored.records.len(), stored.torn), (0, 0));
        let mut store = RunFile::open(&path, &stored).unwrap();
        store.append(&line("x", 1.0)).unwrap();
        store.append(&line("y", 2.0)).unwrap();
        store.append(&line("x", 3.0)).unwrap();
        let all = fs::read(&path).unwrap();
        let stored = read(&path).unwrap();
        assert_eq!((stored.records.len(), stored.torn, stored.records["x"].seconds), (2, 0, 3.0));

        // Cut at any byte, whole lines stay and can be gone on from.
        let ends: Vec<usize> = (1..=all.len()).filter(|&i| all[i - 1] == b'\n').collect();
        for cut in 0..all.len() {
            fs::write(&path, &all[..cut]).unwrap();
            let stored = read(&path).unwrap();
            let lines = ends.iter().filter(|&&end| end <= cut).count();
            assert_eq!(stored.records.len(), lines.min(2));
            assert_eq!(stored.torn > 0, cut > 0 && !ends.contains(&cut));
            RunFile::open(&path, &stored).unwrap().append(&line("z", 4.0)).unwrap();
            assert_eq!(read(&path).unwrap().records.len(), lines.min(2) + 1);
        }

        fs::write(&path, format!("{}\n{{\n{}\n", line("x", 1.0), line("y", 1.0))).unwrap();
        let failure = read(&path).unwrap_err();
        assert!(failure.code() == 3 && failure.line().unwrap().contains(":2:"), "{failure:?}");
        fs::remove_file(path).unwrap();
    }
}
