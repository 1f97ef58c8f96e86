//! The origin of a study's figures: program, machine, settings, and warnings about them.

use super::table_cell::short;
use crate::record::SceneRecord;
use crate::recorded_study::RecordedStudy;

/// The commit of the program that made the study, or a sentence that it is unknown.
pub(super) fn commit(recorded: &RecordedStudy) -> String {
    let m = &recorded.manifest;
    let unknown = || format!("unknown (this build of version {} came without git)", m.version);
    m.commit.clone().unwrap_or_else(unknown)
}

/// The rules of light selection in the study, each once.
fn lights(recorded: &RecordedStudy) -> String {
    let mut names: Vec<&str> = recorded.manifest.scenes.iter().map(|scene| scene.lights.name()).collect();
    names.dedup();
    if names.len() == 1 { names[0].to_owned() } else { format!("{}, scene by scene", names.join(", ")) }
}

/// The largest load per core of a machine that counts as idle. The study's own threads cause a load of 1.
const IDLE: f64 = 1.1;

/// A warning if other programs took time from the study: the load was above the number of cores before a run. Studies
/// that do not record their cores are judged by their threads.
pub(super) fn busy(recorded: &RecordedStudy) -> Option<String> {
    let machine = &recorded.manifest.machine;
    let cores = machine.cores.unwrap_or(machine.threads).max(1);
    let loads = || recorded.runs.iter().filter_map(|run| run.load);
    let above = loads().filter(|load| *load > IDLE * cores as f64).count();
    let most = loads().fold(0.0, f64::max);
    let plural = if cores == 1 { "" } else { "s" };
    (above > 0).then(|| {
        format!(
            "the load was up to {most:.1} on {cores} core{plural}, and above the cores before {above} of {} runs. Seconds \
             and verdicts at equal time are unreliable; CPU seconds in runs.csv are less affected. Repeat the study on an \
             idle machine.",
            recorded.runs.len()
        )
    })
}

/// Sentences about unusual records: foreign, repeated or incomplete lines of `runs.jsonl`, and rejected samples.
pub(super) fn remarks(recorded: &RecordedStudy) -> Vec<String> {
    let mut remarks = Vec::new();
    let mut remark = |count: usize, words: &str| {
        if count > 0 {
            remarks.push(format!("{count} {words}"));
        }
    };
    remark(
        recorded.foreign,
        "lines of runs.jsonl belong to no scene, method, budget or seed of this study and were left out.",
    );
    remark(recorded.repeated, "runs were made twice; the last one counts.");
    remark(usize::from(recorded.torn), "line of runs.jsonl was cut off at its end and was left out.");
    let rejected = recorded.runs.iter().filter(|run| run.rejected > 0).count();
    remark(rejected, "runs had samples that were NaN, infinite or negative.");
    let mut machines: Vec<&str> = recorded.runs.iter().filter_map(|run| run.machine.as_deref()).collect();
    machines.sort_unstable();
    machines.dedup();
    if machines.len() > 1 {
        remarks.push(format!(
            "The runs were made on machines of {} kinds ({}), so that seconds of different runs cannot be compared; errors \
             can.",
            machines.len(),
            machines.join("; ")
        ));
    }
    remarks
}

pub(super) fn made(recorded: &RecordedStudy) -> Vec<(&'static str, String)> {
    let m = &recorded.manifest;
    let unknown = || "unknown".to_owned();
    let loads: Vec<f64> = recorded.runs.iter().filter_map(|run| run.load).collect();
    let load = if loads.is_empty() {
        unknown()
    } else {
        let [low, high] =
            [loads.iter().copied().fold(f64::INFINITY, f64::min), loads.iter().copied().fold(0.0, f64::max)];
        format!("{low:.2} to {high:.2} (one-minute average before each run)")
    };
    let fresh = recorded.runs.iter().filter(|run| run.fresh).count();
    let quote = |word: &String| {
        let plain = !word.is_empty() && word.chars().all(|c| c.is_ascii_alphanumeric() || "-_./=:,+@%".contains(c));
        if plain { word.clone() } else { format!("'{}'", word.replace('\'', "'\\''")) }
    };
    vec![
        ("Command", m.command.iter().map(quote).collect::<Vec<_>>().join(" ")),
        ("Version", m.version.clone()),
        ("Commit", commit(recorded)),
        ("Began", m.began.clone()),
        ("Processor", m.machine.processor.clone().unwrap_or_else(unknown)),
        ("Threads", m.machine.threads.to_string()),
        ("Cores", m.machine.cores.map_or_else(unknown, |cores| cores.to_string())),
        ("Light selection", lights(recorded)),
        ("System", m.machine.system.clone()),
        ("Load", load),
        ("Depth", m.max_depth.map_or_else(|| "each scene's".into(), |depth| format!("at most {depth}"))),
        ("Processes", format!("{fresh} of {} runs in a process of their own", recorded.runs.len())),
        ("Seeds", m.seeds.iter().map(u64::to_string).collect::<Vec<_>>().join(", ")),
        ("Runs", format!("{} of {}", recorded.runs.len(), recorded.expected())),
    ]
}

pub(super) fn reference(scene: &SceneRecord) -> [String; 5] {
    let r = &scene.reference;
    let unknown = || "unknown".to_owned();
    let seeds = r.seeds.map(|s| format!(", seeds {} and {}", s[0], s[1])).unwrap_or_default();
    let points = r.points.as_ref().map(|p| format!("{p}{seeds}"));
    let spp = r.spp.map(|spp| spp.to_string());
    let short_hash: String = r.hash.chars().take(16).collect();
    [
        r.file.clone(),
        spp.unwrap_or_else(unknown),
        points.unwrap_or_else(unknown),
        r.relmse.map_or_else(unknown, short),
        short_hash,
    ]
}
