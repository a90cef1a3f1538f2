//! Helpers of the tests that run the program.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};

use bijective_sdf::geometry::{AnalyticShape, TriangleMesh};
use bijective_sdf::io::{write_cloud, write_mesh};

pub mod json;

/// A directory that goes away with the test.
pub struct Dir(pub PathBuf);

impl Dir {
    pub fn new(name: &str) -> Dir {
        let path = std::env::temp_dir().join(format!("bijective-sdf-cli-{name}-{}", std::process::id()));
        let _ = fs::remove_dir_all(&path);
        fs::create_dir_all(&path).unwrap();
        Dir(path)
    }

    pub fn path(&self, file: &str) -> PathBuf {
        self.0.join(file)
    }

    pub fn text(&self, file: &str, content: impl AsRef<[u8]>) -> PathBuf {
        let path = self.path(file);
        fs::write(&path, content).unwrap();
        path
    }

    /// 60 points on a sphere.
    pub fn cloud(&self) -> PathBuf {
        let path = self.path("cloud.ply");
        write_cloud(&path, &AnalyticShape::Sphere { radius: 0.5 }.sample(60, 1).0).unwrap();
        path
    }

    /// A box of 12 triangles, without the last one if it is to be open.
    pub fn mesh(&self, file: &str, closed: bool) -> PathBuf {
        let verts = (0..8).map(|i| [0, 1, 2].map(|a| (i >> a & 1) as f32)).collect();
        let quads: [[u32; 4]; 6] =
            [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
        let mut faces: Vec<[u32; 3]> =
            quads.iter().flat_map(|q| [[q[0], q[1], q[2]], [q[0], q[2], q[3]]]).collect();
        if !closed {
            faces.pop();
        }
        let path = self.path(file);
        write_mesh(&path, &TriangleMesh { verts, faces }).unwrap();
        path
    }

    pub fn names(&self) -> Vec<String> {
        let mut names: Vec<String> =
            fs::read_dir(&self.0).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
        names.sort();
        names
    }
}

impl Drop for Dir {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(&self.0);
    }
}

/// Options that make a reconstruction take a moment only.
pub const TINY: [&str; 7] = [
    "field.width=16",
    "field.depth=2",
    "start.shape=sphere",
    "bsp.channels=8",
    "bsp.heads=2",
    "bsp_pretrain=3",
    "stages=12:20",
];

/// The program, without input.
pub fn program() -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_bijective-sdf"));
    command.stdin(Stdio::null());
    command
}

/// A reconstruction that takes a moment.
pub fn tiny(input: &Path, output: &Path) -> Command {
    let mut command = program();
    command.arg("reconstruct").arg(input).arg("-o").arg(output).args(["--resolution", "20"]);
    TINY.iter().for_each(|option| {
        command.args(["--set", option]);
    });
    command
}

pub fn code(output: &Output) -> i32 {
    output.status.code().unwrap_or_else(|| panic!("killed: {}", err(output)))
}

pub fn err(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

pub fn out(output: &Output) -> String {
    String::from_utf8(output.stdout.clone()).unwrap()
}

/// Runs, and checks the exit code.
#[track_caller]
pub fn run(command: &mut Command, want: i32) -> Output {
    let output = command.output().unwrap();
    assert_eq!(code(&output), want, "{command:?}\n{}", err(&output));
    output
}

/// Runs, and checks that it fails with one line that contains all of `parts`.
#[track_caller]
pub fn fails(command: &mut Command, want: i32, parts: &[&str]) {
    let output = run(command, want);
    let text = err(&output);
    let lines: Vec<&str> = text.lines().filter(|l| l.starts_with("error: ")).collect();
    assert_eq!(lines.len(), 1, "{text}");
    for part in parts {
        assert!(lines[0].contains(part), "{part:?} is not in {text}");
    }
    assert!(output.stdout.is_empty(), "{}", out(&output));
}

/// Starts a command with all three streams in our hands.
pub fn piped(command: &mut Command) -> Child {
    command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap()
}
