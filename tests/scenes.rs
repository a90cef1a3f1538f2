//! The built program: points of made-up scenes.
#![cfg(feature = "cli")]

use std::fs;
use std::path::Path;

use bijective_sdf::io::read_cloud;

#[allow(dead_code)]
mod common;
use common::{Dir, err, fails, program, run};

#[test]
fn made_up_scenes_are_sampled_and_scanned() {
    let dir = Dir::new("scenes");
    let count = |path: &Path| read_cloud(path).unwrap().points.len();
    let sample = |name: &str, options: &[&str]| {
        let path = dir.path(name);
        run(program().arg("sample").arg("-o").arg(&path).args(options), 0);
        path
    };
    let room = ["--scene", "room", "--density", "10", "--seed", "3"];
    let (plain, again) = (sample("room.ply", &room), sample("again.ply", &room));
    assert_eq!(fs::read(&plain).unwrap(), fs::read(&again).unwrap());
    // Walls, floor and ceiling have 87 square metres, the furniture some 20 more.
    assert!((900..1400).contains(&count(&plain)), "{}", count(&plain));
    let oriented = sample("oriented.ply", &[&room[..], &["--normals"]].concat());
    let text = fs::read(&oriented).unwrap();
    assert!(String::from_utf8_lossy(&text[..300]).contains("property float nz"));
    assert_eq!(count(&oriented), count(&plain));
    let street = ["--scene", "street", "--length", "30", "--density", "1"];
    assert!(count(&sample("street.xyz", &street)) > 900);
    let seen = sample("seen.ply", &["--scene", "room", "--scanner", "2.5,3,1.2", "--noise", "0.005"]);
    assert!(count(&seen) > 100_000);
    for (options, text) in [
        (&["--scene", "room", "--scanner", "2,2,-1"][..], "free space"),
        (&["--scene", "room", "--noise", "1%"], "metres"),
        (&["--scene", "room", "--density", "0"], "above 0"),
    ] {
        fails(program().arg("sample").arg("-o").arg(dir.path("bad.ply")).args(options), 2, &[text]);
    }
    for options in [&["--density", "5"][..], &[]] {
        let output = run(program().arg("sample").arg("-o").arg(dir.path("bad.ply")).args(options), 2);
        assert!(err(&output).contains("<MESH>"), "{}", err(&output));
    }
    let csv = dir.path("bad.csv");
    fails(program().arg("sample").arg("-o").arg(csv).args(room).arg("--normals"), 2, &["ply"]);
}
