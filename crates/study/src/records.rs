//! The files in a study's folder: `study.json` with the settings, and `runs.jsonl` with one line per finished run.

use crate::{Machine, Manifest, Method, Plan, Run, SceneRecord, StudyError};
use serde::Deserialize;
use serde_json::Value;
use std::collections::{BTreeMap, BTreeSet};
use std::fs::{File, OpenOptions, TryLockError};
use std::io::{self, ErrorKind, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

/// A file of lines. When `append` returns, the line is on the disk.
trait Lines {
    /// Appends bytes and flushes them to the disk. After an error, part of the bytes may be stored.
    fn append(&mut self, bytes: &[u8]) -> io::Result<()>;

    /// Truncates the file to `length` bytes.
    fn cut(&mut self, length: u64) -> io::Result<()>;
}

impl Lines for File {
    fn append(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.seek(SeekFrom::End(0))?;
        self.write_all(bytes)?;
        self.flush()?;
        self.sync_data()
    }

    fn cut(&mut self, length: u64) -> io::Result<()> {
        self.set_len(length)?;
        self.sync_data()
    }
}

/// The finished runs of a study, in memory and on disk.
pub(crate) struct RunLog {
    path: PathBuf,
    store: Box<dyn Lines>,
    length: u64,
    runs: Vec<Run>,
}

impl RunLog {
    /// Opens or creates the file and locks it for this process. Removes an incomplete last line, which a killed process may
    /// have left.
    ///
    /// # Errors
    ///
    /// [`StudyError::Refused`] if another process uses the file, or for a complete line that is not a run. [`StudyError::File`]
    /// for an error of the disk.
    pub(crate) fn open(path: &Path) -> Result<Self, StudyError> {
        let wrong = |action| move |e| StudyError::file(path, action, e);
        let file = OpenOptions::new().read(true).write(true).create(true).truncate(false).open(path);
        let mut file = file.map_err(wrong("open the file of runs"))?;
        // A child process that another thread is starting shares the lock for a moment.
        let mut tries = 0;
        let locked = loop {
            match file.try_lock() {
                Err(TryLockError::WouldBlock) if tries < 10 => tries += 1,
                locked => break locked,
            }
            std::thread::sleep(Duration::from_millis(20));
        };
        match locked {
            Ok(()) => {}
            Err(TryLockError::WouldBlock) => {
                let folder = path.parent().unwrap_or(Path::new("")).display();
                let why = "another process is running the study in this folder; wait until it finishes, or choose another folder";
                return Err(StudyError::refused(folder, why));
            }
            // Some file systems have no locks; the study then runs without one.
            Err(TryLockError::Error(_)) => {}
        }
        let mut bytes = Vec::new();
        file.read_to_end(&mut bytes).map_err(wrong("read the file of runs"))?;
        let (runs, whole) = parse(&bytes, path)?;
        for (at, run) in runs.iter().enumerate() {
            let is_same = |earlier: &Run| earlier.is_of(&run.scene, &run.method, run.budget, run.seed);
            if let Some(first) = runs[..at].iter().position(is_same) {
                let why = format!("this is the same run as line {}; remove one of the two lines", first + 1);
                return Err(StudyError::line(path, at + 1, why));
            }
        }
        let length = whole as u64;
        if whole < bytes.len() {
            file.cut(length).map_err(wrong("remove the incomplete last line of the file of runs"))?;
        }
        Ok(Self { path: path.to_owned(), store: Box::new(file), length, runs })
    }

    /// The finished runs in the order of their completion.
    pub(crate) fn runs(&self) -> &[Run] {
        &self.runs
    }

    /// Appends a finished run in memory and on the disk.
    ///
    /// # Errors
    ///
    /// [`StudyError::File`] if the disk fails. Earlier runs are kept, and no part of this run is stored.
    pub(crate) fn append(&mut self, run: Run) -> Result<(), StudyError> {
        let refuse = |source: io::Error, kept: usize| StudyError::File {
            path: self.path.clone(),
            action: "store a finished run",
            kept: format!(
                "the {kept} earlier runs are kept; free disk space if the disk is full, then repeat the command"
            ),
            source,
        };
        let mut line = serde_json::to_vec(&run).map_err(|e| refuse(e.into(), self.runs.len()))?;
        line.push(b'\n');
        if let Err(e) = self.store.append(&line) {
            // If this fails too, `open` drops the incomplete line next time.
            let _ = self.store.cut(self.length);
            return Err(refuse(e, self.runs.len()));
        }
        self.length += line.len() as u64;
        self.runs.push(run);
        Ok(())
    }
}

/// Parses the complete lines of `runs.jsonl`. Returns the runs, and the length of the complete lines in bytes; the remaining
/// bytes are an incomplete last line.
fn parse(bytes: &[u8], path: &Path) -> Result<(Vec<Run>, usize), StudyError> {
    let whole = bytes.iter().rposition(|b| *b == b'\n').map_or(0, |at| at + 1);
    let run = |(number, line): (usize, &[u8])| {
        let why = |e: &serde_json::Error| format!("the line is not a run: {e}; correct or remove it");
        let refuse = |e: serde_json::Error| StudyError::line(path, number + 1, why(&e));
        serde_json::from_slice(line).map_err(refuse)
    };
    let lines = bytes[..whole].split(|b| *b == b'\n').enumerate().filter(|(_, line)| !line.trim_ascii().is_empty());
    Ok((lines.map(run).collect::<Result<_, _>>()?, whole))
}

/// A study as read from its folder: the manifest and the finished runs.
///
/// ```no_run
/// let study = dapple_study::RecordedStudy::read("results".as_ref())?;
/// println!("{} of {} runs", study.runs.len(), study.expected());
/// # Ok::<(), dapple_study::StudyError>(())
/// ```
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct RecordedStudy {
    /// The study's folder.
    pub folder: PathBuf,
    /// The contents of `study.json`.
    pub manifest: Manifest,
    /// The finished runs, in the order of the lines of `runs.jsonl`. Of several lines with the same scene, method, budget and
    /// seed, only the last one is kept.
    pub runs: Vec<Run>,
    /// The number of lines of `runs.jsonl` that were skipped because their scene, method, budget or seed is not in the
    /// manifest.
    pub foreign: usize,
    /// The number of lines of `runs.jsonl` that were skipped because a later line has the same scene, method, budget and seed.
    pub repeated: usize,
    /// True if the last line of `runs.jsonl` was skipped because it is incomplete, for example after a full disk.
    pub torn: bool,
}

impl RecordedStudy {
    /// Reads `study.json` and `runs.jsonl`; a study without runs is not an error.
    ///
    /// # Errors
    /// [`StudyError`], which names the file and, for invalid contents, the line.
    pub fn read(folder: &Path) -> Result<Self, StudyError> {
        let file = folder.join("study.json");
        let manifest = read_manifest(folder)?.ok_or_else(|| {
            StudyError::refused(
                file.display(),
                "there is no study here; pass the folder that `dapple study -o` wrote to",
            )
        })?;
        if !manifest.methods.contains(&manifest.baseline) {
            return Err(StudyError::line(&file, 1, "the baseline is not one of the methods; add it there"));
        }
        let path = folder.join("runs.jsonl");
        let bytes = match std::fs::read(&path) {
            Err(e) if e.kind() == ErrorKind::NotFound => Vec::new(),
            other => other.map_err(|e| StudyError::file(&path, "read the finished runs", e))?,
        };
        let (all, whole) = parse(&bytes, &path)?;
        let total = all.len();
        let mut runs: Vec<Run> = all.into_iter().filter(|run| plans(&manifest, run)).collect();
        let planned = runs.len();
        let key = |run: &Run| (run.scene.clone(), run.method.clone(), run.budget, run.seed);
        let last: BTreeMap<_, usize> = runs.iter().enumerate().map(|(at, run)| (key(run), at)).collect();
        let mut number = 0..;
        runs.retain(|run| number.next() == last.get(&key(run)).copied());
        let (foreign, repeated) = (total - planned, planned - runs.len());
        Ok(Self { folder: folder.to_owned(), manifest, runs, foreign, repeated, torn: whole < bytes.len() })
    }

    /// The number of planned runs.
    pub fn expected(&self) -> usize {
        let m = &self.manifest;
        m.scenes.len() * m.seeds.len() * m.methods.len() * m.budgets().count()
    }
}

fn plans(manifest: &Manifest, run: &Run) -> bool {
    manifest.budgets().any(|budget| budget == run.budget)
        && manifest.scenes.iter().any(|scene| scene.name == run.scene)
        && manifest.methods.contains(&run.method)
        && manifest.seeds.contains(&run.seed)
}

/// The git commit of the build, found by the build script; empty if it is unknown.
const COMMIT: &str = env!("DAPPLE_BUILD_COMMIT");

/// Creates the manifest of a study that begins now.
pub(crate) fn manifest_of(plan: &Plan, scenes: Vec<SceneRecord>, command: &[String]) -> Manifest {
    Manifest {
        version: env!("CARGO_PKG_VERSION").to_owned(),
        commit: (!COMMIT.is_empty()).then(|| COMMIT.to_owned()),
        command: command.to_vec(),
        began: utc(SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |d| d.as_secs())),
        machine: machine(plan.settings.threads),
        scenes,
        methods: plan.methods.clone(),
        external: plan.settings.external.clone(),
        baseline: plan.settings.baseline.clone(),
        spp: plan.spp.clone(),
        time_of: plan.time_of,
        seeds: plan.seeds.clone(),
        max_depth: plan.settings.max_depth,
        fresh: plan.settings.fresh,
        share_samples: plan.settings.share_samples,
    }
}

fn machine(threads: usize) -> Machine {
    let cpuinfo = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let mut entries = cpuinfo.lines().filter_map(|line| line.split_once(':'));
    let model = entries.find(|(key, _)| key.trim() == "model name");
    Machine {
        processor: model.map(|(_, name)| name.trim().to_owned()),
        threads: if threads == 0 { rayon::current_num_threads() } else { threads },
        cores: std::thread::available_parallelism().ok().map(usize::from),
        system: format!("{} {}", std::env::consts::OS, std::env::consts::ARCH),
    }
}

/// Formats seconds since 1970 as RFC 3339 in UTC, by Howard Hinnant's algorithm `civil_from_days`.
fn utc(seconds: u64) -> String {
    let (days, second) = (seconds / 86_400, seconds % 86_400);
    // Years begin on 1 March, so that the leap day is the last.
    let day = days + 719_468;
    let (era, of_era) = (day / 146_097, day % 146_097);
    let year_of_era = (of_era - of_era / 1460 + of_era / 36_524 - of_era / 146_096) / 365;
    let of_year = of_era - (365 * year_of_era + year_of_era / 4 - year_of_era / 100);
    let shifted = (5 * of_year + 2) / 153;
    let (date, month) = (of_year - (153 * shifted + 2) / 5 + 1, if shifted < 10 { shifted + 3 } else { shifted - 9 });
    let year = year_of_era + era * 400 + u64::from(month <= 2);
    format!("{year:04}-{month:02}-{date:02}T{:02}:{:02}:{:02}Z", second / 3600, second / 60 % 60, second % 60)
}

/// Reads a manifest from the `study.json` in a folder; `None` if the file does not exist.
pub(crate) fn read_manifest(folder: &Path) -> Result<Option<Manifest>, StudyError> {
    let file = folder.join("study.json");
    let bytes = match std::fs::read(&file) {
        Ok(bytes) => bytes,
        Err(e) if e.kind() == ErrorKind::NotFound => return Ok(None),
        Err(e) => return Err(StudyError::file(&file, "read the study's settings", e)),
    };
    let why = |e: &serde_json::Error| format!("the file is not a study: {e}; correct the line, or use another folder");
    let refuse = |e: serde_json::Error| StudyError::line(&file, e.line(), why(&e));
    serde_json::from_slice(&bytes).map(Some).map_err(refuse)
}

/// Encodes a manifest as the text of `study.json`.
pub(crate) fn manifest_bytes(manifest: &Manifest) -> Vec<u8> {
    // Serialising plain numbers and text cannot fail.
    let mut bytes = serde_json::to_vec_pretty(manifest).unwrap_or_default();
    bytes.push(b'\n');
    bytes
}

/// Lists the settings that differ between two manifests, one line each. Ignores start time, command line, number of cores, the
/// references' relMSE, and the paths of scenes, references and external programs. Commits are compared only if both are known.
pub(crate) fn differences(there: &Manifest, here: &Manifest) -> Vec<String> {
    let values = |manifest: &Manifest| {
        let mut plain = manifest.clone();
        (plain.command, plain.began, plain.machine.cores) = (Vec::new(), String::new(), None);
        if there.commit.is_none() || here.commit.is_none() {
            plain.commit = None;
        }
        plain.external.iter_mut().for_each(|external| external.folder = PathBuf::new());
        for scene in &mut plain.scenes {
            (scene.reference.file, scene.reference.relmse) = (String::new(), None);
            scene.source = String::new();
        }
        let mut value = serde_json::to_value(&plain).unwrap_or_default();
        for scene in &plain.scenes {
            value[format!("scene {}", scene.name)] = serde_json::to_value(scene).unwrap_or_default();
        }
        value["scenes"] = plain.scenes.iter().map(|scene| scene.name.clone()).collect();
        let mut values = BTreeMap::new();
        add_values("", value, &mut values);
        values
    };
    let [there_values, here_values] = [values(there), values(here)];
    let keys: BTreeSet<&String> = there_values.keys().chain(here_values.keys()).collect();
    let pairs = keys.into_iter().map(|key| (key, [&there_values, &here_values].map(|values| values.get(key))));
    let words = |value: Option<&Value>| readable(value.unwrap_or(&Value::Null));
    let line = |(key, [there, here]): (&String, [Option<&Value>; 2])| match key.strip_suffix(".reference.hash") {
        Some(scene) => format!("{scene} or its reference has changed since the study began"),
        None => format!("{key}: {}, not {}", words(there), words(here)),
    };
    pairs.filter(|(_, [there, here])| there != here).map(line).collect()
}

/// Collects the values in nested objects, with the path of keys `a.b.c` as the name. A list counts as one value.
fn add_values(place: &str, value: Value, found: &mut BTreeMap<String, Value>) {
    let Value::Object(all) = value else {
        let _ = found.insert(place.to_owned(), value);
        return;
    };
    for (key, value) in all {
        let inner = if place.is_empty() { key } else { format!("{place}.{key}") };
        add_values(&inner, value, found);
    }
}

/// Formats a JSON value as readable text.
fn readable(value: &Value) -> String {
    match value {
        Value::Null => "none".into(),
        Value::String(text) => text.clone(),
        Value::Array(list) if list.is_empty() => "none".into(),
        Value::Array(list) => list.iter().map(readable).collect::<Vec<_>>().join(" "),
        Value::Object(all) => match (all.get("name"), Method::deserialize(value)) {
            (Some(name), _) => readable(name),
            (None, Ok(method)) => method.to_string(),
            (None, Err(_)) => value.to_string(),
        },
        other => other.to_string(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A disk with this many free bytes, on which files cannot be truncated. Of a line that is too long, the part that fits is
    /// written.
    struct Full {
        file: PathBuf,
        free: usize,
    }

    impl Lines for Full {
        fn append(&mut self, bytes: &[u8]) -> io::Result<()> {
            let fits = bytes.len().min(self.free);
            OpenOptions::new().append(true).open(&self.file)?.write_all(&bytes[..fits])?;
            self.free -= fits;
            if fits < bytes.len() { Err(ErrorKind::StorageFull.into()) } else { Ok(()) }
        }

        fn cut(&mut self, _: u64) -> io::Result<()> {
            Err(ErrorKind::StorageFull.into())
        }
    }

    #[test]
    fn a_full_disk_loses_no_finished_run() {
        let folder = tempfile::tempdir().unwrap();
        let runs: Vec<Run> = (0..5).map(|seed| Run { seed, ..Run::default() }).collect();
        let keep = |log: &mut RunLog| runs[log.runs().len()..].iter().try_for_each(|run| log.append(run.clone()));
        let file = folder.path().join("whole");
        keep(&mut RunLog::open(&file).unwrap()).unwrap();
        let whole = std::fs::read(&file).unwrap();
        for free in [0, 1, whole.len() / 3, whole.len() / 2, whole.len() - 1] {
            let file = folder.path().join(free.to_string());
            let mut log = RunLog::open(&file).unwrap();
            log.store = Box::new(Full { file: file.clone(), free });
            let said = keep(&mut log).unwrap_err().to_string();
            let kept = log.runs().len();
            let expected = format!("the {kept} earlier runs are kept");
            assert!(said.contains("cannot store a finished run") && said.contains(&expected), "{said}");
            assert_eq!(kept, whole[..free].iter().filter(|byte| **byte == b'\n').count());
            keep(&mut RunLog::open(&file).unwrap()).unwrap();
            assert!(std::fs::read(&file).unwrap() == whole, "{free} bytes were free");
        }
    }

    #[test]
    fn dates_match_the_calendar() {
        // From GNU date -u -d @N.
        for (seconds, date) in [
            (0, "1970-01-01T00:00:00Z"),
            (951_782_400, "2000-02-29T00:00:00Z"),
            (1_709_251_199, "2024-02-29T23:59:59Z"),
            (1_795_271_400, "2026-11-21T14:30:00Z"),
            (4_107_542_400, "2100-03-01T00:00:00Z"),
        ] {
            assert_eq!(utc(seconds), date);
        }
    }
}
