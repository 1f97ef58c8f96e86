//! `stage.sh`: the commands of every task of a job, the same for all systems.

use super::files::quoted;
use super::{FarmOptions, Job, plans_a_priori};
use crate::{Failure, Result};
use dapple_job::{BudgetSpec, RenderSpec};
use dapple_renderer::light::LightSelection;

/// How the parts of an image follow from each other.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Stages {
    /// Every part is rendered by one task; then all are merged.
    One,
    /// Parts are rendered stage by stage, each by the plan that was made of the parts before. `most` bounds the number of
    /// stages; `None` if it is unknown.
    Several { most: Option<u32> },
}

impl Stages {
    pub(super) fn of(spec: &RenderSpec, options: &FarmOptions) -> Self {
        // Learned light selection, the default, learns from the whole image.
        let is_counted = matches!(spec.budget, BudgetSpec::Scene | BudgetSpec::Spp(_) | BudgetSpec::Samples(_));
        if is_counted
            && plans_a_priori(&spec.sampler)
            && spec.light_selection.is_some_and(|how| how != LightSelection::Learned)
        {
            return Self::One;
        }
        let most = match spec.budget {
            BudgetSpec::Spp(spp) => Some(most_stages(spp)),
            _ => None,
        };
        Self::Several { most: options.stages.or(most) }
    }

    /// The number of stages of a job that must state it.
    pub(super) fn most(self) -> Result<u32> {
        match self {
            Self::One => Ok(1),
            Self::Several { most: Some(most) } => Ok(most),
            Self::Several { most: None } => Err(Failure::new(
                "the number of stages is not known beforehand; give --spp, or --stages N (later stages do nothing)",
            )),
        }
    }
}

/// A bound of the number of stages: training passes of 1, 1, 2, 4, … samples per pixel, and rounds of the sampler, which
/// may end within a pass.
fn most_stages(spp: f64) -> u32 {
    let passes = 1 + (spp.max(1.0).log2().ceil() as u32);
    /// Rounds of the default sampler, and some more for others.
    const ROUNDS: u32 = 5;
    passes + ROUNDS
}

/// The script of all tasks.
pub(super) fn script(job: &Job<'_>) -> String {
    let body = match job.stages {
        Stages::One => ONE,
        Stages::Several { .. } => SEVERAL,
    };
    let threads = if job.threads > 0 { format!(" --threads {}", job.threads) } else { String::new() };
    let memory = job.memory.map_or_else(String::new, |bytes| format!(" --memory {bytes}"));
    let outputs: String = job.images.iter().map(|image| format!(" -o {}", quoted(image))).collect();
    let text = format!("{HEAD}{body}{TAIL}");
    text.replace("@PARTS@", &job.options.parts.to_string())
        .replace("@TRIES@", &job.options.tries.to_string())
        .replace("@LIMITS@", &format!("{threads}{memory}"))
        .replace("@OUTPUTS@", &outputs)
}

const HEAD: &str = r#"#!/bin/sh
# Tasks of a render in @PARTS@ parts, written by dapple farm (docs/CLUSTER.md). What is done is skipped, so that every
# command can be repeated.
set -eu
cd "$(dirname "$0")"
dapple=${DAPPLE:-dapple}

# Runs a command until it succeeds, at most @TRIES@ times.
try() {
    left=@TRIES@
    until "$@"; do
        left=$((left - 1))
        if [ "$left" -le 0 ]; then
            echo "failed @TRIES@ times: $*" >&2
            return 1
        fi
        echo "trying again, $left times at most: $*" >&2
        sleep 1
    done
}

# Prints the numbers of the parts that are missing among the files FOLDER/PART.KIND.
missing() {
    part=1
    while [ "$part" -le @PARTS@ ]; do
        if [ ! -e "$1/$part.$2" ]; then printf ' %s' "$part"; fi
        part=$((part + 1))
    done
}

# Fails with the list of missing parts, if there are any.
complete() {
    absent=$(missing "$1" "$2")
    if [ -n "$absent" ]; then
        echo "missing parts in $1:$absent; render them again" >&2
        return 1
    fi
}

"#;

const ONE: &str = r#"# stage.sh render I    renders part I, from 1 to @PARTS@
# stage.sh merge       makes the image of all parts
# stage.sh await       waits until all parts are there, then makes the image
parts=parts-@PARTS@
mkdir -p "$parts"

render() {
    if [ -e "$parts/$1.shard" ]; then
        echo "part $1 is there already" >&2
        return 0
    fi
    status=0
    "$dapple" render --spec render.json --shard "$1/@PARTS@" -o "$parts/$1.shard" --quiet@LIMITS@ \
        --checkpoint "$parts/$1.checkpoint" --resume "$parts/$1.checkpoint" || status=$?
    # 3: the part is done, and no checkpoint could be written.
    if [ "$status" -ne 0 ] && [ "$status" -ne 3 ]; then return "$status"; fi
    rm -f "$parts/$1.checkpoint" "$parts/$1.checkpoint.previous" "$parts/$1.checkpoint.lock"
}

merge() {
    complete "$parts" shard || return 1
    "$dapple" merge "$parts"/*.shard@OUTPUTS@@LIMITS@
}

case ${1:-} in
    render) try render "$2" ;;
    merge) try merge ;;
    await)
        while [ -n "$(missing "$parts" shard)" ]; do sleep 10; done
        try merge
        ;;
"#;

const SEVERAL: &str = r#"# stage.sh render I [K]    renders part I, from 1 to @PARTS@, of stage K, by default the current one
# stage.sh plan [K]        makes the next plan of all parts of stage K
# stage.sh merge           makes the image after the last stage
# stage.sh is-done         succeeds after the last stage
# stage.sh current         prints the number of the current stage, after making the plan of stage 0
# stage.sh work I          renders part I of every stage and waits for the others; part 1 plans and merges
# Stages count from 0; K.plan is the plan of stage K, and stage-K has its parts.
stages=stages-@PARTS@
mkdir -p "$stages"

# The number of the newest plan; the first one is made here.
current() {
    if [ ! -e "$stages/0.plan" ]; then
        "$dapple" plan --spec render.json -o "$stages/0.plan"@LIMITS@ >&2 || return 1
    fi
    number=0
    while [ -e "$stages/$((number + 1)).plan" ]; do number=$((number + 1)); done
    echo "$number"
}

is_done() {
    [ -e "$stages/done" ]
}

render() {
    if is_done; then return 0; fi
    stage=${2:-$(current)} || return 1
    folder=$stages/stage-$stage
    mkdir -p "$folder"
    if [ -e "$folder/$1.part" ] || [ -e "$stages/$((stage + 1)).plan" ]; then
        echo "part $1 of stage $stage is there already" >&2
        return 0
    fi
    "$dapple" render --from "$stages/$stage.plan" --shard "$1/@PARTS@" -o "$folder/$1.part" --quiet@LIMITS@
}

plan() {
    if is_done; then return 0; fi
    stage=${1:-$(current)} || return 1
    if [ -e "$stages/$((stage + 1)).plan" ]; then return 0; fi
    folder=$stages/stage-$stage
    complete "$folder" part || return 1
    said=$("$dapple" plan "$folder"/*.part --from "$stages/$stage.plan" -o "$stages/$((stage + 1)).plan"@LIMITS@) || return 1
    echo "$said"
    case $said in *": done after "*) : >"$stages/done" ;; esac
    rm -rf "$folder"
}

merge() {
    if ! is_done; then
        echo "stages are left after plan $(current); render and plan them, or write the job with more --stages" >&2
        return 1
    fi
    "$dapple" merge "$stages/$(current).plan"@OUTPUTS@@LIMITS@
}

work() {
    if [ "$1" -ne 1 ]; then
        while [ ! -e "$stages/0.plan" ]; do sleep 1; done
    fi
    while ! is_done; do
        now=$(current) || return 1
        try render "$1" "$now" || return 1
        if [ "$1" -eq 1 ]; then
            while [ -n "$(missing "$stages/stage-$now" part)" ]; do sleep 1; done
            try plan "$now" || return 1
        else
            while ! is_done && [ ! -e "$stages/$((now + 1)).plan" ]; do sleep 1; done
        fi
    done
    if [ "$1" -eq 1 ]; then try merge; fi
}

case ${1:-} in
    render) try render "$2" ${3:+"$3"} ;;
    plan) try plan ${2:+"$2"} ;;
    merge) try merge ;;
    is-done) is_done ;;
    current) try current ;;
    work) work "$2" ;;
"#;

const TAIL: &str = r#"    *)
        sed -n 's/^# stage.sh/usage: stage.sh/p' stage.sh >&2
        exit 2
        ;;
esac
"#;
