//! The built program on files as other programs write them: read rightly, or refused with what to do.
#![cfg(feature = "cli")]

use std::fs;
use std::path::{Path, PathBuf};

use bijective_sdf::geometry::AnalyticShape;
use bijective_sdf::io::{read_cloud, read_mesh, write_cloud};

#[allow(dead_code)]
mod common;
use common::json::{Known, parse};
use common::{Dir, err, fails, out, program, run, tiny};
use serde_json::Value;

/// 60 points on a torus.
fn torus() -> Vec<[f32; 3]> {
    AnalyticShape::Torus { major: 1.0, minor: 0.4 }.sample(60, 1).0
}

/// A file with a line for each point of the torus.
fn file(dir: &Dir, name: &str, head: &str, row: impl Fn(usize, [f32; 3]) -> String) -> PathBuf {
    let rows: String = torus().iter().enumerate().map(|(i, p)| row(i, *p) + "\n").collect();
    dir.text(name, format!("{head}{rows}"))
}

/// What `info` says in JSON.
#[track_caller]
fn info(path: &Path, args: &[&str]) -> Value {
    parse(&out(&run(program().arg("info").arg(path).args(["--json", "--quiet"]).args(args), 0)))
}

/// Checks that `info` finds the torus.
#[track_caller]
fn is_torus(json: &Value) {
    assert_eq!(json.at("points").number(), 60.0, "{json}");
    let bounds = json.at("bounds").as_array().unwrap().clone();
    let points = torus();
    for axis in 0..3 {
        let low = points.iter().map(|p| p[axis]).fold(f32::MAX, f32::min);
        let high = points.iter().map(|p| p[axis]).fold(f32::MIN, f32::max);
        for (bound, wanted) in bounds.iter().zip([low, high]) {
            assert!((bound[axis].number() - f64::from(wanted)).abs() < 1e-4, "{json}");
        }
    }
}

#[test]
fn names_of_columns_are_followed_and_other_columns_can_be_given() {
    let dir = Dir::new("columns");
    let colmap =
        file(&dir, "points3D.txt", "# one line a point:\n#   ID, X, Y, Z, R, TRACK[] as (A, B)\n", |i, p| {
            format!("{} {} {} {} 7 {}", 900 - i, p[0], p[1], p[2], "1 2 ".repeat(i % 3))
        });
    is_torus(&info(&colmap, &[]));
    let survey = file(&dir, "survey.csv", "Point,Northing,Easting,Elevation\n", |i, p| {
        format!("{},{},{},{}", i + 1, p[1], p[0], p[2])
    });
    is_torus(&info(&survey, &[]));
    let bare = file(&dir, "bare.txt", "", |i, p| format!("{},{},{},{},TREE", i + 1, p[1], p[0], p[2]));
    fails(program().arg("info").arg(&bare), 3, &["bare.txt", "counts up by one from 1", "--columns 2,3,4"]);
    is_torus(&info(&bare, &["--columns", "3,2,4"]));
    fails(&mut tiny(&bare, &dir.path("mesh.ply")), 3, &["--columns"]);
    let assumed = info(&bare, &["--assume"]);
    assert_eq!(assumed.at("bounds")[1][0].number(), 60.0);
    let odd = file(&dir, "odd.txt", "made by hand\n\n", |i, p| format!("{}:{}:{}:{i}", p[0], p[1], p[2]));
    is_torus(&info(&odd, &["--delimiter", ":", "--skip", "1"]));
    let named = file(&dir, "named.csv", "t,a,b,c\n", |i, p| format!("{i},{},{},{}", p[0], p[1], p[2]));
    fails(program().arg("info").arg(&named), 3, &["\"t\", \"a\", \"b\", \"c\"", "--columns"]);
    is_torus(&info(&named, &["--columns", "a,b,c"]));
    let globe = dir.text("globe.csv", "lon,lat,alt\n13.4,52.5,30\n");
    fails(program().arg("info").arg(&globe), 3, &["project the points"]);
    for bad in [["--columns", "1,2"], ["--delimiter", "ab"], ["--raw", "f32x2"]] {
        run(program().arg("info").arg(&bare).args(bad), 2);
    }
}

#[test]
fn the_order_of_rows_changes_neither_strays_nor_sides_nor_what_is_carried() {
    let dir = Dir::new("shuffled");
    let (points, normals) = AnalyticShape::Torus { major: 1.0, minor: 0.4 }.sample(80, 1);
    let mut rows: Vec<String> = points
        .iter()
        .zip(&normals)
        .enumerate()
        .map(|(i, (p, n))| format!("{} {} {} {} {} {} {i}\n", p[0], p[1], p[2], n[0], n[1], n[2]))
        .collect();
    rows.push("9.5 -8.25 7.125 0 0 1 80\n".into());
    let head = "ply\nformat ascii 1.0\nelement vertex 81\nproperty float x\nproperty float y\nproperty float z\n\
                property float nx\nproperty float ny\nproperty float nz\nproperty ushort class\nend_header\n";
    let mesh = |name: &str, rows: &[String]| {
        let cloud = dir.text(&format!("{name}.ply"), format!("{head}{}", rows.concat()));
        let mesh = dir.path(&format!("{name}_mesh.ply"));
        let mut command = program();
        command.arg("reconstruct").arg(&cloud).arg("-o").arg(&mesh);
        command.args(["--preset", "start", "--normals", "use", "--carry", "--json", "--resolution", "32"]);
        let json = parse(&out(&run(&mut command, 0)));
        assert_eq!(json.at("strays").as_array().unwrap().len(), 1, "{json}");
        assert_eq!(json.at("sides").as_str(), Some("normals"), "{json}");
        fs::read(mesh).unwrap()
    };
    let first = mesh("first", &rows);
    rows.reverse();
    rows.swap(3, 60);
    rows.rotate_left(17);
    assert!(mesh("shuffled", &rows) == first);
    // The classes are in the mesh: other ones give another file.
    let renamed: Vec<String> = rows.iter().map(|row| row.replacen(" 12\n", " 13\n", 1)).collect();
    assert!(mesh("renamed", &renamed) != first);
}

#[test]
fn raw_rows_of_another_length_are_doubted() {
    let dir = Dir::new("raw");
    let rows: Vec<u8> = torus()
        .iter()
        .enumerate()
        .flat_map(|(i, p)| [p[0], p[1], p[2], (i * 37 % 60) as f32, (i % 32) as f32])
        .flat_map(f32::to_le_bytes)
        .collect();
    let scan = dir.text("scan.bin", rows);
    fails(program().arg("info").arg(&scan), 3, &["f32x5 (60 points)", "--raw f32x5"]);
    is_torus(&info(&scan, &["--raw", "f32x5"]));
    assert_eq!(info(&scan, &["--assume"]).at("points").number(), 75.0);
}

#[test]
fn an_input_is_never_overwritten_however_it_is_named() {
    let dir = Dir::new("over");
    let cloud = dir.cloud();
    let before = fs::read(&cloud).unwrap();
    let mesh = dir.mesh("box.ply", true);
    fs::create_dir(dir.path("sub")).unwrap();
    fs::hard_link(&cloud, dir.path("hard.ply")).unwrap();
    #[cfg(unix)]
    std::os::unix::fs::symlink(&cloud, dir.path("soft.ply")).unwrap();
    let names =
        ["./cloud.ply", "sub/../cloud.ply", "hard.ply"].into_iter().chain(cfg!(unix).then_some("soft.ply"));
    for name in names {
        let mut command = tiny(Path::new("cloud.ply"), Path::new(name));
        fails(command.current_dir(&dir.0), 2, &["--output", "overwrite the input"]);
        let mut command = tiny(Path::new(name), Path::new("mesh.ply"));
        command.args(["--checkpoint", "cloud.ply"]).current_dir(&dir.0);
        fails(&mut command, 2, &["--checkpoint", "overwrite the input"]);
    }
    // Two results in one file, one of them not there yet.
    let mut command = tiny(Path::new("cloud.ply"), Path::new("new.ply"));
    command.args(["--surface-points", "./new.ply"]).current_dir(&dir.0);
    fails(&mut command, 2, &["both"]);
    fails(program().arg("sample").arg(&mesh).arg("-o").arg(dir.path("sub/../box.ply")), 2, &["overwrite"]);
    assert!(fs::read(&cloud).unwrap() == before);
    // The options are an input, too.
    let options = dir.text("options.toml", "seed = 1\n");
    for option in ["--checkpoint", "--save-field"] {
        let mut command = tiny(&cloud, &dir.path("mesh.ply"));
        command.arg("--config").arg(&options).arg(option).arg(dir.path("./options.toml"));
        fails(&mut command, 2, &[option, "overwrite the input"]);
    }
    let file = dir.text("truth.ply", "seed = 1\n");
    let mut command = program();
    command.args(["demo", "--preset", "start", "--out"]).arg(&dir.0).arg("--config").arg(&file);
    fails(&mut command, 2, &["--out", "truth.ply"]);
    assert_eq!(
        fs::read_to_string(&options).unwrap() + &fs::read_to_string(&file).unwrap(),
        "seed = 1\nseed = 1\n"
    );
}

#[cfg(unix)]
#[test]
fn what_the_shell_gives_as_standard_input_is_not_overwritten() {
    let dir = Dir::new("over-stdin");
    let (cloud, mesh) = (dir.cloud(), dir.mesh("box.ply", true));
    let (field, other) = (dir.path("field.bin"), dir.path("other.ply"));
    run(tiny(&cloud, &other).arg("--save-field").arg(&field), 0);
    let files = [&cloud, &mesh, &field];
    let before = files.map(|file| fs::read(file).unwrap());
    std::os::unix::fs::symlink(&cloud, dir.path("soft.ply")).unwrap();
    let from = |mut command: std::process::Command, file: &Path| {
        command.stdin(fs::File::open(file).unwrap());
        command
    };
    let of = |words: &[&str], output: &Path| {
        let mut command = program();
        command.args(words).arg("-o").arg(output);
        command
    };
    let pipe = Path::new("-");
    let mut previewed = tiny(pipe, &other);
    let picture = dir.path("cloud.png");
    fs::hard_link(&cloud, &picture).unwrap();
    previewed.arg("--preview").arg(&picture);
    let mut at_points = program();
    at_points.arg("sdf").arg(&field).arg("-").arg("-o").arg(&cloud);
    for (command, file) in [
        (tiny(pipe, &cloud), &cloud),
        (tiny(pipe, &dir.path("soft.ply")), &cloud),
        (previewed, &cloud),
        (at_points, &cloud),
        (of(&["mesh", "-", "--output-format", "ply"], &field), &field),
        (of(&["sdf", "-", cloud.to_str().unwrap()], &field), &field),
        (of(&["sample", "-", "-n", "20"], &mesh), &mesh),
    ] {
        fails(&mut from(command, file), 2, &["overwrite the input"]);
    }
    assert!(files.map(|file| fs::read(file).unwrap()) == before);
    // Other files are written, and those that are there replaced.
    run(&mut from(tiny(pipe, &other), &cloud), 0);
    run(&mut from(of(&["sample", "-", "-n", "20"], &other), &mesh), 0);
}

#[test]
fn formats_are_told_by_content_and_others_are_named() {
    let dir = Dir::new("formats");
    let rows =
        |end: &str| torus().iter().map(|p| format!("{} {} {}{end}\n", p[0], p[1], p[2])).collect::<String>();
    let head =
        "VERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 60\nHEIGHT 1\nDATA ascii\n";
    let pose = "0 0 0\n1 0 0\n0 1 0\n0 0 1\n1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n";
    let cases = [
        ("a.xyz", format!("OFF\n60 0 0\n{}", rows(""))),
        ("b.off", format!("COFF\n60 0 0\n{}", rows(" 255 0 0 255"))),
        ("c.txt", format!("{head}{}", rows(""))),
        ("d.pts", format!("60\n1\n{pose}{}", rows(" 0.5"))),
        (
            "e",
            format!("# vtk DataFile Version 3.0\nt\nASCII\nDATASET POLYDATA\nPOINTS 60 float\n{}", rows("")),
        ),
    ];
    for (name, text) in cases {
        is_torus(&info(&dir.text(name, text), &[]));
    }
    let ply = dir.path("torus.ply");
    write_cloud(&ply, &torus()).unwrap();
    for name in ["f.stl", "g.xyz", "h.bin"] {
        fs::copy(&ply, dir.path(name)).unwrap();
        is_torus(&info(&dir.path(name), &[]));
    }
    for (name, bytes, part) in [
        ("a.glb", &b"glTF\x02\0\0\0"[..], "a GLB model"),
        ("b.dxf", b"  0\nSECTION\n  2\nHEADER\n", "a DXF drawing"),
        ("c.rcp", b"\x01\x02\x03", "ReCap"),
        ("d.xlsx", b"PK\x05\x06\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0", "zip archive"),
    ] {
        fails(program().arg("info").arg(dir.text(name, bytes)), 3, &[name, part, "; "]);
    }
    // A mesh as OFF, and back.
    let off = dir.path("mesh.off");
    run(&mut tiny(&ply, &off), 0);
    assert_eq!(parse(&out(&run(program().arg("info").arg(&off).arg("--json"), 0))).at("kind").text(), "mesh");
}

#[test]
fn what_is_left_out_is_told_even_when_quiet() {
    let dir = Dir::new("left");
    let fillers = file(&dir, "fillers.xyz", "", |i, p| match i % 10 {
        0 => format!("{} {} -9999", p[0], p[1]),
        1 => "nan nan nan".into(),
        _ => format!("{} {} {}", p[0], p[1], p[2]),
    });
    let json = info(&fillers, &[]);
    assert_eq!((json.at("points").number(), json.at("left_out").number()), (48.0, 12.0));
    let warnings = json.at("warnings").as_array().unwrap().clone();
    assert!(warnings[0].text().contains("left out 6 of 60 points: x, y or z is missing"));
    assert!(warnings[1].text().contains("a coordinate is -9999"));
    let output = run(tiny(&fillers, &dir.path("mesh.ply")).args(["--quiet", "--json"]), 0);
    let lines: Vec<String> = err(&output).lines().map(String::from).collect();
    assert!(
        lines.len() == 2 && lines.iter().all(|l| l.starts_with("warning: left out 6 of 60")),
        "{lines:?}"
    );
    let json = parse(&out(&output));
    assert_eq!((json.at("points").number(), json.at("left_out").number()), (48.0, 12.0));
    assert_eq!(json.at("warnings").as_array().unwrap().len(), 2);
    assert_eq!(json.at("notices").as_array().unwrap().len(), 0);
    // A distance is printed for every row, so none may be left out.
    let (cloud, field) = (dir.path("good.ply"), dir.path("field"));
    write_cloud(&cloud, &torus()).unwrap();
    run(tiny(&cloud, &dir.path("mesh.ply")).arg("--save-field").arg(&field), 0);
    fails(program().arg("sdf").arg(&field).arg(&fillers), 3, &["point 1", "not a finite"]);
    let far = dir.text("far.xyz", "0 0 0\n0 0 0\n0 0 0\n0.5 0.25 -9999\n");
    assert_eq!(out(&run(program().arg("sdf").arg(&field).arg(&far), 0)).lines().count(), 4);
    assert!(fs::metadata(&field).is_ok());
}

#[test]
fn map_coordinates_are_written_with_their_offset() {
    let dir = Dir::new("maps");
    let at = [450_123.4, 5_411_234.6, 320.0];
    let cloud = file(&dir, "map.xyz", "", |_, p| {
        let [x, y, z] = [0, 1, 2].map(|a| f64::from(p[a]) + at[a]);
        format!("{x} {y} {z}")
    });
    let json = info(&cloud, &[]);
    let offset: Vec<f64> = json.at("offset").as_array().unwrap().iter().map(Known::number).collect();
    assert!((0..3).all(|a| (offset[a] - at[a]).abs() < 3.0 && offset[a].fract() == 0.0), "{offset:?}");
    let mut written = Vec::new();
    for name in ["mesh.ply", "mesh.obj", "mesh.stl"] {
        let mesh = dir.path(name);
        let output = run(tiny(&cloud, &mesh).args(["--json", "--preview"]).arg(dir.path("a.png")), 0);
        let json = parse(&out(&output));
        assert_eq!(
            json.at("offset").as_array().unwrap().iter().map(Known::number).collect::<Vec<_>>(),
            offset
        );
        assert!(err(&output).contains("about the offset (450"), "{}", err(&output));
        assert_eq!(err(&output).contains("less the offset"), name == "mesh.stl", "{}", err(&output));
        let centre = json.at("mesh").at("bounds")[0][1].number();
        assert!((centre - at[1]).abs() < 3.0, "{centre}");
        assert!(json.at("mesh").at("volume").number() > 0.5);
        written.push(read_mesh(&mesh).unwrap());
    }
    assert_eq!(written[0], written[1]);
    for (far, near) in written[0].verts.iter().zip(&written[2].verts) {
        // STL keeps no order of vertices, but these are written in the order of the faces.
        assert!((0..3).all(|a| (near[a] + offset[a] - at[a]).abs() < 3.0 && (far[a] - at[a]).abs() < 3.0));
    }
    // Distances where the user is, and comparisons about one offset.
    let field = dir.path("field");
    run(tiny(&cloud, &dir.path("mesh.ply")).arg("--save-field").arg(&field), 0);
    let text = out(&run(program().arg("sdf").arg(&field).arg(&cloud), 0));
    let mean = text.lines().map(|l| l.parse::<f64>().unwrap().abs()).sum::<f64>() / 60.0;
    // A field of a few steps is rough; what would be wrong is a field of another place.
    assert!(mean < 1.0, "{mean}");
    let mut command = program();
    command
        .args(["evaluate", "--json", "--samples", "2000"])
        .arg(dir.path("mesh.ply"))
        .arg(dir.path("mesh.obj"));
    let json = parse(&out(&run(&mut command, 0)));
    assert!(json.at("report").at("metrics").at("hd").number() < 0.2);
    let sample = dir.path("sample.ply");
    run(program().arg("sample").arg(dir.path("mesh.ply")).args(["-n", "50", "-o"]).arg(&sample), 0);
    let places = read_cloud(&sample).unwrap().points;
    assert!(places.iter().all(|p| (p[1] - at[1]).abs() < 3.0 && p[1].fract() != 0.0));
}

#[test]
fn strays_are_left_out_unless_they_are_to_stay() {
    let dir = Dir::new("strays");
    let cloud = file(&dir, "a.xyz", "", |i, p| match i {
        7 => format!("{} {} {}\n3.5 0.25 -2", p[0], p[1], p[2]),
        _ => format!("{} {} {}", p[0], p[1], p[2]),
    });
    for (outliers, points) in [("auto", 60.0), ("remove", 60.0), ("keep", 61.0)] {
        let mut command = tiny(&cloud, &dir.path("mesh.ply"));
        let output = run(command.args(["--quiet", "--json", "--outliers", outliers]), 0);
        let json = parse(&out(&output));
        assert_eq!((json.at("points").number(), json.at("strays")[0][0].number()), (points, 3.5));
        let warning = json.at("warnings")[0].text().to_string();
        assert!(warning.starts_with("1 of 61 points") && err(&output).contains(&warning), "{warning}");
        assert_eq!(warning.contains("left out"), outliers != "keep");
    }
    assert_eq!(info(&cloud, &[]).at("strays").as_array().unwrap().len(), 1);
    assert_eq!(info(&cloud, &["--columns", "3,2,1"]).at("strays")[0][2].number(), 3.5);
}

/// A ball with normals that point inward, as the walls of a room do, and viewpoints that files tell.
#[test]
fn normals_and_an_origin_decide_what_is_inside() {
    let dir = Dir::new("sides");
    let (points, normals) = AnalyticShape::Sphere { radius: 1.0 }.sample(90, 2);
    let rows = |sign: f32| -> String {
        let row = |(p, n): (&[f32; 3], &[f32; 3])| {
            let n = n.map(|x| sign * x);
            format!("{} {} {} {} {} {}\n", p[0], p[1], p[2], n[0], n[1], n[2])
        };
        points.iter().zip(&normals).map(row).collect()
    };
    let head = |viewpoint: &str| {
        format!(
            "VERSION 0.7\nFIELDS x y z normal_x normal_y normal_z\nSIZE 4 4 4 4 4 4\nTYPE F F F F F F\n\
             COUNT 1 1 1 1 1 1\nWIDTH 90\nHEIGHT 1\nVIEWPOINT {viewpoint} 1 0 0 0\nPOINTS 90\nDATA ascii\n"
        )
    };
    let room = dir.text("room.pcd", head("0.1 0 -0.2") + &rows(-1.0));
    let mesh = dir.path("mesh.ply");
    let start = |args: &[&str]| {
        let mut command = program();
        command.arg("reconstruct").arg(&room).arg("-o").arg(&mesh).args(["--preset", "start", "--json"]);
        command.args(["--resolution", "20"]).args(args);
        let output = run(&mut command, 0);
        let volume = read_mesh(&mesh).unwrap().topology().volume;
        (parse(&out(&output)), volume, err(&output))
    };
    let (json, volume, told) = start(&[]);
    assert!(volume > 3.0 && json.at("sides").text() == "points" && !json.at("turned").truth(), "{json}");
    assert!(told.contains("--origin 0.1,0,-0.2") && told.contains("--normals use"), "{told}");
    let (json, volume, told) = start(&["--normals", "use"]);
    assert!(volume < -3.0 && json.at("sides").text() == "normals" && json.at("turned").truth(), "{json}");
    assert!(told.contains("seen from within"), "{told}");
    let (json, volume, _) = start(&["--origin", "-0.1,0,-0.2"]);
    assert!(volume < -3.0 && json.at("sides").text() == "origin", "{json}");
    let (_, volume, _) = start(&["--normals", "use", "--origin", "0,0,0.3"]);
    assert!(volume < -3.0);
    run(program().args(["reconstruct", "a.ply", "-o", "b.ply", "--origin", "1,2"]), 2);
    // Fields that start as a sphere have no use for them.
    fails(tiny(&room, &mesh).args(["--normals", "use"]), 2, &["start.shape"]);
    // A run goes on with the sides that it was started with only.
    let saved = dir.path("run.checkpoint");
    let steps = |from: &[&str]| {
        let mut command = tiny(&room, &mesh);
        command.args(["--set", "start.shape=gauss", "--set", "start.steps=5"]).args(from).arg(&saved);
        command
    };
    run(&mut steps(&["--normals", "use", "--checkpoint"]), 0);
    let first = fs::read(&mesh).unwrap();
    run(&mut steps(&["--normals", "use", "--resume"]), 0);
    assert!(first == fs::read(&mesh).unwrap());
    fails(&mut steps(&["--resume"]), 3, &["run.checkpoint", "other sides", "give them again"]);
    fails(&mut steps(&["--normals", "use", "--origin", "0,0,9", "--resume"]), 3, &["another origin"]);
}

/// What stands beside the coordinates is listed, and carried to the mesh, from scans and arrays, too.
#[test]
fn numbers_beside_the_coordinates_are_listed_and_carried() {
    let dir = Dir::new("beside");
    let points = torus();
    let rows: String =
        points.iter().map(|p| format!("{} {} {} {} 9 8 7\n", p[0], p[1], p[2], 0.5 + 0.1 * p[2])).collect();
    let pose = "1 2 3\n1 0 0\n0 1 0\n0 0 1\n1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n";
    let scan = dir.text("scan.ptx", format!("60\n1\n{pose}{rows}"));
    let json = info(&scan, &[]);
    let names: Vec<&str> =
        json.at("attributes").as_array().unwrap().iter().map(|a| a.at("name").text()).collect();
    assert_eq!(names, ["intensity", "red", "green", "blue"]);
    let red = &json.at("attributes")[1];
    assert!(red.at("type").text() == "u8" && red.at("min").number() == 9.0 && red.at("max").number() == 9.0);
    let text = out(&run(program().arg("info").arg(&scan), 0));
    assert!(text.contains("attribute   green (u8) from 8 to 8"), "{text}");
    let values: String = points.iter().map(|p| format!("{} ", 100.0 * p[2])).collect();
    let places: String = points.iter().map(|p| format!("{} {} {}\n", p[0], p[1], p[2])).collect();
    let vtk = dir.text(
        "points.vtk",
        format!(
            "# vtk DataFile Version 3.0\nmade by hand\nASCII\nDATASET POLYDATA\nPOINTS 60 float\n{places}\
             POINT_DATA 60\nSCALARS heat float\nLOOKUP_TABLE default\n{values}\n"
        ),
    );
    let mesh = dir.path("mesh.ply");
    for (file, name) in [(&scan, "float intensity"), (&vtk, "float heat")] {
        run(tiny(file, &mesh).args(["--carry", "--ascii"]), 0);
        let text = fs::read_to_string(&mesh).unwrap();
        assert!(text.contains(&format!("property {name}\n")), "{}", &text[..300]);
    }
}
