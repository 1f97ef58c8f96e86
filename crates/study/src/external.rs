//! Filters that are programs of others.

use dapple_core::{Film, Filter, Filtered, Needs, Unfiltered};
use dapple_job::output::layers;
use dapple_scene::image::{Encoding, Layer, Plane, encode_exr, read_image};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::time::Instant;

/// A filter that is a program of somebody else's: it reads an unfiltered image with its features, and writes an image.
///
/// What it reads is an OpenEXR file with the layers of [`dapple_job::output::layers`] that first hits fill: the main
/// one (`R G B`, linear radiance, each pixel the mean of its own samples), `count`, `albedo` (`R G B`), `normal` (`X Y Z`,
/// in the scene's space) and `depth`; and `coverage.Y`, the share of a pixel's samples that hit something, since features
/// are means over those. What it writes is OpenEXR or PFM (or whatever else [`read_image`] reads), linear, of the same
/// size, without NaN.
///
/// Its time is what the last line of its standard output says as JSON, `{"seconds": 0.25}`, so that starting an
/// interpreter and reading files need not count; else the wall seconds of the process.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct External {
    /// The name under which methods have it as their filter.
    pub name: String,
    /// The program, by its name in `PATH` or its path, and its words. No shell reads them. In each word `{input}` and
    /// `{output}` are the paths of the images, and `{threads}` is the number of threads of the study.
    pub command: Vec<String>,
    /// The folder in which it is started: that of the plan's file. Empty: the current one.
    pub folder: PathBuf,
}

/// `NAME=PROGRAM WORD…`, words divided by blanks; started in the current folder.
impl std::str::FromStr for External {
    type Err = String;

    fn from_str(words: &str) -> Result<Self, String> {
        let (name, command) =
            words.split_once('=').ok_or("NAME=COMMAND is wanted, such as \"mine=program {input} {output}\"")?;
        let command = command.split_whitespace().map(str::to_owned).collect();
        Ok(Self { name: name.trim().to_owned(), command, folder: PathBuf::new() })
    }
}

/// The last line of a program that tells its time itself.
#[derive(Deserialize)]
struct Told {
    seconds: f64,
}

impl External {
    /// What is recorded for it.
    pub(crate) fn needs(&self) -> Needs {
        Needs::none().with_features()
    }

    /// Has it make the image, and says how many seconds that took. `unit` as in [`layers`]; 0 threads are one per core.
    pub(crate) fn apply(&self, film: &Film, unit: f64, threads: usize) -> Result<(Filtered, f64), String> {
        let refuse = |what: String| format!("the filter {} ({}) {what}", self.name, self.command.join(" "));
        let folder = tempfile::Builder::new().prefix("dapple-").tempdir();
        let folder = folder.map_err(|e| refuse(format!("has no temporary folder for its images: {e}")))?;
        let [input, output] = ["input.exr", "output.exr"].map(|name| folder.path().join(name));
        let written = encode(film, unit).and_then(|bytes| std::fs::write(&input, bytes).map_err(|e| e.to_string()));
        written.map_err(|why| refuse(format!("cannot be given its image: {why}")))?;
        let clock = Instant::now();
        let ended = self.start([&input, &output], threads).map_err(|e| refuse(format!("cannot be started: {e}")))?;
        let wall = clock.elapsed().as_secs_f64();
        if !ended.status.success() {
            return Err(refuse(format!("ended with {}: {}", ended.status, last_lines(&ended.stderr))));
        }
        let seconds = seconds(&ended.stdout, wall).map_err(&refuse)?;
        let radiance = read(&output, film.frame().size()).map_err(&refuse)?;
        Ok((Filtered { size: film.frame().size(), radiance, error: None }, seconds))
    }

    fn start(&self, [input, output]: [&Path; 2], threads: usize) -> std::io::Result<Output> {
        let threads = if threads == 0 { rayon::current_num_threads() } else { threads }.to_string();
        let marks = [
            ("{input}", input.display().to_string()),
            ("{output}", output.display().to_string()),
            ("{threads}", threads),
        ];
        let filled = |word: &String| marks.iter().fold(word.clone(), |word, (mark, text)| word.replace(mark, text));
        let mut words = self.command.iter().map(filled);
        let mut command = Command::new(words.next().unwrap_or_default());
        command.args(words).stdin(Stdio::null());
        if !self.folder.as_os_str().is_empty() {
            command.current_dir(&self.folder);
        }
        command.output()
    }
}

/// The image with its features.
fn encode(film: &Film, unit: f64) -> Result<Vec<u8>, String> {
    let unfiltered = Unfiltered.apply(film).map_err(|e| e.to_string())?;
    let mut layers = layers(film, &unfiltered, unit, None);
    let share = |i: usize| film.features(i).map_or(0.0, |f| f.hits as f32 / f.samples.max(1) as f32);
    let coverage: Vec<f32> = (0..film.frame().pixels()).map(share).collect();
    layers.push(Layer { name: "coverage".into(), channels: vec![("Y", Plane::from(coverage))] });
    encode_exr(film.frame().size(), &layers, &[]).map(|exr| exr.bytes).map_err(|e| e.to_string())
}

/// What the program said of its time, else the wall's.
fn seconds(stdout: &[u8], wall: f64) -> Result<f64, String> {
    let text = String::from_utf8_lossy(stdout);
    let Some(last) = text.lines().rev().find(|line| !line.trim().is_empty()) else { return Ok(wall) };
    match serde_json::from_str::<Told>(last) {
        Ok(Told { seconds }) if seconds.is_finite() && seconds >= 0.0 => Ok(seconds),
        Ok(Told { seconds }) => Err(format!("says that it took {seconds} seconds: a number from 0 on is wanted")),
        Err(_) => Ok(wall),
    }
}

/// The image that was written.
fn read(path: &Path, [w, h]: [u32; 2]) -> Result<Vec<[f32; 3]>, String> {
    let bytes = match std::fs::read(path) {
        Ok(bytes) => bytes,
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => {
            return Err("wrote no image: it is to write the one that {output} names".into());
        }
        Err(e) => return Err(format!("wrote an image that cannot be read: {e}")),
    };
    let image = read_image(&bytes, "{output}", Encoding::Auto).map_err(|e| format!("wrote no image: {e}"))?;
    let [pw, ph] = image.size;
    if [pw, ph] != [w, h] {
        return Err(format!("wrote an image of {pw}x{ph} pixels: {w}x{h} are wanted"));
    }
    if let Some(found) = image.non_finite() {
        let [x, y] = found.first;
        return Err(format!("wrote {} pixels that are no number, the first in column {x}, row {y}", found.count));
    }
    Ok(image.pixels)
}

/// The end of what a program complained, on one line.
fn last_lines(stderr: &[u8]) -> String {
    let text = String::from_utf8_lossy(stderr);
    let lines: Vec<&str> = text.lines().map(str::trim).filter(|line| !line.is_empty()).collect();
    match lines.len() {
        0 => "it did not say why".into(),
        n => lines[n.saturating_sub(3)..].join(" | "),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_program_may_tell_its_time() {
        let cases = [
            ("", Some(7.0)),
            ("hello\n", Some(7.0)),
            ("{\"seconds\": 0.25}\n", Some(0.25)),
            ("loading\n{\"seconds\": 2, \"device\": \"CPU\"}\n\n", Some(2.0)),
            // Only the last line is asked.
            ("{\"seconds\": 2}\ndone", Some(7.0)),
            ("{\"seconds\": -1}", None),
        ];
        for (said, expected) in cases {
            assert_eq!(seconds(said.as_bytes(), 7.0).ok(), expected, "{said}");
        }
    }

    #[test]
    fn complaints_are_short() {
        assert_eq!(last_lines(b"a\nb\n\nc\nd\n"), "b | c | d");
        assert_eq!(last_lines(b"\n"), "it did not say why");
    }
}
