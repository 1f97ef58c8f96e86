#!/bin/sh
# Submits all parts of the present stage, and the task after them, which submits the next stage. Options of sbatch, such as
# --partition=NAME, are passed on. Parts that are done end at once, so that a failed job is submitted again as it is.
set -eu
cd @FOLDER@
if sh stage.sh is-done; then exec sh stage.sh merge; fi
stage=$(sh stage.sh current)
echo "stage $stage"
render=$(sbatch --parsable "$@" render.sbatch "$stage")
plan=$(sbatch --parsable --dependency="afterok:${render%%;*}" --kill-on-invalid-dep=yes "$@" plan.sbatch "$stage" "$@")
echo "array ${render%%;*} of @PARTS@ parts, then plan ${plan%%;*}"
