//! Filters (denoisers) that are external programs.

use dapple_core::{Film, Filter, Filtered, Unfiltered};
use dapple_job::output::layers;
use dapple_scene::image::{Encoding, encode_exr, read_image};
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::error::Error;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::time::Instant;

/// A filter that is an external program: it reads an unfiltered image with features (albedo, normals, depth), and
/// writes a filtered image.
///
/// * Input: OpenEXR. The main layer has `R G B`, linear radiance, each pixel the mean of its own samples. Further layers:
///   `count`, `albedo` (`R G B`), `normal` (`X Y Z`, in scene space), `depth` and `coverage`. Features are means over the
///   samples that hit a surface; `coverage.Y` is the fraction of a pixel's samples that hit one.
/// * Output: OpenEXR or PFM, linear, of the same size, with finite values.
/// * Filtering time: the wall-clock seconds of the process. If the last line that the program prints is JSON such as
///   `{"seconds": 0.25}`, this number is used instead, and can exclude start-up and file reading.
///
/// ```
/// # use dapple_study::External;
/// let oidn = External::new("oidn", &["python3", "oidn.py", "{input}", "{output}", "--threads", "{threads}"]);
/// assert_eq!(oidn.command.len(), 6);
/// ```
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct External {
    /// The name by which methods select the program as their filter.
    pub name: String,
    /// The program (a path, or a name in `PATH`) and its arguments; no shell is involved. In each argument, `{input}` and
    /// `{output}` are replaced by the paths of the images, and `{threads}` by the study's number of threads.
    #[serde(deserialize_with = "command")]
    pub command: Vec<String>,
    /// The working folder of the program; an empty path means the current folder. In a plan file, it is relative to the folder
    /// of that file.
    #[serde(default)]
    pub folder: PathBuf,
}

/// Reads a command: a list of arguments, or text with spaces between them.
fn command<'de, D: serde::Deserializer<'de>>(from: D) -> Result<Vec<String>, D::Error> {
    #[derive(Deserialize)]
    #[serde(
        untagged,
        expecting = "a command: \"PROGRAM {input} {output}\", or a list of arguments if they hold spaces"
    )]
    enum Command {
        Line(String),
        List(Vec<String>),
    }
    Ok(match Command::deserialize(from)? {
        Command::Line(line) => line.split_whitespace().map(str::to_owned).collect(),
        Command::List(arguments) => arguments,
    })
}

impl External {
    /// Creates a filter called `name` that runs `command`, a program and its arguments, in the current folder.
    pub fn new(name: &str, command: &[&str]) -> Self {
        let command = command.iter().map(|argument| (*argument).to_owned()).collect();
        Self { name: name.to_owned(), command, folder: PathBuf::new() }
    }

    /// Runs the program on the film. Returns the filtered image, and the seconds spent on filtering. `unit` is the integrator's
    /// unit of length in the scene file's units. With 0 threads, the program gets one per core.
    pub(crate) fn apply(&self, film: &Film, unit: f64, threads: usize) -> Result<(Filtered, f64), String> {
        let refuse = |what: String| format!("the filter \"{}\" ({}) {what}", self.name, self.command.join(" "));
        let folder = tempfile::Builder::new().prefix("dapple-").tempdir();
        let folder = folder.map_err(|e| refuse(format!("needs a temporary folder, which cannot be created: {e}")))?;
        let [input, output] = ["input.exr", "output.exr"].map(|name| folder.path().join(name));
        let written = encode(film, unit).and_then(|bytes| std::fs::write(&input, bytes).map_err(|e| e.to_string()));
        written.map_err(|why| refuse(format!("needs its input image, which cannot be written: {why}")))?;
        let clock = Instant::now();
        let ended = self
            .start([&input, &output], threads)
            .map_err(|e| refuse(format!("cannot be started: {e}; check the program's name and the plan's folder")))?;
        let wall = clock.elapsed().as_secs_f64();
        if !ended.status.success() {
            return Err(refuse(format!("ended with {}: {}", ended.status, last_lines(&ended.stderr))));
        }
        let seconds = seconds(&ended.stdout, wall).map_err(&refuse)?;
        let radiance = read(&output, film.frame().size()).map_err(&refuse)?;
        Ok((Filtered::new(film.frame().size(), radiance), seconds))
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

/// Encodes the unfiltered image and its features as an EXR file.
fn encode(film: &Film, unit: f64) -> Result<Vec<u8>, String> {
    let unfiltered = Unfiltered.apply(film).map_err(|e| e.to_string())?;
    let layers = layers(film, &unfiltered, unit, None);
    encode_exr(film.frame().size(), &layers, &[]).map(|exr| exr.bytes).map_err(|e| e.to_string())
}

/// The seconds that the program reports in the last line of its output, or `wall` if it reports none.
fn seconds(stdout: &[u8], wall: f64) -> Result<f64, String> {
    let text = String::from_utf8_lossy(stdout);
    let Some(last) = text.lines().rev().find(|line| !line.trim().is_empty()) else { return Ok(wall) };
    match serde_json::from_str::<Value>(last).ok().and_then(|report| report.get("seconds")?.as_f64()) {
        Some(seconds) if seconds < 0.0 => Err(format!("reports {seconds} seconds; print 0 or more")),
        reported => Ok(reported.unwrap_or(wall)),
    }
}

/// Reads the program's output image, which must be `w` x `h` pixels.
fn read(path: &Path, [w, h]: [u32; 2]) -> Result<Vec<[f32; 3]>, String> {
    let unreadable = |e: &dyn Error| format!("wrote an image that cannot be read: {e}");
    let bytes = std::fs::read(path).map_err(|e| match e.kind() {
        ErrorKind::NotFound => "wrote no image; write it to the path given as {output}".to_owned(),
        _ => unreadable(&e),
    })?;
    let image = read_image(&bytes, "{output}", Encoding::Auto).map_err(|e| unreadable(&e))?;
    let [pw, ph] = image.size;
    if [pw, ph] != [w, h] {
        return Err(format!("wrote an image of {pw}x{ph} pixels; write {w}x{h}"));
    }
    if let Some((count, [x, y])) = image.non_finite() {
        let first = format!("the first at column {x}, row {y}; write finite values");
        return Err(format!("wrote {count} pixels that are NaN or infinite, {first}"));
    }
    Ok(image.pixels)
}

/// The last three lines of a program's error output, joined to one line.
fn last_lines(stderr: &[u8]) -> String {
    let text = String::from_utf8_lossy(stderr);
    let lines: Vec<&str> = text.lines().map(str::trim).filter(|line| !line.is_empty()).collect();
    match lines.len() {
        0 => "it printed no error".into(),
        n => lines[n.saturating_sub(3)..].join(" | "),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_program_may_report_its_own_time() {
        let cases = [
            ("", Some(7.0)),
            ("hello\n", Some(7.0)),
            ("{\"seconds\": 0.25}\n", Some(0.25)),
            ("loading\n{\"seconds\": 2, \"device\": \"CPU\"}\n\n", Some(2.0)),
            // Only the last line counts.
            ("{\"seconds\": 2}\ndone", Some(7.0)),
            ("{\"seconds\": -1}", None),
        ];
        for (printed, expected) in cases {
            assert_eq!(seconds(printed.as_bytes(), 7.0).ok(), expected, "{printed}");
        }
    }

    #[test]
    fn errors_of_programs_are_cut_to_three_lines() {
        assert_eq!(last_lines(b"a\nb\n\nc\nd\n"), "b | c | d");
        assert_eq!(last_lines(b"\n"), "it printed no error");
    }
}
