//! The program, run in a folder of its own.
#![allow(dead_code)] // Each test file uses its share.

use dapple_scene::image::{Channels, read_attributes, read_channels};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use tempfile::TempDir;

/// A box of light over a grey floor: small, quick, with an edge for samplers to find.
pub(crate) const TINY: &str = r#"LookAt 0 2 6  0 1 0  0 1 0
Camera "perspective" "float fov" [ 40 ]
Film "rgb" "integer xresolution" [ 24 ] "integer yresolution" [ 16 ] "string filename" [ "tiny.exr" ]
WorldBegin
Material "diffuse" "rgb reflectance" [ 0.5 0.5 0.5 ]
Shape "trianglemesh" "integer indices" [ 0 1 2 0 2 3 ]
  "point3 P" [ -9 0 -9  -9 0 9  9 0 9  9 0 -9 ]
AttributeBegin
  AreaLightSource "diffuse" "rgb L" [ 4 4 4 ]
  Translate 0 1 0
  Shape "sphere" "float radius" [ 0.5 ]
AttributeEnd
"#;

pub(crate) struct Folder(pub(crate) TempDir);

pub(crate) struct Said {
    pub(crate) status: Option<i32>,
    pub(crate) out: String,
    pub(crate) err: String,
}

impl Folder {
    /// An empty folder but for `tiny.pbrt`.
    pub(crate) fn new() -> Self {
        let folder = tempfile::tempdir().expect("a folder");
        std::fs::write(folder.path().join("tiny.pbrt"), TINY).expect("the scene");
        Self(folder)
    }

    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    pub(crate) fn read(&self, name: &str) -> Vec<u8> {
        std::fs::read(self.path(name)).unwrap_or_else(|e| panic!("{name}: {e}"))
    }

    /// The files, sorted, without `tiny.pbrt`.
    pub(crate) fn names(&self) -> Vec<String> {
        names(self.0.path()).into_iter().filter(|n| n != "tiny.pbrt").collect()
    }

    /// The program with these words, split at blanks.
    pub(crate) fn command(&self, words: &str) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_dapple"));
        command.args(words.split_whitespace()).current_dir(self.0.path());
        command
    }

    pub(crate) fn run(&self, words: &str) -> Said {
        Said::of(self.command(words).output().expect("the program starts"))
    }

    /// Runs what must end with this status, and say these parts on stderr.
    pub(crate) fn says(&self, words: &str, status: i32, parts: &[&str]) -> Said {
        let said = self.run(words);
        assert_eq!(said.status, Some(status), "{words}: {}", said.err);
        parts.iter().for_each(|part| assert!(said.err.contains(part), "{words}: no \"{part}\" in {}", said.err));
        said
    }

    /// The same by a shell with these limits, such as `-f 4`.
    pub(crate) fn limited(&self, limits: &str, words: &str) -> Said {
        let program = env!("CARGO_BIN_EXE_dapple");
        let script = format!("ulimit {limits}; exec {program} {words}");
        let output = Command::new("sh").args(["-c", &script]).current_dir(self.0.path()).output();
        Said::of(output.expect("a shell"))
    }

    /// Starts the program, with its output in pipes.
    pub(crate) fn start(&self, words: &str) -> Child {
        self.command(words).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().expect("the program starts")
    }

    /// A file as text.
    pub(crate) fn text(&self, name: &str) -> String {
        String::from_utf8(self.read(name)).expect("UTF-8")
    }

    pub(crate) fn write(&self, name: &str, bytes: impl AsRef<[u8]>) {
        std::fs::write(self.path(name), bytes).unwrap_or_else(|e| panic!("{name}: {e}"));
    }

    /// Runs what must succeed, and gives its stdout.
    pub(crate) fn done(&self, words: &str) -> String {
        let said = self.run(words);
        assert_eq!(said.status, Some(0), "{words}: {}", said.err);
        said.out
    }

    /// The line of JSON that a command prints.
    pub(crate) fn line(&self, words: &str) -> serde_json::Value {
        let out = self.done(words);
        assert_eq!(out.matches('\n').count(), 1, "one line: {out}");
        serde_json::from_str(&out).expect("JSON")
    }

    /// The line that `render --json` prints.
    pub(crate) fn json(&self, words: &str) -> serde_json::Value {
        self.line(&format!("render --json {words}"))
    }

    /// The size and the channels of an EXR file.
    pub(crate) fn exr(&self, name: &str) -> Channels {
        read_channels(&self.read(name), name).unwrap_or_else(|e| panic!("{e}"))
    }

    /// Asserts that two EXR files hold the same channels, NaN included.
    pub(crate) fn same_channels(&self, a: &str, b: &str) {
        let text = |name: &str| format!("{:?}", self.exr(name).channels);
        assert!(text(a) == text(b), "{a} and {b} differ");
    }

    /// The value of this setting in the header of an EXR file.
    pub(crate) fn header(&self, name: &str, key: &str) -> String {
        let all = read_attributes(&self.read(name), name).unwrap_or_else(|e| panic!("{e}"));
        let found = all.iter().find(|(known, _)| known.strip_prefix("dapple:") == Some(key));
        found.unwrap_or_else(|| panic!("{key}: {all:?}")).1.clone()
    }
}

impl Said {
    pub(crate) fn of(output: Output) -> Self {
        let text = |bytes| String::from_utf8(bytes).expect("UTF-8");
        Self { status: output.status.code(), out: text(output.stdout), err: text(output.stderr) }
    }
}

/// Sends a signal to a process.
pub(crate) fn signal(child: &Child, name: &str) {
    let sent = Command::new("kill").args([&format!("-{name}"), &child.id().to_string()]).status();
    assert!(sent.expect("kill").success());
}

pub(crate) fn names(folder: &Path) -> Vec<String> {
    let entries = std::fs::read_dir(folder).expect("the folder");
    let mut names: Vec<String> =
        entries.map(|e| e.expect("an entry").file_name().to_string_lossy().into_owned()).collect();
    names.sort();
    names
}
