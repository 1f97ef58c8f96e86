#!/bin/sh
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

# stage.sh render I [K]    renders part I, from 1 to @PARTS@, of stage K, by default the current one
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
    status=0
    "$dapple" render --from "$stages/$stage.plan" --part "$1/@PARTS@" -o "$folder/$1.part" --quiet@LIMITS@ \
        --checkpoint "$folder/$1.checkpoint" --resume "$folder/$1.checkpoint" || status=$?
    # 3: the part is done, and no checkpoint could be written.
    if [ "$status" -ne 0 ] && [ "$status" -ne 3 ]; then return "$status"; fi
}

plan() {
    if is_done; then return 0; fi
    stage=${1:-$(current)} || return 1
    if [ -e "$stages/$((stage + 1)).plan" ]; then return 0; fi
    folder=$stages/stage-$stage
    complete "$folder" part || return 1
    said=$("$dapple" plan "$folder"/*.part --from "$stages/$stage.plan" -o "$stages/$((stage + 1)).plan"@LIMITS@) || return 1
    echo "$said"
    case $said in *": done; "*) : >"$stages/done" ;; esac
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
    *)
        sed -n 's/^# stage.sh/usage: stage.sh/p' stage.sh >&2
        exit 2
        ;;
esac
