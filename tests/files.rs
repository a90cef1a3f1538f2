//! The built program and its files: what is kept when something fails, who may write what, and what is told of files.
#![cfg(feature = "cli")]

use std::fs;
use std::io::Read;
use std::path::Path;
use std::process::{Child, Command};

use bijective_sdf::geometry::AnalyticShape;
use bijective_sdf::io::{ReadOptions, read_cloud, read_cloud_with, read_mesh, write_cloud};

#[allow(dead_code)]
mod common;
use common::json::{Known, parse};
use common::{Dir, err, fails, out, piped, program, run, tiny};

/// What the program says until it has made a step.
#[cfg(unix)]
fn until_a_step(child: &mut Child) -> String {
    let stderr = child.stderr.as_mut().unwrap();
    let mut text = String::new();
    while !text.contains("step ") {
        let mut byte = [0];
        assert_eq!(stderr.read(&mut byte).unwrap(), 1, "no step was reported: {text}");
        text.push(char::from(byte[0]));
    }
    text
}

#[cfg(unix)]
fn send(signal: &str, child: &Child) {
    assert!(Command::new("kill").args([signal, &child.id().to_string()]).status().unwrap().success());
}

/// A run of some seconds, started by a shell that does something first.
#[cfg(unix)]
fn long_after(first: &str, cloud: &Path, mesh: &Path, more: &[&str]) -> Command {
    let long = tiny(cloud, mesh);
    let mut command = Command::new("sh");
    command.arg("-c").arg(format!("{first} exec \"$@\"")).arg("sh").arg(long.get_program());
    command.args(long.get_args()).args(["--set", "stages=12:400"]).args(more);
    command
}

#[cfg(unix)]
#[test]
fn who_was_started_to_ignore_a_hang_up_ignores_it() {
    let dir = Dir::new("hup");
    let (cloud, mesh) = (dir.cloud(), dir.path("mesh.ply"));
    // These tests may run under nohup themselves, and no shell can take that back.
    let inherited = Command::new("sh").args(["-c", "kill -HUP $$"]).status().unwrap().success();
    for (first, code) in [("trap '' HUP;", 0), ("", if inherited { 0 } else { 130 })] {
        let mut child = piped(&mut long_after(first, &cloud, &mesh, &[]));
        let mut text = until_a_step(&mut child);
        send("-HUP", &child);
        child.stderr.take().unwrap().read_to_string(&mut text).unwrap();
        assert_eq!(child.wait().unwrap().code(), Some(code), "{text}");
    }
}

#[cfg(unix)]
#[test]
fn a_killed_run_locks_nothing_and_what_it_left_is_cleared_away() {
    let dir = Dir::new("kill");
    let (cloud, mesh, saved) = (dir.cloud(), dir.path("mesh.ply"), dir.path("run.checkpoint"));
    let checkpoint = ["--checkpoint", saved.to_str().unwrap(), "--checkpoint-every", "0"];
    let mut child = piped(&mut long_after("", &cloud, &mesh, &checkpoint));
    until_a_step(&mut child);
    let mut second = tiny(&cloud, &dir.path("other.ply"));
    fails(second.arg("--checkpoint").arg(&saved), 1, &["run.checkpoint", "another run", "--checkpoint"]);
    // Another file is another matter.
    run(tiny(&cloud, &dir.path("other.ply")).arg("--checkpoint").arg(dir.path("other.checkpoint")), 0);
    send("-KILL", &child);
    child.wait().unwrap();
    dir.text(".run.checkpoint.4711-0.tmp", "half of one");
    let output = run(tiny(&cloud, &mesh).args(["--set", "stages=12:400"]).args(checkpoint), 0);
    assert!(read_mesh(&mesh).unwrap().topology().closed, "{}", err(&output));
    let wanted = ["cloud.ply", "mesh.ply", "other.checkpoint", "other.ply", "run.checkpoint"];
    assert_eq!(dir.names(), wanted);
}

#[cfg(unix)]
#[test]
fn a_mesh_that_fails_leaves_the_field_and_every_failure_is_told() {
    let dir = Dir::new("fail");
    let cloud = dir.cloud();
    fs::create_dir(dir.path("gone")).unwrap();
    let mesh = dir.path("gone/mesh.ply");
    // The disk is full where the checkpoint and the picture go.
    let mut command = tiny(&cloud, &dir.path("mesh.ply"));
    command.args(["--checkpoint", "/dev/full", "--surface-points"]).arg(dir.path("s.ply"));
    let output = run(&mut command, 1);
    let text = err(&output);
    assert!(text.contains("error: /dev/full") && text.contains("note: written: "), "{text}");
    assert!(read_mesh(dir.path("mesh.ply")).is_ok() && read_cloud(dir.path("s.ply")).is_ok());
    assert!(!dir.path("mesh.ply.field").exists());
    // The directory of the mesh goes while the run is under way, that of the field stays.
    let field = dir.path("kept.field");
    let save = ["--save-field", field.to_str().unwrap()];
    let mut child = piped(&mut long_after("", &cloud, &mesh, &save));
    let mut text = until_a_step(&mut child);
    fs::remove_dir(dir.path("gone")).unwrap();
    child.stderr.take().unwrap().read_to_string(&mut text).unwrap();
    assert_eq!(child.wait().unwrap().code(), Some(1), "{text}");
    assert!(text.contains("kept.field; go on with `bijective-sdf mesh "), "{text}");
    run(
        program().arg("mesh").arg(&field).arg("-o").arg(dir.path("again.ply")).args(["--resolution", "20"]),
        0,
    );
    assert!(read_mesh(dir.path("again.ply")).unwrap().topology().closed);
}

#[test]
fn a_resumed_run_needs_no_options_and_refuses_others() {
    let dir = Dir::new("resume");
    let (cloud, mesh, saved) = (dir.cloud(), dir.path("mesh.ply"), dir.path("run.checkpoint"));
    run(tiny(&cloud, &mesh).args(["--seed", "4", "--checkpoint"]).arg(&saved), 0);
    let first = fs::read(&mesh).unwrap();
    let resume = |args: &[&str]| {
        let mut command = program();
        command.arg("reconstruct").arg(&cloud).arg("-o").arg(&mesh).args(["--resolution", "20", "--resume"]);
        command.arg(&saved).args(args);
        command
    };
    run(&mut resume(&[]), 0);
    assert!(first == fs::read(&mesh).unwrap());
    run(&mut resume(&["--seed", "4", "--set", "field.width=16", "--set", "finish=none"]), 0);
    fails(&mut resume(&["--set", "min_component=0.5"]), 3, &["run.checkpoint", "min_component"]);
    fails(&mut resume(&["--seed", "5"]), 3, &["run.checkpoint", "seed"]);
    fails(&mut resume(&["--preset", "fast"]), 3, &["run.checkpoint", "option"]);
    let field = dir.path("a.field");
    run(tiny(&cloud, &mesh).arg("--save-field").arg(&field), 0);
    let mut command = tiny(&cloud, &mesh);
    fails(command.arg("--resume").arg(&field), 3, &["a.field", "not a checkpoint"]);
}

#[test]
fn a_large_cloud_keeps_its_first_shape_and_says_so() {
    let dir = Dir::new("large");
    let (cloud, mesh, surface) = (dir.cloud(), dir.path("mesh.ply"), dir.path("s.ply"));
    let points = read_cloud(&cloud).unwrap().points.len();
    let command = |limit: &str| {
        let mut command = tiny(&cloud, &mesh);
        command.args(["--set", "start.shape=plate", "--set", "start.steps=20"]);
        command.args(["--json", "--set", &format!("train_up_to={limit}")]);
        command
    };
    let below = (points - 1).to_string();
    let told = parse(&out(&run(command(&below).arg("--quiet"), 0)));
    assert_eq!(told.at("steps").number(), 0.0);
    assert!(out(&run(&mut command(&below), 0)).contains("nothing is trained for more than"));
    assert!(read_mesh(&mesh).unwrap().topology().closed);
    fails(command(&below).arg("--surface-points").arg(&surface), 2, &["train_up_to=all"]);
    for limit in [&points.to_string(), "all"] {
        let told = out(&run(command(limit).arg("--surface-points").arg(&surface), 0));
        assert!(parse(&told).at("steps").number() > 0.0 && !told.contains("nothing is trained"));
    }
    fails(&mut command("0"), 2, &["train_up_to", "1 to"]);
}

#[test]
fn fields_go_through_pipes_and_info_knows_what_was_saved() {
    let dir = Dir::new("saved");
    let (cloud, mesh, saved) = (dir.cloud(), dir.path("mesh.ply"), dir.path("run.checkpoint"));
    let mut command = tiny(&cloud, &mesh);
    let field = run(command.args(["--save-field", "-", "--checkpoint"]).arg(&saved), 0).stdout;
    let feed = |command: &mut Command| {
        use std::io::Write;
        let mut child = piped(command);
        child.stdin.take().unwrap().write_all(&field).unwrap();
        let output = child.wait_with_output().unwrap();
        assert_eq!(output.status.code(), Some(0), "{}", err(&output));
        output
    };
    let again = dir.path("again.ply");
    feed(program().args(["mesh", "-", "--resolution", "20", "-o"]).arg(&again));
    assert!(fs::read(&mesh).unwrap() == fs::read(&again).unwrap());
    assert_eq!(out(&feed(program().args(["sdf", "-"]).arg(&cloud))).lines().count(), 60);
    fails(program().args(["sdf", "-", "-"]), 2, &["standard input"]);
    let json = parse(&out(&feed(program().args(["info", "-", "--json"]))));
    assert_eq!((json.at("kind").text(), json.at("points").number()), ("field", 60.0));
    let json = parse(&out(&run(program().arg("info").arg(&saved).arg("--json"), 0)));
    assert_eq!((json.at("kind").text(), json.at("steps").number()), ("checkpoint", 23.0));
    assert_eq!(json.at("options").at("field.width").text(), "16");
    let text = out(&run(program().arg("info").arg(&saved), 0));
    assert!(text.starts_with("checkpoint\n") && text.contains("steps       23 of 23"), "{text}");
    let bytes = fs::read(&saved).unwrap();
    let cut = dir.text("cut", &bytes[..bytes.len() - 1]);
    fails(program().arg("info").arg(&cut), 3, &["cut", "damaged"]);
}

#[test]
fn info_repeats_the_reader_and_counts_duplicates() {
    let dir = Dir::new("info");
    let header =
        "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\nproperty float z\n";
    let broken = dir.text("broken.ply", format!("{header}end_header\n0 0 0\n1 zero 0\n"));
    fails(program().arg("info").arg(&broken), 3, &["broken.ply:9: vertex 1", "is not a number"]);
    fails(&mut tiny(&broken, &dir.path("mesh.ply")), 3, &["broken.ply:9: vertex 1", "is not a number"]);
    let few = dir.text("few.xyz", "0 0 0\n1 0 0\n0 0 0\n-0 0 0\n1 0 0\n");
    let json = parse(&out(&run(program().arg("info").arg(&few).arg("--json"), 0)));
    assert_eq!((json.at("points").number(), json.at("duplicates").number()), (5.0, 3.0));
    let longer = dir.text("longer.ply", format!("{header}end_header\n0 0 0\n1 0 0\n2 0 0\n"));
    assert!(err(&run(program().arg("info").arg(&longer), 0)).contains("1 lines behind the last element"));
}

#[test]
fn what_makes_no_sense_is_refused_before_any_work() {
    let dir = Dir::new("sense");
    let (cloud, mesh) = (dir.cloud(), dir.path("mesh.ply"));
    fails(program().args(["presets", "--threads", "100000"]), 2, &["--threads 100000", "at most"]);
    fails(tiny(&cloud, &mesh).args(["--preview", "a.jpg"]), 2, &["a.jpg", "png"]);
    fails(tiny(&cloud, &mesh).args(["--time-limit", "-5"]), 2, &["--time-limit", "seconds"]);
    let output = run(program().args(["demo", "--noise", "-1"]), 2);
    assert!(err(&output).contains("at least 0"), "{}", err(&output));
    // 2,048 layers of width do not fit in anything.
    let huge = ["--set", "stages=1024:1", "--set", "field.width=65536"];
    assert!([2, 3].contains(&tiny(&cloud, &mesh).args(huge).output().unwrap().status.code().unwrap()));
    assert_eq!(dir.names(), ["cloud.ply"]);
}

#[test]
fn shells_and_manuals_are_served() {
    for shell in ["bash", "zsh", "fish"] {
        let script = out(&run(program().args(["completions", shell]), 0));
        assert!(script.contains("reconstruct") && script.contains("save-field"), "{shell}");
    }
    run(program().args(["completions", "dos"]), 2);
    let page = out(&run(program().arg("man"), 0));
    assert!(page.contains(".TH bijective-sdf 1") && page.contains("bijective\\-sdf\\-reconstruct"), "{page}");
}

#[test]
fn meshes_and_distances_go_to_programs_for_models_and_volumes() {
    let dir = Dir::new("models");
    let (cloud, mesh, field) = (dir.cloud(), dir.path("mesh.glb"), dir.path("a.field"));
    run(tiny(&cloud, &mesh).arg("--save-field").arg(&field), 0);
    assert_eq!(&fs::read(&mesh).unwrap()[..8], b"glTF\x02\0\0\0");
    fails(program().arg("info").arg(&mesh), 3, &["mesh.glb", "GLB"]);
    let sdf = |name: &str| {
        let path = dir.path(name);
        let mut command = program();
        run(command.arg("sdf").arg(&field).args(["--grid", "12", "-o"]).arg(&path), 0);
        fs::read(path).unwrap()
    };
    assert!(sdf("a.npy").starts_with(b"\x93NUMPY"));
    assert!(sdf("a.nrrd").starts_with(b"NRRD0004\n") && sdf("a.vti").starts_with(b"<?xml"));
    fails(program().arg("sdf").arg(&field).args(["--grid", "12", "-o", "a.raw"]), 2, &["npy, nrrd, vti"]);
    run(program().arg("sdf").arg(&field), 2);
}

#[test]
fn a_trimmed_mesh_is_open_where_no_point_was() {
    let dir = Dir::new("trim");
    let below: Vec<[f32; 3]> =
        AnalyticShape::Sphere { radius: 0.5 }.sample(300, 1).0.into_iter().filter(|p| p[2] < 0.1).collect();
    let (cloud, mesh, field) = (dir.path("bowl.ply"), dir.path("mesh.ply"), dir.path("a.field"));
    write_cloud(&cloud, &below).unwrap();
    let whole = |mesh: &Path| {
        let mut command = program();
        command.arg("reconstruct").arg(&cloud).arg("-o").arg(mesh).args(["--preset", "start", "--json"]);
        command.args(["--resolution", "32"]);
        command
    };
    let json = parse(&out(&run(whole(&mesh).arg("--save-field").arg(&field).arg("--trim"), 0)));
    let removed = json.at("trim").at("removed").number();
    assert!((0.05..0.6).contains(&removed), "{removed}");
    assert!(!json.at("mesh").at("closed").truth() && json.at("mesh").at("boundary_loops").number() == 1.0);
    let again = dir.path("again.ply");
    run(program().arg("mesh").arg(&field).arg("-o").arg(&again).args(["--resolution", "32", "--trim=1"]), 0);
    assert!(fs::read(&mesh).unwrap() == fs::read(&again).unwrap());
    assert!(parse(&out(&run(&mut whole(&mesh), 0))).at("mesh").at("closed").truth());
    fails(whole(&mesh).arg("--trim=0"), 2, &["--trim", "above 0"]);
    // What is kept says how to go on with the same options.
    let output = run(whole(&dir.path("none.ply")).arg("--trim=1e-6"), 1);
    assert!(err(&output).contains("none.ply --resolution 32 --trim=0.000001`"), "{}", err(&output));
    assert!(!dir.path("none.ply").exists() && dir.path("none.ply.field").exists());
}

#[test]
fn vertices_take_what_the_nearest_point_that_was_kept_has() {
    let dir = Dir::new("carry");
    let points = AnalyticShape::Sphere { radius: 0.5 }.sample(120, 1).0;
    // The first point comes twice, with another class the second time, and a stray is left out: neither may shift what
    // the others have.
    let mut rows: Vec<([f32; 3], usize)> = points.iter().copied().zip(0..).collect();
    rows.insert(5, ([3.0, -2.0, 2.5], 999));
    rows.insert(9, (points[0], 888));
    rows.push(([f32::NAN, 0.0, 0.0], 777));
    let mut text = String::from("x,y,z,class,r,g,b,note\n");
    for ([x, y, z], i) in rows {
        text += &format!("{x},{y},{z},{},{},{},7,wall\n", 1000 + i, i % 256, i * 3 % 256);
    }
    let cloud = dir.text("cloud.csv", text);
    let whole = |mesh: &Path| {
        let mut command = program();
        command.arg("reconstruct").arg(&cloud).arg("-o").arg(mesh).args(["--preset", "start", "--json"]);
        command.args(["--resolution", "24", "--carry"]);
        command
    };
    let (mesh, field) = (dir.path("mesh.ply"), dir.path("a.field"));
    let output = run(whole(&mesh).arg("--support").arg("--save-field").arg(&field), 0);
    assert!(err(&output).contains("\"note\" hold no numbers"), "{}", err(&output));
    let json = parse(&out(&output));
    assert_eq!(json.at("carried").to_string(), r#"["class","red","green","blue"]"#);
    assert_eq!(json.at("strays").as_array().unwrap().len(), 1);
    let read = |path: &Path| {
        let mut options = ReadOptions::default();
        options.attributes = true;
        read_cloud_with(&fs::read(path).unwrap(), &options).unwrap()
    };
    let got = read(&mesh);
    let names: Vec<&str> = got.attributes.iter().map(|a| a.name.as_str()).collect();
    assert_eq!(names, ["support", "class", "red", "green", "blue"]);
    for (v, p) in got.points.iter().enumerate() {
        let far = |q: &[f32; 3]| (0..3).map(|a| (p[a] - f64::from(q[a])).powi(2)).sum::<f64>();
        let near = (0..120).min_by(|&i, &j| far(&points[i]).total_cmp(&far(&points[j]))).unwrap();
        let values: Vec<f64> = got.attributes[1..].iter().map(|a| a.values[v]).collect();
        assert_eq!(values, [1000 + near, near, near * 3 % 256, 7].map(|x| x as f64), "vertex {v}");
        // The surface spacing of 120 points on this sphere is about 0.16.
        let support = got.attributes[0].values[v];
        let distance = far(&points[near]).sqrt();
        assert!((0.08 * support..=0.4 * support).contains(&distance), "{support} at {distance}");
    }
    // The same from the field; without strays, as these are far off.
    let again = dir.path("again.ply");
    let mut command = program();
    command.arg("mesh").arg(&field).arg("-o").arg(&again).args(["--resolution", "24", "--support"]);
    run(command.arg("--carry").arg(&cloud), 0);
    assert!(fs::read(&mesh).unwrap() == fs::read(&again).unwrap());
    // What a format has no place for is told.
    let output = run(&mut whole(&dir.path("mesh.obj")), 0);
    assert!(err(&output).contains("warning: obj files hold colours only: not carried are class"));
    let line = fs::read_to_string(dir.path("mesh.obj")).unwrap();
    assert_eq!(line.lines().next().unwrap().split(' ').count(), 7);
    fails(&mut whole(&dir.path("mesh.stl")), 2, &["--carry", "stl", "write ply"]);
    fails(whole(&dir.path("mesh.glb")).arg("--support"), 2, &["--support", "glb", "write ply"]);
    let plain = dir.text(
        "plain.csv",
        points.iter().map(|p| format!("{p:?}\n").replace(['[', ']'], "")).collect::<String>(),
    );
    let mut command = program();
    command.arg("reconstruct").arg(&plain).arg("-o").arg(&mesh).args(["--preset", "start", "--carry"]);
    let output = run(command.args(["--quiet", "--resolution", "24"]), 0);
    assert!(err(&output).contains("warning: nothing is carried"), "{}", err(&output));
}
