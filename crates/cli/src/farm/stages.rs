//! `stage.sh`: the commands of every task of a job, the same for all systems.

use super::files::quoted;
use super::{Job, plans_a_priori};
use crate::{Failure, Result};
use dapple_job::RenderSpec;

/// How the parts of an image follow from each other.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Stages {
    /// Every part is rendered by one task; then all are merged.
    One,
}

impl Stages {
    pub(super) fn of(spec: &RenderSpec) -> Result<Self> {
        if plans_a_priori(&spec.sampler) {
            return Ok(Self::One);
        }
        Err(Failure::new(format!(
            "sampler \"{}\" plans from samples of the whole image; take --sampler uniform, or start all machines together \
             by mpirun",
            spec.sampler
        )))
    }
}

/// The script of one stage.
pub(super) fn script(job: &Job<'_>) -> String {
    let options = job.options;
    let threads = if job.threads > 0 { format!(" --threads {}", job.threads) } else { String::new() };
    let memory = job.memory.map_or_else(String::new, |bytes| format!(" --memory {bytes}"));
    let outputs: String = job.images.iter().map(|image| format!(" -o {}", quoted(image))).collect();
    format!(
        r#"#!/bin/sh
# Tasks of a render in {parts} parts, written by dapple farm (docs/CLUSTER.md).
#   stage.sh render I    renders part I, from 1 to {parts}
#   stage.sh merge       makes the image of all parts
#   stage.sh await       waits until all parts are there, then makes the image
# What is done is skipped, so that every command can be repeated.
set -eu
cd "$(dirname "$0")"
dapple=${{DAPPLE:-dapple}}
mkdir -p parts-{parts}

# Runs a command until it succeeds, at most {tries} times.
try() {{
    left={tries}
    until "$@"; do
        left=$((left - 1))
        if [ "$left" -le 0 ]; then
            echo "failed {tries} times: $*" >&2
            return 1
        fi
        echo "trying again, $left times at most: $*" >&2
        sleep 1
    done
}}

render() {{
    if [ -e "parts-{parts}/$1.shard" ]; then
        echo "part $1 is there already" >&2
        return 0
    fi
    set +e
    "$dapple" render --spec render.json --shard "$1/{parts}" -o "parts-{parts}/$1.shard" --quiet{threads}{memory} \
        --checkpoint "parts-{parts}/$1.checkpoint" --resume "parts-{parts}/$1.checkpoint"
    status=$?
    set -e
    # 3: the part is done, and no checkpoint could be written.
    if [ "$status" -ne 0 ] && [ "$status" -ne 3 ]; then return "$status"; fi
    rm -f "parts-{parts}/$1.checkpoint" "parts-{parts}/$1.checkpoint.previous" "parts-{parts}/$1.checkpoint.lock"
}}

missing() {{
    part=1
    while [ "$part" -le {parts} ]; do
        if [ ! -e "parts-{parts}/$part.shard" ]; then printf ' %s' "$part"; fi
        part=$((part + 1))
    done
}}

merge() {{
    left=$(missing)
    if [ -n "$left" ]; then
        echo "missing parts:$left; render them by stage.sh render I" >&2
        return 1
    fi
    part=1
    set --
    while [ "$part" -le {parts} ]; do
        set -- "$@" "parts-{parts}/$part.shard"
        part=$((part + 1))
    done
    "$dapple" merge "$@"{outputs}{threads}{memory}
}}

case ${{1:-}} in
    render) try render "$2" ;;
    merge) try merge ;;
    await)
        while [ -n "$(missing)" ]; do sleep 10; done
        try merge
        ;;
    *)
        echo "usage: stage.sh render I | merge | await" >&2
        exit 2
        ;;
esac
"#,
        parts = options.parts,
        tries = options.tries,
    )
}
