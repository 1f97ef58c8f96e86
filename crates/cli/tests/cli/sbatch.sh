#!/bin/sh
set -u
jobs="$(dirname "$0")/jobs"
mkdir -p "$jobs"
number=$(($(ls "$jobs" | wc -l) + 1))
script=
arguments=
for word in "$@"; do
    if [ -n "$script" ]; then
        arguments="$arguments $word"
        continue
    fi
    case $word in
        --dependency=afterok:*) [ "$(cat "$jobs/${word#--dependency=afterok:}")" = ok ] || exit 1 ;;
        --*) ;;
        *) script=$word ;;
    esac
done
echo running > "$jobs/$number"
array=$(sed -n 's/^#SBATCH --array=1-\([0-9]*\)$/\1/p' "$script")
result=ok
task=1
while [ "$task" -le "${array:-1}" ]; do
    SLURM_ARRAY_TASK_ID=$task sh "$script" $arguments >> "$jobs/../log" 2>&1 || result=failed
    task=$((task + 1))
done
echo "$result" > "$jobs/$number"
echo "$number"
