//! `suite` of the built program: two small shapes, run, run again, damaged and run again.
#![cfg(feature = "cli")]

use std::fs;
use std::path::Path;
use std::process::{Child, Command};
use std::thread::sleep;
use std::time::{Duration, Instant};

use bijective_sdf::geometry::{AnalyticShape, TriangleMesh};
use bijective_sdf::io::{read_cloud, read_mesh, write_cloud, write_mesh};

// The tests of the other commands need the rest of it.
#[allow(dead_code)]
mod common;
use common::json::{Known, parse};
use common::{Dir, TINY, err, fails, out, program, run};
use serde_json::Value;

/// A closed box with the given sides.
fn cuboid(size: [f32; 3]) -> TriangleMesh {
    let verts = (0..8).map(|i| [0, 1, 2].map(|a| ((i >> a & 1) as f32 - 0.5) * size[a])).collect();
    let quads: [[u32; 4]; 6] =
        [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    let faces = quads.iter().flat_map(|q| [[q[0], q[1], q[2]], [q[0], q[2], q[3]]]).collect();
    TriangleMesh { verts, faces }
}

/// Two shapes with truths and one without.
fn data(dir: &Dir) -> std::path::PathBuf {
    let data = dir.path("data");
    for sub in ["in", "gt"] {
        fs::create_dir_all(data.join(sub)).unwrap();
    }
    write_mesh(data.join("gt/cube.ply"), &cuboid([0.8; 3])).unwrap();
    write_mesh(data.join("gt/cube_long.ply"), &cuboid([0.6, 0.6, 1.0])).unwrap();
    let clouds = [("cube_60", [0.8; 3]), ("cube_long_60", [0.6, 0.6, 1.0])];
    for (name, size) in clouds {
        let path = dir.path("box.ply");
        write_mesh(&path, &cuboid(size)).unwrap();
        let cloud = data.join(format!("in/{name}.xyz"));
        run(program().arg("sample").arg(&path).arg("-o").arg(cloud).args(["-n", "60"]), 0);
    }
    write_cloud(data.join("in/ball_60.ply"), &AnalyticShape::Sphere { radius: 0.5 }.sample(60, 1).0).unwrap();
    data
}

fn suite(data: &Path, to: &Path) -> Command {
    let mut command = program();
    command.arg("suite").arg(data).arg("--out").arg(to).args(["--resolution", "20", "--samples", "500"]);
    TINY.iter().for_each(|option| {
        command.args(["--set", option]);
    });
    command
}

fn lines(to: &Path) -> Vec<Value> {
    fs::read_to_string(to.join("runs.jsonl")).unwrap().lines().map(parse).collect()
}

#[test]
fn a_suite_is_run_once_and_goes_on_where_it_was_stopped() {
    let dir = Dir::new("suite");
    let (data, to) = (data(&dir), dir.path("out"));
    let file =
        dir.text("mine.toml", "[few]\nbsp.patch = 4\n[sampled]\npoints = 50\nnoise = \"0.5%\"\n[alike]\n");
    let mut command = suite(&data, &to);
    command.args(["--settings"]).arg(&file).args(["--setting", "few", "--setting", "sampled"]);
    command.args(["--setting", "default", "--setting", "alike", "--setting", "k_8"]);
    command.args(["--seeds", "3,5", "--jobs", "2", "--threads", "2"]);

    // Nothing is written before there is something to write.
    let dry = run(command.arg("--dry-run"), 0);
    assert!(
        out(&dry).contains("3 shapes, 5 settings") && out(&dry).contains("28 runs, 16 to make"),
        "{}",
        out(&dry)
    );
    assert!(!to.exists());

    let mut command = suite(&data, &to);
    command.args(["--settings"]).arg(&file).args(["--setting", "few", "--setting", "sampled"]);
    command.args(["--setting", "default", "--setting", "alike", "--setting", "k_8"]);
    command.args(["--seeds", "3,5", "--jobs", "2", "--threads", "2"]);
    let first = run(&mut command, 0);
    assert!(err(&first).contains("16/16"), "{}", err(&first));
    let made = lines(&to);
    // Three shapes, two of which can be sampled, and two seeds; two settings are the same as another.
    assert_eq!(made.len(), 2 * (3 + 2 + 3));
    for line in &made {
        assert_eq!(line.at("status").text(), "ok", "{line:?}");
        assert!(line.at("seconds").number() > 0.0 && line.at("threads").number() == 1.0);
        let mesh = read_mesh(to.join(line.at("mesh").text())).unwrap();
        assert_eq!(line.at("result_topology").at("faces").number(), mesh.faces.len() as f64);
        let surface = read_cloud(to.join(line.at("surface").text())).unwrap().points;
        assert_eq!(line.at("coverage").at("surface_points").number(), surface.len() as f64);
        assert!(line.at("coverage").at("mean_code").number() >= 0.0);
        match line.at("shape").text() {
            "ball_60" => {
                assert_eq!((line.at("truth"), line.at("report")), (&Value::Null, &Value::Null));
                assert_eq!(line.at("truth_coverage"), &Value::Null);
            }
            name => {
                // The cloud was drawn with the seed of the comparison, and is still not among its samples.
                let covered = line.at("truth_coverage");
                for key in ["q_to_truth", "truth_to_q", "s_to_truth", "truth_to_s", "floor"] {
                    assert!(covered.at(key).number() > 0.0, "{key}: {covered}");
                }
                assert_eq!(line.at("truth").text(), name.trim_end_matches("_60"));
                assert!(line.at("report").at("metrics").at("cd_l1").number() > 0.0);
                assert!(line.at("report").at("floor").at("cd_l1").number() > 0.0);
                assert_eq!(line.at("truth_topology").at("genus").number(), 0.0);
            }
        }
        let sampled = line.at("setting").text() == "sampled";
        assert_eq!(line.at("points").number(), if sampled { 50.0 } else { 60.0 });
        assert_eq!(*line.at("input").at("noise") == Value::Null, !sampled);
        let patch = if line.at("setting").text() == "few" { "4" } else { "10" };
        assert_eq!(line.at("options").at("bsp.patch").text(), patch);
    }
    let table = out(&first);
    for row in ["| few ", "| sampled ", "| default ", "| alike (= default) ", "| k_8 (= default) "] {
        assert!(table.contains(row), "{row}: {table}");
    }
    assert!(table.contains("| mean code |"), "{table}");
    let read = |name: &str| fs::read_to_string(to.join(name)).unwrap();
    assert_eq!(read("surface.csv").lines().count(), 6);
    assert!(read("table.md").contains(&table) && read("table.tex").contains("\\begin{tabular}"));
    assert_eq!((read("table.csv").lines().count(), read("shapes.csv").lines().count()), (6, 4));
    for setting in ["few", "sampled", "default"] {
        let png = fs::read(to.join(format!("sheet_{setting}.png"))).unwrap();
        assert_eq!(&png[1..4], b"PNG");
    }
    assert!(!to.join("sheet_k_8.png").exists());

    // Again: nothing to do, the same table. Pictures take a while.
    command.arg("--no-sheets");
    let before = fs::read(to.join("runs.jsonl")).unwrap();
    let again = run(&mut command, 0);
    assert_eq!(out(&again), table);
    assert!(err(&again).contains("28 runs, 0 to make"), "{}", err(&again));
    assert_eq!(fs::read(to.join("runs.jsonl")).unwrap(), before);

    // Killed while it wrote the last line: that run only is made again, and comes out the same.
    fs::write(to.join("runs.jsonl"), &before[..before.len() - 30]).unwrap();
    let third = run(&mut command, 0);
    assert!(
        err(&third).contains("dropped the last line") && err(&third).contains("1 to make"),
        "{}",
        err(&third)
    );
    let (old, new) = (made.last().unwrap(), lines(&to));
    assert_eq!(new.len(), made.len());
    for key in ["fingerprint", "report", "result_topology"] {
        assert_eq!(new.last().unwrap().at(key), old.at(key));
    }

    // Lines of a build that had no figures of S are read, too.
    let whole = fs::read_to_string(to.join("runs.jsonl")).unwrap();
    let old = |line: &str| {
        let mut line = parse(line);
        for key in ["surface", "coverage", "truth_coverage"] {
            line.as_object_mut().unwrap().remove(key).unwrap();
        }
        format!("{line}\n")
    };
    fs::write(to.join("runs.jsonl"), whole.lines().map(old).collect::<String>()).unwrap();
    let fourth = run(&mut command, 0);
    assert!(err(&fourth).contains("28 runs, 0 to make") && !out(&fourth).contains("mean code"));
    // Not that of the first: the run that was made again took its own time.
    assert!(out(&third).starts_with(&out(&fourth)));
    fs::write(to.join("runs.jsonl"), whole).unwrap();

    // A changed cloud is another input.
    run(
        program()
            .args(["sample", "-n", "60", "--seed", "9"])
            .arg(dir.path("box.ply"))
            .arg("-o")
            .arg(data.join("in/cube_long_60.xyz")),
        0,
    );
    let changed = run(&mut command, 0);
    assert!(err(&changed).contains("4 to make"), "{}", err(&changed));
}

#[test]
fn runs_that_fail_are_results_too_and_the_number_of_threads_changes_nothing() {
    let dir = Dir::new("suite-failing");
    let data = data(&dir);
    fs::write(data.join("in/flat.xyz"), "0 0 0\n1 0 0\n0 1 0\n1 1 0\n3 4 0\n").unwrap();
    let (one, two) = (dir.path("one"), dir.path("two"));
    let args = ["--shapes", "cube,flat", "--no-sheets", "--quiet"];
    // The other runs are made, and the exit code is that of the failure.
    let output = run(suite(&data, &one).args(args).args(["--jobs", "1", "--threads", "2"]), 3);
    let told = "error: 1 of 2 runs failed, the last of them default flat seed 0: ";
    assert!(err(&output).starts_with(told) && err(&output).lines().count() == 1, "{}", err(&output));
    assert!(out(&output).contains("| default "), "{}", out(&output));
    run(suite(&data, &two).args(args).args(["--jobs", "3", "--threads", "1"]), 3);
    let by_shape =
        |to: &Path, shape: &str| lines(to).into_iter().find(|l| l.at("shape").text() == shape).unwrap();
    let flat = by_shape(&one, "flat");
    assert_eq!(flat.at("status").text(), "failed");
    assert!(flat.at("message").text().contains("in one plane") && *flat.at("mesh") == Value::Null);
    for key in ["fingerprint", "report", "result_topology"] {
        assert_eq!(by_shape(&one, "cube_60").at(key), by_shape(&two, "cube_60").at(key));
    }
    let mesh = |to: &Path| fs::read(to.join(by_shape(to, "cube_60").at("mesh").text())).unwrap();
    assert_eq!(mesh(&one), mesh(&two));
    // They are made again only if that is asked for.
    for (retry, made) in [(&[][..], "0 to make"), (&["--retry"], "1 to make")] {
        let again = run(suite(&data, &one).args(&args[..3]).args(retry), 3);
        assert!(err(&again).contains(made), "{}", err(&again));
    }
    // Those that are not asked for do not count.
    run(suite(&data, &one).args(["--shapes", "cube", "--no-sheets"]), 0);
    run(suite(&data, &one).args(args), 3);
    assert_eq!(lines(&one).len(), 3);
    let table = fs::read_to_string(one.join("table.md")).unwrap();
    assert!(table.contains("- **flat**, seed 0: ") && table.contains("in one plane"), "{table}");
}

#[test]
fn other_options_do_not_replace_the_meshes_of_earlier_runs() {
    let dir = Dir::new("suite-options");
    let (data, to) = (data(&dir), dir.path("out"));
    let args = ["--shapes", "cube", "--no-sheets", "--quiet"];
    run(suite(&data, &to).args(args), 0);
    let meshes = || -> Vec<Vec<u8>> {
        lines(&to).iter().map(|line| fs::read(to.join(line.at("mesh").text())).unwrap()).collect()
    };
    let first = meshes();
    run(suite(&data, &to).args(args).args(["--set", "bsp.patch=3"]), 0);
    let both = meshes();
    assert_eq!((both.len(), &both[0]), (2, &first[0]));
    assert_ne!(both[0], both[1]);
    run(suite(&data, &to).args(args), 0);
    assert_eq!(meshes(), both);
}

#[test]
fn results_beside_the_shapes_are_not_taken_for_shapes() {
    let dir = Dir::new("suite-flat");
    let flat = dir.path("flat");
    fs::create_dir(&flat).unwrap();
    write_mesh(flat.join("cube.ply"), &cuboid([0.8; 3])).unwrap();
    let cloud = flat.join("cube_60.xyz");
    run(program().arg("sample").arg(flat.join("cube.ply")).arg("-o").arg(cloud).args(["-n", "60"]), 0);
    let first = run(&mut suite(&flat, &flat), 0);
    assert!(flat.join("shapes.csv").exists() && err(&first).contains("1 shapes"), "{}", err(&first));
    let again = run(&mut suite(&flat, &flat), 0);
    assert!(err(&again).contains("1 runs, 0 to make"), "{}", err(&again));
    assert_eq!(out(&again), out(&first));
}

/// A process that ends with the test, also if that fails.
struct Ends(Child);

impl Drop for Ends {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

#[test]
fn one_suite_at_a_time_writes_to_a_directory() {
    let dir = Dir::new("suite-lock");
    let (data, to) = (data(&dir), dir.path("out"));
    let lock = to.join(".runs.jsonl.lock");
    let wanted = ["--shapes", "ball_60", "--no-sheets"];
    // Steps enough for the second to come in between.
    let mut long = suite(&data, &to);
    long.args(wanted).args(["--quiet", "--set", "stages=12:1000000"]);
    let mut first = Ends(long.spawn().unwrap());
    let began = Instant::now();
    let owner = format!("{}\n", first.0.id());
    while fs::read_to_string(&lock).ok().as_ref() != Some(&owner) {
        assert!(began.elapsed() < Duration::from_secs(60) && first.0.try_wait().unwrap().is_none());
        sleep(Duration::from_millis(5));
    }
    let parts = ["another run", owner.trim(), "runs.jsonl", "--out"];
    fails(suite(&data, &to).args(wanted).arg("--quiet"), 1, &parts);
    // What there is may be looked at, and other results are made.
    run(suite(&data, &to).args(wanted).arg("--dry-run"), 0);
    run(suite(&data, &dir.path("other")).args(wanted), 0);
    // It ends with the process, however that ends.
    first.0.kill().unwrap();
    first.0.wait().unwrap();
    assert!(lock.exists());
    run(suite(&data, &to).args(wanted), 0);
    assert!(!lock.exists() && lines(&to).len() == 1);
}

#[test]
fn wrong_wishes_are_refused_before_any_work() {
    let dir = Dir::new("suite-usage");
    let (data, to) = (data(&dir), dir.path("out"));
    fails(suite(&data, &to).args(["--setting", "best"]), 2, &["best", "sparse"]);
    fails(suite(&data, &to).args(["--set", "field.widht=3"]), 2, &["did you mean"]);
    fails(suite(&data, &to).args(["--set", "seed=4"]), 2, &["--set seed=4", "--seeds 4,"]);
    fails(suite(&data, &to).args(["--set", " seed = 4"]), 2, &["--seeds 4,"]);
    fails(suite(&data, &to).args(["--shapes", "dog"]), 2, &["dog"]);
    fails(suite(&data, &to).args(["--inputs", "dog*"]), 3, &["no point cloud", "dog*"]);
    fails(&mut suite(&dir.path("none"), &to), 3, &["none"]);
    run(suite(&data, &to).args(["--seeds", "0"]), 2);
    fs::create_dir_all(&to).unwrap();
    for name in ["table.csv", "sheet_mine.png"] {
        let file = to.join(name);
        fs::write(&file, "[mine]\n").unwrap();
        fails(suite(&data, &to).arg("--settings").arg(&file), 2, &["--out", name, "overwrite"]);
        assert_eq!(fs::read_to_string(file).unwrap(), "[mine]\n");
    }
    fs::write(to.join("runs.jsonl"), "{}\n").unwrap();
    fails(&mut suite(&data, &to), 3, &["runs.jsonl:1", "remove the line"]);
}
