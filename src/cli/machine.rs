//! What the machine has, held against what a run needs.

use std::fs;
use std::path::Path;

use bijective_sdf::reconstruct::Config;

use super::Common;
use super::failure::Failure;

/// The most threads that may be asked for, per processor; more only take memory.
const MAX_THREADS_PER_PROCESSOR: usize = 4;
/// The least limit, so that small machines can try what large ones do.
const MIN_THREADS: usize = 16;

/// Refuses more threads than make sense.
pub fn check_threads(threads: usize) -> Result<(), Failure> {
    let processors = std::thread::available_parallelism().map_or(1, usize::from);
    let most = (MAX_THREADS_PER_PROCESSOR * processors).max(MIN_THREADS);
    if threads <= most {
        return Ok(());
    }
    let text = format!("--threads {threads}: at most {most} make sense with {processors} processors");
    Err(Failure::Usage(text))
}

/// Bytes of a training step on a grid of `cubes` a side, over cubes^2: about 12 active vertices for each square that
/// the surface crosses, times the bytes that the pass through the field keeps of each.
const STEP_BYTES: f64 = 4000.0;
/// Bytes of the extraction of a mesh, over cubes^2: values and places of the finest level, and the mesh.
const MESH_BYTES: f64 = 1500.0;
/// The least megabytes of which the user is told beforehand.
const MIN_TOLD_MEGABYTES: f64 = 2000.0;

/// Bytes that the largest grids of a run may need: those of its stages, and that of the mesh.
fn needed(config: &Config, resolution: usize) -> (f64, usize) {
    let square = |cubes: usize| (cubes * cubes) as f64;
    let finest = config.stages.iter().map(|s| s.resolution).max().unwrap_or(0);
    // In proportion to the width of the field, beyond the presets' 64.
    let wide = (config.field.width as f64 / 64.0).max(1.0);
    let (step, mesh) = (STEP_BYTES * wide * square(finest), MESH_BYTES * square(resolution));
    if step >= mesh { (step, finest) } else { (mesh, resolution) }
}

/// Tells of grids that need much memory, and refuses those that need more than the machine has.
pub fn check_memory(config: &Config, resolution: usize, common: Common) -> Result<(), Failure> {
    let (bytes, cubes) = needed(config, resolution);
    let megabytes = bytes / 1e6;
    if megabytes < MIN_TOLD_MEGABYTES {
        return Ok(());
    }
    let there = memory().map(|bytes| bytes / 1e6);
    let amount = |megabytes: f64| format!("{:.1} GB", megabytes / 1e3);
    if let Some(there) = there.filter(|&there| megabytes > there) {
        return Err(Failure::Usage(format!(
            "a grid of {cubes} cubes a side needs about {} of memory, and there are {}: lower stages or --resolution",
            amount(megabytes),
            amount(there)
        )));
    }
    let of = there.map_or(String::new(), |there| format!(" of {}", amount(there)));
    common.warn(&format!(
        "a grid of {cubes} cubes a side may need about {}{of} of memory, and steps on it take minutes",
        amount(megabytes)
    ));
    Ok(())
}

/// Bytes of memory that this process may use, if the system tells: those of the machine, or of its container.
fn memory() -> Option<f64> {
    let total = fs::read_to_string("/proc/meminfo").ok().and_then(|text| total_of(&text));
    let limit = |path: &str| fs::read_to_string(Path::new(path)).ok()?.trim().parse::<f64>().ok();
    let limits = ["/sys/fs/cgroup/memory.max", "/sys/fs/cgroup/memory/memory.limit_in_bytes"];
    total.into_iter().chain(limits.iter().filter_map(|path| limit(path))).reduce(f64::min)
}

fn total_of(meminfo: &str) -> Option<f64> {
    let line = meminfo.lines().find_map(|line| line.strip_prefix("MemTotal:"))?;
    Some(line.split_whitespace().next()?.parse::<f64>().ok()? * 1024.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use bijective_sdf::reconstruct::{Preset, Stage};

    #[test]
    fn presets_are_small_and_a_thousand_cubes_are_told() {
        for preset in Preset::ALL {
            assert!(needed(&Config::preset(preset), 256).0 < 1e6 * MIN_TOLD_MEGABYTES, "{preset}");
        }
        let mut config = Config::preset(Preset::Default);
        config.stages = vec![Stage { resolution: 1024, steps: 1 }];
        let (bytes, cubes) = needed(&config, 128);
        assert!((3e9..6e9).contains(&bytes) && cubes == 1024, "{bytes}");
        config.field.width *= 2;
        assert!(needed(&config, 128).0 > 1.5 * bytes);
    }

    #[test]
    fn threads_are_bounded() {
        assert!(check_threads(MIN_THREADS).is_ok());
        assert!(check_threads(100_000).unwrap_err().line().unwrap().contains("at most"));
        assert_eq!(total_of("MemFree: 1 kB\nMemTotal:       2 kB\n"), Some(2048.0));
    }
}
