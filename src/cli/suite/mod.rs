//! `suite`: many shapes, settings and seeds, and how good the results are.

use std::collections::HashMap;
use std::path::PathBuf;
use std::str::FromStr;

use bijective_sdf::reconstruct::Preset;
use clap::Args;

mod ablations;
mod fingerprint;
mod inputs;
mod names;
mod plan;
mod record;
mod results;
mod setting;
mod sheet;
mod store;
mod tables;
mod work;

use super::Common;
use super::console::print;
use super::failure::Failure;
use super::fineness::{RESOLUTION, resolution_parser};
use super::interrupt::Interrupt;
use super::lock::{Lock, Use};
use super::output::{make_directory, write_bytes};
use super::paths::check_apart;
use super::preview::{Angles, Axis, View};
use super::sample::Noise;
use super::settings::preset_parser;
use inputs::Search;
use names::{RUNS, TABLES};
use plan::{Measure, Plan};
use record::Record;
use results::Results;
use setting::{Change, Setting, Wanted};
use store::RunFile;
use work::Runner;

const LONG: &str = "\
Reconstruct many shapes with many settings and seeds, and tell how good the results are

Clouds are the files in DIR/in, or in DIR if there is no such directory. A cloud belongs to the truth (mesh or cloud, in
DIR/gt or --truth, or a mesh beside the clouds) whose name is the longest beginning of its own, up to its end or an
underscore: kitten_300 to kitten. Without a truth only topology and time are told.

Every finished run is a line of OUT/runs.jsonl at once, with its mesh in OUT/meshes, so the same command goes on where
it was stopped. A run whose files or options changed is made again, and what the earlier one left stays; a changed
program is not noticed but by a note.

OUT/table.md, table.csv, shapes.csv, surface.csv, table.tex and a picture sheet_SETTING.png for each setting show the
runs that the command line asks for; the tables of the settings also go to standard output. The second of them is about
the denser points S that the surface is drawn to, which OUT/surfaces has: whether they are distinct, whether their codes
fill the sphere, and how well they cover the truth, beside the points themselves.

A run that fails does not stop the others. Once all tables and pictures are written, the exit code is that of the last
failure in their order, also if an earlier command made it; --retry makes such runs again.";

/// Arguments of `suite`.
#[derive(Debug, Args)]
#[command(long_about = LONG)]
pub struct SuiteArgs {
    /// Directory of the shapes: clouds in `in` and truths in `gt` below it, or all in one
    dir: PathBuf,
    /// Directory for the results, made if it is not there
    #[arg(short, long, value_name = "DIR")]
    out: PathBuf,
    /// Directory of the truths
    #[arg(long, value_name = "DIR")]
    truth: Option<PathBuf>,
    /// Names of the clouds to take, with `*` for any letters, such as `*_300`
    #[arg(long, value_name = "PATTERN", default_value = "*")]
    inputs: String,
    /// Take only these, by the name of the cloud or of the truth
    #[arg(long, value_name = "NAME,..", value_delimiter = ',')]
    shapes: Vec<String>,
    /// Run this setting: one of the file, a preset, or an ablation such as sparse or patch_5; may be repeated
    #[arg(long, value_name = "NAME")]
    setting: Vec<String>,
    /// TOML file with a table a setting: `preset`, `points`, `noise`, and options as in a configuration
    #[arg(long, value_name = "FILE")]
    settings: Option<PathBuf>,
    /// Run the preset and the ablations of the paper, and print the paper's figures beside ours
    #[arg(long)]
    ablations: bool,
    /// How many seeds, from 0, or a list of seeds, such as `0,7` or `7,`
    #[arg(long, value_name = "N", default_value = "1")]
    seeds: Seeds,
    /// The preset that settings change [default: default]
    #[arg(long, value_parser = preset_parser())]
    preset: Option<Preset>,
    /// Set one option of every setting that does not set it itself; may be repeated
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<String>,
    /// Runs at the same time; they share the threads [default: one a thread]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..))]
    jobs: Option<u16>,
    /// Cubes along the longest side of the grid that meshes are taken from
    #[arg(long, default_value_t = RESOLUTION, value_parser = resolution_parser())]
    resolution: usize,
    /// Take so many points, sampled from the truth, instead of the clouds
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(4..))]
    points: Option<u32>,
    /// Standard deviation of Gaussian noise to add, in units of the files or, as in `0.5%`, of the longest side
    #[arg(long, value_name = "S")]
    noise: Option<Noise>,
    /// Samples of each surface in a comparison
    #[arg(long, value_name = "N", default_value_t = 100_000, value_parser = clap::value_parser!(u32).range(1..))]
    samples: u32,
    /// The seed whose results are drawn [default: the first]
    #[arg(long, value_name = "SEED")]
    sheet_seed: Option<u64>,
    /// Draw no pictures
    #[arg(long)]
    no_sheets: bool,
    /// Direction the pictures are taken from, in degrees: around the upward axis, and above the horizon
    #[arg(long, value_name = "AROUND,ABOVE", allow_hyphen_values = true)]
    view: Option<Angles>,
    /// Upward axis of the pictures
    #[arg(long, value_enum, default_value_t = Axis::Y)]
    up: Axis,
    /// Make runs that failed again, with a newer build for example
    #[arg(long)]
    retry: bool,
    /// Only print what would be run and the table of what there is
    #[arg(long)]
    dry_run: bool,
}

/// Which seeds.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Seeds(Vec<u64>);

impl FromStr for Seeds {
    type Err = String;

    fn from_str(s: &str) -> Result<Self, String> {
        let expected = || "a number of seeds, or a list of seeds such as 0,7".to_string();
        let seeds = match s.contains(',') {
            false => {
                (0..s.trim().parse::<u64>().ok().filter(|n| (1..=10_000).contains(n)).ok_or_else(expected)?)
                    .collect()
            }
            true => {
                let parts = s.split(',').map(str::trim).filter(|part| !part.is_empty());
                let mut seeds: Vec<u64> = Vec::new();
                for part in parts {
                    let seed = part.parse().map_err(|_| expected())?;
                    if !seeds.contains(&seed) {
                        seeds.push(seed);
                    }
                }
                seeds
            }
        };
        if seeds.is_empty() { Err(expected()) } else { Ok(Seeds(seeds)) }
    }
}

/// Runs a suite.
pub fn run(args: &SuiteArgs, common: Common) -> Result<(), Failure> {
    let shapes = inputs::find(Search {
        dir: &args.dir,
        truth: args.truth.as_deref(),
        inputs: &args.inputs,
        shapes: &args.shapes,
        out: &args.out,
    })?;
    let settings = Wanted {
        preset: args.preset,
        set: &args.set,
        names: &args.setting,
        file: args.settings.as_deref(),
        ablations: args.ablations,
        input: Change { points: args.points.map(|n| n as usize), noise: args.noise },
    }
    .build()?;
    let measure = Measure { resolution: args.resolution, samples: args.samples as usize };
    let plan = Plan::new(&shapes, &settings, &args.seeds.0, measure)?;
    plan.notes.iter().for_each(|note| common.note(note));

    if let Some(file) = &args.settings {
        let sheets = settings.iter().map(sheet_file);
        for name in [RUNS].into_iter().chain(TABLES).map(String::from).chain(sheets) {
            check_apart("--out", &args.out.join(name), file)?;
        }
    }

    let runs = args.out.join(RUNS);
    // Held to the end, from before the runs are read: two suites would make the same ones.
    let lock = || -> Result<_, Failure> {
        make_directory(&args.out)?;
        Lock::on(&runs, Use::Runs)
    };
    let _lock = if args.dry_run { None } else { lock()? };
    let stored = store::read(&runs)?;
    if stored.torn > 0 {
        common.note(&format!("{}: dropped the last line, which is not whole", runs.display()));
    }
    let mut records = stored.records.clone();
    if args.retry {
        records.retain(|_, record| record.failure.is_none());
    }
    let open = plan.open(&records);
    let text = overview(&plan, args, open.len());
    if args.dry_run {
        let results = Results { plan: &plan, records: &records };
        return print(format!("{text}\n\n{}", tables::screen(results, args.ablations)));
    }
    common.note(&text);
    note_builds(&plan, &records, common);

    let store = RunFile::open(&runs, &stored)?;
    let mut stopped = None;
    if !open.is_empty() {
        let interrupt = Interrupt::install(
            "finishing the steps; what is not finished is made again by the same command",
        )?;
        interrupt.begin();
        let threads = rayon::current_num_threads();
        let runner = Runner {
            out: &args.out,
            measure,
            jobs: args.jobs.map_or(threads, usize::from),
            threads,
            interrupt: &interrupt,
            quiet: common.quiet,
        };
        let made = runner.make(&open, store)?;
        stopped = interrupt.end().then_some((made.len(), open.len())).filter(|(done, all)| done < all);
        records.extend(made);
    }
    let results = Results { plan: &plan, records: &records };
    let title = title(&plan, args);
    let texts = tables::write(results, &title, args.ablations);
    let texts = [&texts.markdown, &texts.csv, &texts.shapes_csv, &texts.surface_csv, &texts.latex]
        .map(String::as_bytes);
    for (name, text) in TABLES.into_iter().zip(texts) {
        write_bytes(&args.out.join(name), text)?;
    }
    if let Some((done, all)) = stopped {
        let text = format!("after {done} of {all} runs; the same command goes on from there");
        return Err(Failure::Interrupted(text));
    }
    if !args.no_sheets {
        draw_sheets(results, args)?;
    }
    print(tables::screen(results, args.ablations))?;
    results.failure().map_or(Ok(()), Err)
}

/// How much there is to do, in a line.
fn overview(plan: &Plan<'_>, args: &SuiteArgs, open: usize) -> String {
    let names: Vec<&str> = plan.settings.iter().map(|s| s.name.as_str()).collect();
    format!(
        "{} shapes, {} settings ({}), {} seeds: {} runs, {open} to make",
        plan.shapes.len(),
        names.len(),
        names.join(", "),
        args.seeds.0.len(),
        plan.jobs.len()
    )
}

/// What all runs share, in a line.
fn title(plan: &Plan<'_>, args: &SuiteArgs) -> String {
    let mut text = format!(
        "bijective-sdf {}, {} shapes ({}), seeds {}, preset {}",
        env!("CARGO_PKG_VERSION"),
        plan.shapes.len(),
        args.inputs,
        args.seeds.0.iter().map(u64::to_string).collect::<Vec<_>>().join(" "),
        args.preset.unwrap_or(Preset::Default)
    );
    for pair in &args.set {
        text += &format!(" {pair}");
    }
    if let Some(points) = args.points {
        text += &format!(", {points} points");
    }
    if let Some(noise) = args.noise {
        text += &format!(", noise {noise}");
    }
    text + &format!(", meshes of {} cubes, {} samples", args.resolution, args.samples)
}

/// Tells if runs were made by another program than this.
fn note_builds(plan: &Plan<'_>, records: &HashMap<String, Record>, common: Common) {
    let own = fingerprint::of_program();
    let others = plan.jobs.iter().filter_map(|job| records.get(&job.fingerprint)).filter(|r| r.build != own);
    let others = others.count();
    if others > 0 && own.is_some() {
        common.note(&format!(
            "{others} runs were made by another build of this program; use a new --out to make them again"
        ));
    }
}

/// A picture for every setting that is not the same as another.
fn draw_sheets(results: Results<'_>, args: &SuiteArgs) -> Result<(), Failure> {
    let seed = args.sheet_seed.unwrap_or(args.seeds.0[0]);
    let view = View { angles: args.view.unwrap_or_default(), up: args.up };
    for setting in results.plan.settings {
        let made = results.made(setting);
        let entries: Vec<sheet::Entry<'_>> = made
            .into_iter()
            .filter(|(job, _)| job.seed == seed)
            .map(|(job, record)| sheet::Entry { job, record })
            .collect();
        if entries.is_empty() || results.plan.same_as(setting).is_some() {
            continue;
        }
        let titles = sheet_titles(results, setting, seed);
        let image = sheet::draw(&titles, &entries, &view, &args.out);
        write_bytes(&args.out.join(sheet_file(setting)), &image.to_small_png())?;
    }
    Ok(())
}

/// The file of a setting's picture, in the directory of the results.
fn sheet_file(setting: &Setting) -> String {
    format!("sheet_{}.png", setting.file_name())
}

/// The two lines above a sheet.
fn sheet_titles(results: Results<'_>, setting: &Setting, seed: u64) -> [String; 2] {
    let s = results.summary(setting);
    let figure = |x: Option<f64>| x.map_or("-".to_string(), |x| format!("{x:.4}"));
    let what = format!(
        "{}, seed {seed}: points, S (10 x truth to S / to points), result, truth; worst first. All seeds:",
        setting.name
    );
    let figures = format!(
        "10 CD_L1 {} mean {} median, NC {}, {} of {} closed, {} of {} in one part, {} failures",
        figure(s.cd_l1[0]),
        figure(s.cd_l1[2]),
        figure(s.nc),
        s.closed.yes,
        s.closed.all,
        s.single.yes,
        s.single.all,
        s.failures
    );
    [what, figures]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn seeds_are_counted_or_listed() {
        for (text, seeds) in [
            ("1", Some(vec![0])),
            ("3", Some(vec![0, 1, 2])),
            ("7,", Some(vec![7])),
            ("4, 2,4", Some(vec![4, 2])),
            ("0", None),
            (",", None),
            ("", None),
            ("x", None),
            ("1,x", None),
            ("-1", None),
        ] {
            assert_eq!(text.parse().ok(), seeds.map(Seeds), "{text}");
        }
    }
}
