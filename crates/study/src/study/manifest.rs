//! The file `study.json`: writing, reading and comparing the settings of a study.

use crate::{Machine, Manifest, Method, Plan, SceneRecord, StudyError};
use serde::Deserialize;
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::time::{SystemTime, UNIX_EPOCH};

/// The git commit of the build, found by the build script; empty if it is unknown.
const COMMIT: &str = env!("DAPPLE_BUILD_COMMIT");

/// Makes the manifest of a study that begins now.
pub(super) fn new(plan: &Plan, scenes: Vec<SceneRecord>, command: &[String]) -> Manifest {
    Manifest {
        version: env!("CARGO_PKG_VERSION").to_owned(),
        commit: (!COMMIT.is_empty()).then(|| COMMIT.to_owned()),
        command: command.to_vec(),
        began: utc(SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |d| d.as_secs())),
        machine: machine(plan.threads),
        scenes,
        methods: plan.methods.clone(),
        external: plan.external.clone(),
        baseline: plan.baseline.clone(),
        spp: plan.spp.clone(),
        time_of: plan.time_of,
        seeds: plan.seeds.clone(),
        max_depth: plan.max_depth,
        fresh: plan.fresh,
    }
}

fn machine(threads: usize) -> Machine {
    let cpuinfo = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let named = |line: &str| {
        let (key, name) = line.split_once(':')?;
        (key.trim() == "model name").then(|| name.trim().to_owned())
    };
    Machine {
        processor: cpuinfo.lines().find_map(named),
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

/// Reads a manifest from `study.json`; `None` if the file does not exist.
pub(super) fn read(file: &Path) -> Result<Option<Manifest>, StudyError> {
    let bytes = match std::fs::read(file) {
        Ok(bytes) => bytes,
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => return Ok(None),
        Err(e) => return Err(StudyError::file(file, "read the study's settings", e)),
    };
    let refuse = |e: serde_json::Error| StudyError::Line { file: file.to_owned(), line: e.line(), why: e.to_string() };
    serde_json::from_slice(&bytes).map(Some).map_err(refuse)
}

/// Encodes a manifest as the text of `study.json`.
pub(super) fn bytes(manifest: &Manifest) -> Vec<u8> {
    // Serialising plain numbers and text cannot fail.
    let mut bytes = serde_json::to_vec_pretty(manifest).unwrap_or_default();
    bytes.push(b'\n');
    bytes
}

/// Lists the settings that differ between two manifests, one line each. Start time, command line, number of cores, and
/// the references' paths and variance are ignored, and a commit if one of the two is unknown.
pub(super) fn differences(there: &Manifest, here: &Manifest) -> Vec<String> {
    let plain = |manifest: &Manifest| {
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
        serde_json::to_value(plain).unwrap_or_default()
    };
    let mut found = Vec::new();
    compare("", &plain(there), &plain(here), &mut found);
    found
}

/// Compares two JSON values recursively and adds a line for each difference to `found`. Lists that differ are shown as
/// a whole.
fn compare(place: &str, there: &Value, here: &Value, found: &mut Vec<String>) {
    if there == here {
        return;
    }
    match (there, here) {
        (Value::Object(a), Value::Object(b)) => {
            for (key, value) in a {
                let place = if place.is_empty() { key.clone() } else { format!("{place}.{key}") };
                compare(&place, value, b.get(key).unwrap_or(&Value::Null), found);
            }
        }
        (Value::Array(a), Value::Array(b)) if place == "scenes" && a.len() == b.len() => {
            for (a, b) in a.iter().zip(b) {
                let place = format!("scene {}", readable(&a["name"]));
                compare(&place, a, b, found);
            }
        }
        _ if place.ends_with("reference.hash") => {
            let scene = place.trim_end_matches(".reference.hash");
            found.push(format!("{scene} or its reference has changed since"));
        }
        _ => found.push(format!("{place}: {}, not {}", readable(there), readable(here))),
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

    #[test]
    fn dates_match_the_calendar() {
        // From GNU date -u -d @N.
        assert_eq!(utc(0), "1970-01-01T00:00:00Z");
        assert_eq!(utc(951_782_400), "2000-02-29T00:00:00Z");
        assert_eq!(utc(1_709_251_199), "2024-02-29T23:59:59Z");
        assert_eq!(utc(1_795_271_400), "2026-11-21T14:30:00Z");
        assert_eq!(utc(4_107_542_400), "2100-03-01T00:00:00Z");
    }
}
