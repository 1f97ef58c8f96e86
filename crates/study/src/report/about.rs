//! The origin of a study's figures (program, machine, settings), and warnings about their reliability.

use crate::{Manifest, RecordedStudy};

/// The commit of the program that ran the study, or a statement that it is unknown.
pub(super) fn commit(m: &Manifest) -> String {
    let unknown = || format!("unknown (version {} was built without git)", m.version);
    m.commit.clone().unwrap_or_else(unknown)
}

/// The rules of light selection in the study, each once.
pub(super) fn lights(manifest: &Manifest) -> String {
    let mut names: Vec<&str> = manifest.scenes.iter().map(|scene| scene.lights.name()).collect();
    names.dedup();
    if names.len() == 1 { names[0].to_owned() } else { format!("{}, scene by scene", names.join(", ")) }
}

/// The largest load per core at which a machine counts as idle. The study's own threads cause a load of 1.
const IDLE: f64 = 1.1;

/// A warning if the load before some run was above the number of cores: other programs then slowed the study. If the number of
/// cores is not recorded, the number of threads is used.
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
    let rejected = recorded.runs.iter().filter(|run| run.rejected > 0).count();
    let foreign = "Lines of runs.jsonl left out, since they belong to no scene, method, budget or seed of this study";
    let counts = [
        (recorded.foreign, foreign),
        (recorded.repeated, "Repeated runs, of which only the last counts"),
        (usize::from(recorded.torn), "Incomplete lines of runs.jsonl left out"),
        (rejected, "Runs with samples that were NaN, infinite or negative"),
    ];
    let found = counts.into_iter().filter(|(count, _)| *count > 0);
    found.map(|(count, words)| format!("{words}: {count}.")).collect()
}

/// The range of the load averages before the runs.
pub(super) fn load(recorded: &RecordedStudy) -> String {
    let loads = || recorded.runs.iter().filter_map(|run| run.load);
    match loads().reduce(f64::min).zip(loads().reduce(f64::max)) {
        Some((low, high)) => format!("{low:.2} to {high:.2} (one-minute average before each run)"),
        None => "unknown".into(),
    }
}

/// The command line, quoted so that a shell parses the same arguments.
pub(super) fn quoted(command: &[String]) -> String {
    let quote = |word: &String| {
        let plain = !word.is_empty() && word.chars().all(|c| c.is_ascii_alphanumeric() || "-_./=:,+@%".contains(c));
        if plain { word.clone() } else { format!("'{}'", word.replace('\'', "'\\''")) }
    };
    command.iter().map(quote).collect::<Vec<_>>().join(" ")
}
