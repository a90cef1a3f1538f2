//! The built program: exit codes, messages, pipes, checkpoints. Every test makes its own small files.
#![cfg(feature = "cli")]

use std::fs;
use std::io::{Read, Write};
use std::path::Path;
use std::process::Command;

use bijective_sdf::geometry::AnalyticShape;
use bijective_sdf::io::{read_cloud, read_mesh, read_mesh_bytes};

mod common;
use common::json::{Known, parse};
use common::{Dir, TINY, code, err, fails, out, piped, program, run, tiny};
use serde_json::Value;

#[test]
fn bad_inputs_are_refused_with_a_reason_and_nothing_is_written() {
    let dir = Dir::new("bad");
    let good = fs::read(dir.cloud()).unwrap();
    let cases: [(&str, &[u8], &str); 9] = [
        ("empty.ply", b"", "empty"),
        ("empty.xyz", b"", "empty"),
        ("truncated.ply", &good[..good.len() - 5], ""),
        ("unknown.dat", b"\x00\x01\x02\x03\x04\x05\x06\x07", "format is unknown"),
        ("word.xyz", b"0 0 0\n1 zero 0\n", ":2:"),
        ("nan.xyz", b"nan nan nan\n1 nan 0\n", "none of the 2 points has three finite numbers"),
        ("huge.xyz", b"0 0 0\n1 1e60 0\n0 1 0\n0 0 1\n", "not a finite"),
        ("flat.xyz", b"0 0 0\n1 0 0\n0 1 0\n1 1 0\n3 4 0\n", "in one plane"),
        ("three.xyz", b"0 0 0\n1 0 0\n0 1 0\n", "at least 4 distinct points"),
    ];
    for (name, bytes, part) in cases {
        let input = dir.text(name, bytes);
        fails(&mut tiny(&input, &dir.path("mesh.ply")), 3, &[name, part]);
    }
    fails(&mut tiny(&dir.path("none.ply"), &dir.path("mesh.ply")), 3, &["none.ply", "cannot read"]);
    assert!(dir.names().iter().all(|n| !n.contains("mesh")), "{:?}", dir.names());
}

#[test]
fn wrong_usage_is_told_before_any_work() {
    let dir = Dir::new("usage");
    let (cloud, mesh) = (dir.cloud(), dir.path("mesh.ply"));
    fails(tiny(&cloud, &mesh).args(["--set", "field.widht=3"]), 2, &["field.widht", "did you mean"]);
    fails(tiny(&cloud, &mesh).args(["--set", "field.width"]), 2, &["key=value"]);
    fails(tiny(&cloud, &mesh).args(["--set", "field.width=0"]), 2, &["field.width"]);
    fails(&mut tiny(&cloud, &dir.path("mesh.las")), 2, &["ply, obj, stl"]);
    fails(&mut tiny(&cloud, &dir.path("mesh.xyz")), 2, &["ply, obj, stl"]);
    fails(tiny(&cloud, Path::new("-")).arg("--json"), 2, &["--json"]);
    fails(tiny(&cloud, &mesh).arg("--preview").arg(&mesh), 2, &["both"]);
    fails(&mut tiny(&cloud, &dir.path("none/mesh.ply")), 1, &["does not exist"]);
    fails(&mut tiny(&cloud, &dir.0), 1, &["is a directory"]);
    fails(program().arg("evaluate").args([&mesh, &mesh, &mesh]), 2, &["pairs"]);
    for args in
        [&["nothing"][..], &["reconstruct"], &["presets", "--threads", "0"], &["demo", "--preset", "best"]]
    {
        assert!(run(program().args(args), 2).stdout.is_empty());
    }
    assert!(out(&run(program().arg("--help"), 0)).contains("Exit codes"));
    assert!(out(&run(program().arg("--version"), 0)).contains(env!("CARGO_PKG_VERSION")));
    assert_eq!(dir.names(), ["cloud.ply"]);
}

#[test]
fn configuration_files_hold_tables_or_dotted_keys_and_nothing_unknown() {
    let dir = Dir::new("config");
    let presets = out(&run(program().arg("presets"), 0));
    assert_eq!(presets.lines().count(), 7);
    assert!(presets.ends_with("--set train_up_to=all trains.\n"), "{presets}");
    for preset in ["start", "paper", "fast", "default", "fine"] {
        assert!(presets.contains(preset));
        let text = out(&run(program().args(["config", "--preset", preset]), 0));
        let file = dir.text("whole.toml", &text);
        let again = out(&run(program().arg("config").arg("--config").arg(&file), 0));
        let body = |t: &str| t.lines().skip(1).map(String::from).collect::<Vec<_>>();
        assert_eq!(body(&again), body(&text));
    }
    let file =
        dir.text("part.toml", "preset = \"fast\"\nseed = 7\n[field]\nwidth = 24\n[weights]\npara = 2.5\n");
    let text = out(&run(program().args(["config", "--set", "field.depth=3", "--config"]).arg(&file), 0));
    for line in ["preset = \"fast\"", "seed = 7", "field.width = 24", "field.depth = 3", "weights.para = 2.5"]
    {
        assert!(text.contains(line), "{line} is not in {text}");
    }
    let text = out(&run(program().args(["config", "--seed", "9", "--config"]).arg(&file), 0));
    assert!(text.contains("seed = 9"));

    for (content, parts) in [
        ("[field]\nwide = 3\n", &["bad.toml", "field.wide"][..]),
        ("seed = \"x\"\n", &["bad.toml", "seed"]),
        ("seed = 1\nfield.width = = 3\n", &["bad.toml:2", "not TOML"]),
        ("preset = \"best\"\n", &["bad.toml", "choose one of"]),
        ("seed = 2020-01-01\n", &["seed"]),
    ] {
        let file = dir.text("bad.toml", content);
        fails(program().args(["config", "--config"]).arg(&file), 2, parts);
    }
    fails(program().args(["config", "--config"]).arg(dir.path("none.toml")), 3, &["none.toml"]);
}

#[test]
fn a_run_reports_in_json_and_is_the_same_for_any_number_of_threads() {
    let dir = Dir::new("json");
    let cloud = dir.cloud();
    let one = dir.path("one.ply");
    let mut command = tiny(&cloud, &one);
    command.args(["--json", "--quiet", "--threads", "1", "--seed", "3"]);
    command.arg("--preview").arg(dir.path("one.png")).args(["--up", "z", "--view", "-20,10"]);
    command.arg("--surface-points").arg(dir.path("s.xyz"));
    let output = run(&mut command, 0);
    assert!(output.stderr.is_empty(), "{}", err(&output));
    let text = out(&output);
    assert_eq!(text.lines().count(), 1);
    let json = parse(&text);
    assert_eq!(json.at("points").number(), 60.0);
    assert_eq!(json.at("duplicates").number(), 0.0);
    assert_eq!(json.at("seed").number(), 3.0);
    // 3 steps of the parameterization alone, 20 of the training.
    assert_eq!(json.at("steps").number(), 23.0);
    assert_eq!(json.at("total_steps").number(), 23.0);
    assert_eq!((json.at("phase").text(), json.at("ended").text()), ("train", "done"));
    assert_eq!(json.at("output").text(), one.to_str().unwrap());
    assert!(json.at("closed_and_oriented").truth());
    assert!(json.at("losses").at("loss").number() > 0.0);
    assert!(json.at("seconds").at("total").number() >= json.at("seconds").at("mesh").number());
    assert_eq!(json.at("field"), &Value::Null);
    let mesh = read_mesh(&one).unwrap();
    let topology = mesh.topology();
    assert!(topology.closed && topology.oriented && topology.volume > 0.2, "{topology}");
    assert_eq!(json.at("mesh").at("faces").number(), mesh.faces.len() as f64);
    assert_eq!(json.at("mesh").at("genus").number(), 0.0);
    assert_eq!(&fs::read(dir.path("one.png")).unwrap()[1..4], b"PNG");
    assert!(fs::read_to_string(dir.path("s.xyz")).unwrap().lines().count() > 60);

    let two = dir.path("two.ply");
    let output = run(tiny(&cloud, &two).args(["--threads", "2", "--seed", "3"]), 0);
    assert!(output.stdout.is_empty());
    for part in ["60 points", "step 1/23  parameterization alone", "step 4/23  loss", "step 23/23  "] {
        assert!(err(&output).contains(part), "{part} is not in {}", err(&output));
    }
    assert!(fs::read(&one).unwrap() == fs::read(&two).unwrap(), "the bytes depend on the threads");
    let three = dir.path("three.ply");
    run(tiny(&cloud, &three).args(["--seed", "4"]), 0);
    assert!(fs::read(&one).unwrap() != fs::read(&three).unwrap(), "the seed does nothing");
}

/// The colours of a binary cloud of ours, behind three floats each.
fn colours(path: &Path) -> Vec<[u8; 3]> {
    let bytes = fs::read(path).unwrap();
    let header = b"property uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n";
    let at = bytes.windows(header.len()).position(|w| w == header).expect("colours") + header.len();
    bytes[at..].chunks_exact(15).map(|row| row[12..].try_into().unwrap()).collect()
}

#[test]
fn the_figures_of_the_parameterization_are_told_and_drawn() {
    let dir = Dir::new("codes");
    let (cloud, mesh) = (dir.cloud(), dir.path("mesh.ply"));
    let mut command = tiny(&cloud, &mesh);
    command.arg("--json").arg("--codes").arg(dir.path("ball")).arg("--surface-points").arg(dir.path("s.ply"));
    let output = run(&mut command, 0);
    let text = err(&output);
    assert!(text.contains("note: S: ") && text.contains(" of 600 points distinct ("), "{text}");
    assert!(text.contains("note: codes: mean 0.") || text.contains("note: codes: mean 1."), "{text}");
    let json = parse(&out(&output));
    let coverage = json.at("coverage");
    assert_eq!((coverage.at("points").number(), coverage.at("surface_points").number()), (60.0, 600.0));
    for (key, least, most) in [
        ("distinct", 1.0, 600.0),
        ("distinct_share", 0.001, 1.0),
        ("q_to_s", 0.0, 1.0),
        ("s_to_q", 0.0, 1.0),
        ("mean_code", 0.0, 1.001),
        ("sphere_codes", 600.0, 600.0),
        ("used_codes", 10.0, 600.0),
        ("evenness", 10.0 / 600.0, 1.0),
        ("near_pairs", 0.0, 360_000.0),
    ] {
        let x = coverage.at(key).number();
        assert!((least..=most).contains(&x), "{key} {x}");
    }
    assert!(coverage.at("folded").is_null() || (0.0..=1.0).contains(&coverage.at("folded").number()));

    let files = json.at("codes").as_array().unwrap();
    let read = |part: &str| {
        let path = dir.path(&format!("ball-{part}.ply"));
        assert!(files.iter().any(|f| f.text() == path.to_str().unwrap()), "{part}");
        let (points, colours) = (read_cloud(&path).unwrap().points, colours(&path));
        assert_eq!(points.len(), colours.len());
        (points, colours)
    };
    let (points, own) = read("points");
    let (codes, colours) = read("codes");
    assert_eq!((points.len(), codes.len(), &own), (60, 60, &colours));
    for (code, colour) in codes.iter().zip(&colours) {
        for (x, c) in code.iter().zip(colour) {
            assert!((127.5 * (x + 1.0) - f64::from(*c)).abs() <= 0.51, "{code:?} {colour:?}");
        }
    }
    let ((surface, own), (patches, colours)) = (read("surface"), read("patches"));
    assert_eq!((surface.len(), patches.len(), own), (600, 600, colours));
    assert_eq!(surface, read_cloud(dir.path("s.ply")).unwrap().points);
    let ((verts, own), (moved, colours)) = (read("grid"), read("moved"));
    assert!(verts.len() > 50 && verts.len() == moved.len() && own == colours && verts != moved);
    assert_eq!(files.len(), 6);

    // Nothing of it is written over the input, nor where it would not be.
    let input = dir.path("a-codes.ply");
    fs::copy(&cloud, &input).unwrap();
    let before = fs::read(&input).unwrap();
    fails(tiny(&input, &mesh).arg("--codes").arg(dir.path("a")), 2, &["--codes", "overwrite the input"]);
    fails(&mut tiny(&input, &input), 2, &["--output", "overwrite the input"]);
    fails(tiny(&cloud, &dir.path("b-grid.ply")).arg("--codes").arg(dir.path("b.ply")), 2, &["both"]);
    fails(tiny(&cloud, &mesh).args(["--codes", "-"]), 2, &["pipe"]);
    let none = ["--set", "parameterization=upsample"];
    fails(tiny(&cloud, &mesh).args(none).arg("--codes").arg(dir.path("c")), 2, &["parameterization=bsp"]);
    let none = ["--set", "parameterization=none", "--surface-points", "no-s.ply"];
    fails(tiny(&cloud, &mesh).args(none), 2, &["parameterization=none"]);
    assert!(fs::read(&input).unwrap() == before);
    // Without codes S still has figures, and without S there are none.
    let of = |setting: &str| {
        let option = format!("parameterization={setting}");
        let output = run(tiny(&cloud, &mesh).args(["--json", "--quiet", "--set", &option]), 0);
        parse(&out(&output)).at("coverage").clone()
    };
    let upsample = of("upsample");
    assert!(upsample.at("distinct_share").number() > 0.9 && upsample.at("mean_code").is_null());
    assert!(of("none").is_null());
}

#[test]
fn points_are_compared_with_a_truth() {
    let dir = Dir::new("points");
    let mesh = dir.mesh("box.ply", true);
    let sample = |name: &str, n: &str| {
        let path = dir.path(name);
        run(program().arg("sample").arg(&mesh).arg("-o").arg(&path).args(["-n", n, "--seed", "5"]), 0);
        path
    };
    let (few, many) = (sample("few.ply", "50"), sample("many.ply", "500"));
    let evaluate = |args: &[&str]| {
        let mut command = program();
        command
            .args(["evaluate", "--points", "--samples", "5000"])
            .args(args)
            .args([&mesh, &few, &mesh, &many]);
        out(&run(&mut command, 0))
    };
    let lines: Vec<Value> = evaluate(&["--json"]).lines().map(parse).collect();
    let at = |i: usize, key: &str| lines[i].at(key).number();
    assert_eq!((lines[0].at("name").text(), at(0, "points"), at(1, "distinct")), ("few", 50.0, 500.0));
    assert!(at(0, "truth_to_it") > 2.0 * at(1, "truth_to_it") && at(0, "to_truth") < 0.05);
    assert!((at(1, "truth_to_it") / at(1, "floor") - 1.0).abs() < 0.1, "{lines:?}");
    let csv = evaluate(&["--csv"]);
    assert!(csv.starts_with("name,points,distinct,10 to truth,10 truth to it,10 floor\n"), "{csv}");
    for style in ["--markdown", "--latex"] {
        assert!(evaluate(&[style]).contains("many"));
    }
    assert!(evaluate(&[]).contains("truth to it"));
    fails(program().args(["evaluate", "--points"]).args([&mesh, &few, &mesh]), 2, &["pairs"]);
    run(program().args(["evaluate", "--points", "--scan"]).args([&mesh, &few, &mesh]), 2);
    let mut command = program();
    command.args(["evaluate", "--points", "--json"]).args([&mesh, &dir.path("none.ply"), &mesh, &few]);
    let output = run(&mut command, 3);
    assert!(err(&output).contains("none.ply") && out(&output).lines().count() == 2);
}

#[test]
fn pipes_carry_the_cloud_in_and_the_mesh_out() {
    let dir = Dir::new("pipes");
    let cloud = dir.cloud();
    let file = dir.path("mesh.ply");
    run(tiny(&cloud, &file).arg("--quiet"), 0);
    let feed = |command: &mut Command, bytes: &[u8]| {
        let mut child = piped(command);
        child.stdin.take().unwrap().write_all(bytes).unwrap();
        child.wait_with_output().unwrap()
    };
    let bytes = fs::read(&cloud).unwrap();
    let output = feed(tiny(Path::new("-"), Path::new("-")).arg("--quiet"), &bytes);
    assert_eq!(code(&output), 0, "{}", err(&output));
    assert!(output.stdout == fs::read(&file).unwrap());

    let text: String = AnalyticShape::Sphere { radius: 0.5 }
        .sample(60, 1)
        .0
        .iter()
        .map(|p| format!("{},{},{}\n", p[0], p[1], p[2]))
        .collect();
    let mut command = tiny(Path::new("-"), Path::new("-"));
    command.args(["--format", "csv", "--output-format", "obj"]);
    let output = feed(&mut command, text.as_bytes());
    assert_eq!(code(&output), 0, "{}", err(&output));
    assert_eq!(read_mesh_bytes(&output.stdout, None).unwrap(), read_mesh(&file).unwrap());

    let output = feed(&mut tiny(Path::new("-"), Path::new("-")), b"");
    assert_eq!(code(&output), 3);
    assert!(err(&output).contains("standard input"), "{}", err(&output));
}

#[test]
fn a_reader_that_goes_away_is_no_error() {
    let dir = Dir::new("closed");
    let mesh = dir.mesh("box.ply", true);
    let mut command = program();
    command.arg("sample").arg(&mesh).args(["-o", "-", "--count", "200000", "--output-format", "xyz"]);
    let mut child = piped(&mut command);
    drop(child.stdout.take());
    let output = child.wait_with_output().unwrap();
    assert_eq!(code(&output), 0, "{}", err(&output));
    assert!(!err(&output).contains("panic"), "{}", err(&output));
}

#[test]
fn a_time_limit_ends_early_with_a_mesh() {
    let dir = Dir::new("limit");
    let mesh = dir.path("mesh.stl");
    // In each phase: 10 steps that fit a first shape, 3, and 20.
    for (options, total, phase) in [
        (&["--set", "start.shape=gauss", "--set", "start.steps=10"][..], 33, "start"),
        (&[], 23, "pretrain"),
        (&["--set", "bsp_pretrain=0"], 20, "train"),
    ] {
        let mut command = tiny(&dir.cloud(), &mesh);
        command.args(["--time-limit", "0", "--json"]).args(options);
        let output = run(&mut command, 0);
        let json = parse(&out(&output));
        assert_eq!((json.at("ended").text(), json.at("steps").number()), ("time-limit", 1.0));
        assert_eq!((json.at("phase").text(), json.at("total_steps").number()), (phase, f64::from(total)));
        assert!(json.at("losses").at("loss").number() > 0.0);
        let note = format!("the time limit ended the run after step 1 of {total}, in the phase {phase};");
        assert!(err(&output).contains(&note), "{}", err(&output));
        assert!(read_mesh(&mesh).unwrap().topology().closed);
    }
    // The work before the steps is not limited: it is told if that alone took longer, with steps and without.
    for (limit, options, late) in [
        ("0", &[][..], true),
        ("0", &["--set", "start.shape=gauss", "--set", "stages=none"], true),
        ("1000", &[], false),
    ] {
        let mut command = tiny(&dir.cloud(), &mesh);
        command.args(["--time-limit", limit, "--json", "--quiet"]).args(options);
        let output = run(&mut command, 0);
        let told = err(&output).contains("warning: --time-limit 0: what comes before the first step");
        assert_eq!(told, late, "{}", err(&output));
        let warnings = parse(&out(&output)).at("warnings").to_string();
        assert_eq!(warnings.contains("--time-limit"), late, "{warnings}");
    }
    fails(tiny(&dir.cloud(), &mesh).arg("--time-limit=-1"), 2, &["seconds"]);
}

#[test]
fn sample_info_and_evaluate_fit_together() {
    let dir = Dir::new("trip");
    let mesh = dir.mesh("box.ply", true);
    let cloud = dir.path("points.csv");
    let mut sample = program();
    sample
        .arg("sample")
        .arg(&mesh)
        .arg("-o")
        .arg(&cloud)
        .args(["-n", "500", "--seed", "2", "--noise", "0.1%"]);
    run(&mut sample, 0);
    let first = fs::read(&cloud).unwrap();
    run(&mut sample, 0);
    assert!(first == fs::read(&cloud).unwrap());

    let json = parse(&out(&run(program().arg("info").arg(&cloud).arg("--json"), 0)));
    assert_eq!((json.at("kind").text(), json.at("points").number()), ("cloud", 500.0));
    assert!(json.at("usable").truth() && json.at("duplicates").number() == 0.0);
    let spacing = json.at("spacing").at("median").number();
    assert!((0.01..0.1).contains(&spacing), "{spacing}");
    assert!(out(&run(program().arg("info").arg(&cloud), 0)).contains("points      500"));

    let json = parse(&out(&run(program().arg("info").arg(&mesh).args(["--json", "--check"]), 0)));
    assert_eq!((json.at("kind").text(), json.at("mesh").at("faces").number()), ("mesh", 12.0));
    assert_eq!(json.at("mesh").at("volume").number(), 1.0);
    let open = dir.mesh("open.obj", false);
    let output = run(program().arg("info").arg(&open).arg("--check"), 4);
    assert!(err(&output).contains("3 boundary edges") && out(&output).contains("faces       11"));

    let evaluate = |args: &[&str], files: &[&Path]| {
        let mut command = program();
        command.arg("evaluate").args(["--samples", "5000"]).args(args).args(files);
        out(&run(&mut command, 0))
    };
    let json = parse(&evaluate(&["--json", "--ntps", "--surface"], &[&mesh, &mesh]));
    let report = json.at("report");
    let of = |part: &str, key: &str| report.at(part).at(key).number();
    assert!((of("metrics", "cd_l1") / of("floor", "cd_l1") - 1.0).abs() < 0.05);
    assert!(of("surface", "hd") < 1e-5 && of("metrics", "nc") > 0.95 && of("metrics", "nc_ntps") > 0.95);
    assert_eq!(
        evaluate(&["--threads", "1"], &[&mesh, &mesh]),
        evaluate(&["--threads", "2"], &[&mesh, &mesh])
    );
    assert!(evaluate(&[], &[&mesh, &mesh]).contains("floor"));
    let csv = evaluate(&["--csv"], &[&mesh, &open, &cloud, &mesh]);
    assert!(csv.lines().count() == 3 && csv.contains(",NC ntps,precision,recall,"), "{csv}");
    assert!(csv.lines().next().unwrap().ends_with(",1000 CD^2 scan"), "{csv}");
    assert!(evaluate(&["--markdown"], &[&mesh, &open, &mesh, &mesh]).starts_with("| shape"));
    let latex = evaluate(&["--latex", "--protocol", "ntps"], &[&mesh, &open, &mesh, &mesh]);
    assert!(
        latex.starts_with("\\begin{tabular}{lrrr}\n\\hline\nshape") && latex.contains("10 CD\\_L1 & 100 CD")
    );
    fails(program().arg("evaluate").args([&mesh, &cloud]), 3, &["points.csv", "without faces"]);
    // One that fails does not end the rest.
    let mut command = program();
    command.args(["evaluate", "--json", "--samples", "500"]).args([&mesh, &cloud, &mesh, &mesh]);
    let output = run(&mut command, 3);
    let lines: Vec<Value> = out(&output).lines().map(parse).collect();
    assert!(lines.len() == 3 && err(&output).contains("without faces"));
    assert!(lines[0].at("error").text().contains("without faces") && lines[0].at("name").text() == "points");
    assert_eq!(lines[1].at("options").at("samples").number(), 500.0);
    let summary = lines[2].at("summary");
    assert_eq!((summary.at("pairs").number(), summary.at("failed").number()), (2.0, 1.0));
    fails(program().arg("evaluate").args([&mesh, &mesh, &mesh, &mesh]).args(["--tau", "0"]), 2, &["tau"]);
    fails(program().arg("evaluate").args([&mesh, &mesh]).args(["--tau", "0"]), 2, &["tau"]);
}

#[test]
fn protocols_choose_samples_frame_and_columns() {
    let dir = Dir::new("protocols");
    let mesh = dir.mesh("box.ply", true);
    let scan = dir.text("scan.csv", "x,y,z,nx,ny,nz\n0.5,0.5,1,0,0,2\n0.5,0.5,1.25,0,0,2\n");
    let evaluate = |args: &[&str], files: &[&Path]| {
        out(&run(program().arg("evaluate").args(args).args(files).arg("--quiet"), 0))
    };
    let text = evaluate(&["--protocol", "sal", "--scan", "--json"], &[&mesh, &mesh, &scan]);
    let json = parse(&text);
    assert_eq!(json.at("report").at("pred_samples").number(), 30_000.0);
    assert_eq!(json.at("report").at("scale").number(), 1.0);
    let hd = json.at("report").at("scan").at("hd_comp").number();
    assert!((hd - 0.25).abs() < 0.01, "{hd}");
    assert!(json.at("published").at("1000 CD^2 scan").number() > 100.0);
    // What is said outright wins over the protocol.
    let args = ["--protocol", "digs", "--samples", "2000", "--frame", "unit", "--tau", "0.5"];
    let text = evaluate(&args, &[&mesh, &mesh]);
    assert!(text.contains("2000 samples against 2000") && text.contains("precision at 0.5"), "{text}");
    assert!(text.lines().any(|l| l.starts_with("CD scan ") && l.contains(" - ")), "{text}");

    // Several pairs end in a summary; a cloud with normals has a normal consistency.
    let files: [&Path; 4] = [&mesh, &mesh, &scan, &mesh];
    let text = evaluate(&["--json", "--samples", "3000"], &files);
    let lines: Vec<Value> = text.lines().map(parse).collect();
    assert_eq!(lines.len(), 3);
    let at = |i: usize, key: &str| lines[i].at("report").at("metrics").at(key).number();
    let summary = lines[2].at("summary");
    assert_eq!((summary.at("pairs").number(), summary.at("protocol").text()), (2.0, "onet"));
    let of = |key: &str, what: &str| summary.at("report").at("metrics").at(key).at(what).number();
    assert!((of("cd_l1", "mean") - 0.5 * (at(0, "cd_l1") + at(1, "cd_l1"))).abs() < 1e-12);
    let (low, high) = (at(0, "hd").min(at(1, "hd")), at(0, "hd").max(at(1, "hd")));
    assert!((of("hd", "p5") - (low + 0.05 * (high - low))).abs() < 1e-12);
    assert_eq!((of("nc", "count"), of("nc", "p50")), (2.0, of("nc", "median")));
    let published = summary.at("published").at("10 CD_L1").at("mean").number();
    assert!((published - 10.0 * of("cd_l1", "mean")).abs() < 1e-12);

    let header =
        "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\nproperty float z\n";
    let normals = "property float nx\nproperty float ny\nproperty float nz\nend_header\n";
    let rows = "0.5 0.5 1 0 0 2\n0.5 1 0.5 0 -1 0\n";
    let cloud = dir.text("cloud.ply", format!("{header}{normals}{rows}"));
    let json = parse(&evaluate(&["--json", "--frame", "as-is"], &[&cloud, &mesh]));
    assert!(json.at("report").at("gt_samples").number() == 2.0);
    assert!(json.at("report").at("metrics").at("nc").number() > 0.6);
    fails(program().arg("evaluate").args([&mesh, &mesh]).arg("--scan"), 2, &["threes"]);
    let output = run(program().arg("evaluate").args([&mesh, &mesh]).args(["--protocol", "x"]), 2);
    assert!(err(&output).contains("onet, ntps, digs, sal"));
}

#[test]
fn a_saved_field_gives_distances_and_the_same_mesh() {
    let dir = Dir::new("field");
    let (mesh, field) = (dir.path("mesh.ply"), dir.path("ball.field"));
    run(tiny(&dir.cloud(), &mesh).arg("--save-field").arg(&field), 0);
    let points = dir.text("p.xyz", "0 0 0\n0.8 0 0\n");
    let text = out(&run(program().arg("sdf").args([&field, &points]).arg("--gradient"), 0));
    let rows: Vec<Vec<f64>> =
        text.lines().map(|l| l.split(' ').map(|x| x.parse().unwrap()).collect()).collect();
    assert_eq!((rows.len(), rows[0].len()), (2, 4));
    assert!(rows[0][0] < 0.0 && rows[1][0] > 0.0 && rows[1][1] > 0.0, "{text}");
    let again = dir.path("again.ply");
    run(program().arg("mesh").arg(&field).arg("-o").arg(&again).args(["--resolution", "20"]), 0);
    assert!(fs::read(&mesh).unwrap() == fs::read(&again).unwrap());
    fails(program().arg("sdf").args([&points, &points]), 3, &["p.xyz"]);
}

#[test]
fn checkpoints_of_another_run_are_refused() {
    let dir = Dir::new("other");
    let (cloud, mesh, saved) = (dir.cloud(), dir.path("mesh.ply"), dir.path("a.checkpoint"));
    run(tiny(&cloud, &mesh).arg("--checkpoint").arg(&saved), 0);
    let first = fs::read(&mesh).unwrap();
    run(tiny(&cloud, &mesh).arg("--resume").arg(&saved), 0);
    assert!(first == fs::read(&mesh).unwrap());
    fs::remove_file(&mesh).unwrap();
    let other = ["--set", "field.width=20", "--resume"];
    fails(tiny(&cloud, &mesh).args(other).arg(&saved), 3, &["a.checkpoint"]);
    let few = dir.text("few.xyz", "0 0 0\n1 0 0\n0 1 0\n0 0 1\n1 1 1\n");
    fails(tiny(&few, &mesh).arg("--resume").arg(&saved), 3, &["a.checkpoint"]);
    let bytes = fs::read(&saved).unwrap();
    let damaged = dir.text("damaged", &bytes[..bytes.len() - 9]);
    fails(tiny(&cloud, &mesh).arg("--resume").arg(&damaged), 3, &["damaged"]);
    fails(tiny(&cloud, &mesh).arg("--resume").arg(dir.path("none")), 3, &["none"]);
    assert!(!mesh.exists());
}

#[cfg(unix)]
#[test]
fn ctrl_c_writes_a_checkpoint_and_resuming_ends_in_the_same_bytes() {
    let dir = Dir::new("interrupt");
    let cloud = dir.cloud();
    let long = ["--set", "stages=12:250,16:50"];
    let straight = dir.path("straight.ply");
    run(tiny(&cloud, &straight).args(long), 0);

    let mesh = dir.path("mesh.ply");
    let mut child = piped(tiny(&cloud, &mesh).args(long));
    let mut stderr = child.stderr.take().unwrap();
    let mut text = String::new();
    while !text.contains("step ") {
        let mut byte = [0];
        assert_eq!(stderr.read(&mut byte).unwrap(), 1, "no step was reported: {text}");
        text.push(char::from(byte[0]));
    }
    let sent = Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap();
    assert!(sent.success());
    stderr.read_to_string(&mut text).unwrap();
    assert_eq!(child.wait().unwrap().code(), Some(130), "{text}");
    assert!(text.contains("--resume") && text.contains("interrupted: "), "{text}");
    assert_eq!(dir.names(), ["cloud.ply", "mesh.ply.checkpoint", "straight.ply"]);

    let saved = dir.path("mesh.ply.checkpoint");
    let output = run(tiny(&cloud, &mesh).args(long).arg("--resume").arg(&saved), 0);
    assert!(err(&output).contains("going on after step"), "{}", err(&output));
    assert!(fs::read(&straight).unwrap() == fs::read(&mesh).unwrap());
}

#[test]
fn the_demo_writes_its_files_and_numbers() {
    let dir = Dir::new("demo");
    let demo = dir.path("demo");
    let mut command = program();
    command.args([
        "demo",
        "--shape",
        "sphere",
        "-n",
        "60",
        "--noise",
        "0.001",
        "--resolution",
        "20",
        "--json",
    ]);
    TINY.iter().for_each(|option| {
        command.args(["--set", option]);
    });
    // A start near the truth: points far from a surface are slow to measure.
    command.args(["--set", "start.shape=gauss", "--set", "start.steps=60"]);
    let output = run(command.arg("--out").arg(&demo), 0);
    let json = parse(&out(&output));
    assert_eq!(json.at("points").number(), 60.0);
    let part = |name: &str| json.at("evaluation").at(name).at("cd_l1").number();
    assert!(part("metrics") > part("floor") && part("floor") > 0.0);
    for file in ["cloud", "output", "truth", "preview"] {
        assert!(Path::new(json.at(file).text()).starts_with(&demo));
        assert!(fs::metadata(json.at(file).text()).unwrap().len() > 500);
    }
}
