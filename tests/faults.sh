#!/bin/bash
# Faults: the program is killed, the disk is full, memory or the device fails, files vanish, signals
# storm, clocks jump; each at the k-th call of the program that it concerns (support/faults.c). After
# each: an exit code and a sentence, a last checkpoint that is whole, and a training that goes on
# from there to the very weights of one that nothing happened to.
#
#   tests/faults.sh [SECTION...]   sections: kill disk memory device files signals clock
#   FAULTS=50                      moments in each section; make test takes 2
#   FAULT_SEED=1                   chooses them
# Every check is one line of the count in the last line; the output of a failed one is shown.
set -u
cd "$(dirname "$0")/.." || exit 1

BUILD=${BUILD:-build}
here=$PWD
cln=$here/$BUILD/cl-nascent
make_scene=$here/$BUILD/make-scene
shim=$here/build/faults.so
moments=${FAULTS:-50}
RANDOM=${FAULT_SEED:-1}
work=$(mktemp -d "${TMPDIR:-/tmp}/cln-faults-XXXXXX")
trap 'chmod -R u+w "$work"; rm -rf "$work"' EXIT

# A tree that grows, is culled and restructured on the way.
small=(--skip-selftest --progress none --width 16 --depth 2 --view-width 16 --view-bands 1 --bands 4
    --start-level 1 --level-at 2:0.4 --n1 8 --rays 256 --batch-samples 4096 --refresh-every 16
    --log-every 1 --cull-from 0.3 --cull-after 0 --max-leaves 60
    --structure-from 0.5 --structure-every 0.1 --structure-until 0.95 --split-samples 0
    --distil-steps 5 --save-every 1)
steps=40
whole="" total=0

. tests/support/checks.sh

# ---- checks of its own ----

# faulty CALL AT DO COMMAND...: the command with a fault. Its clock is so fast that --save-every 1
# means every few steps.
faulty() {
    local call=$1 at=$2 how=$3
    shift 3
    # the shell would tell of a killed one
    { run env LD_PRELOAD="$shim" FAULT_CALL="$call" FAULT_AT="$at" FAULT_DO="$how" \
        FAULT_SPEED=20 FAULT_LOG="$work/log" "$@"; } 2>/dev/null
}

train() {
    echo "$cln" train "$work/scene" -o "$1" "${small[@]}" --steps $steps
}

resume() {
    echo "$cln" train --resume "$1" --skip-selftest --progress none
}

digest() {
    "$cln" info "$1" --json 2>/dev/null | "$query" model_digest
}

# The run that others are compared with; total: its calls of a kind.
whole_run() {
    [ -d "$work/scene" ] || "$make_scene" "$work/scene" --size 24 --train 8 --test 2 >/dev/null
    if [ ! -d "$work/whole" ]; then
        run $(train "$work/whole")
        whole=$(digest "$work/whole")
        check "a run that nothing happens to" grep -qxE '[0-9a-f]{16}' <<<"$whole"
    fi
}

# total: the calls of a kind in a training
count_calls() {
    rm -rf "$work/run"
    faulty "$1" 0 once $(train "$work/run")
    read -r total _ <"$work/log"
    [ "${total:-0}" -gt 0 ]
}

# A number from 1 to $1.
one_of() {
    echo $(((RANDOM * 32768 + RANDOM) % $1 + 1))
}

# A fault that the program lived through: a code of its own, and a sentence if it is not 0.
ended_well() {
    [ $rc = 0 ] || { [ $rc -lt 11 ] && [ $rc != 1 ] && said "cl-nascent: "; } ||
        { [ $rc = 130 ] || [ $rc = 143 ]; } && ! said "sanitizer"
}

# The run goes on, or is begun anew if it says that it has no checkpoint, and ends as the whole one.
# $1: the run; $2: a name.
goes_on() {
    local again="" step
    run $(resume "$1")
    if [ $rc != 0 ] && ! ls "$1"/checkpoint/*.json >/dev/null 2>&1; then
        again=", begun anew"
        if ! said "cl-nascent: "; then
            bad "$2: resumed" "exit code $rc"
            return
        fi
        rm -rf "$1"
        run $(train "$1")
    fi
    step=$(digest "$1")
    if [ $rc != 0 ] || [ "$step" != "$whole" ]; then
        bad "$2$again: it goes on to the same weights" "exit code $rc, digest $step, not $whole"
    elif ! cmp -s <(grep -v '"event"' "$1/metrics.jsonl" | "$query" -l step) <(seq $steps); then
        bad "$2$again: every step has a row" "$(grep -v '"event"' "$1/metrics.jsonl" | wc -l) rows"
    elif ls "$1"/checkpoint/*.tmp.* >/dev/null 2>&1; then
        bad "$2$again: no checkpoint is left half-written" "$(ls "$1"/checkpoint)"
    else
        ok "$2$again"
    fi
}

# each KIND DO...: moments of a training, then it goes on
each_moment() {
    local kind=$1 i at how
    shift
    for how in "$@"; do
        for ((i = 0; i < moments; i++)); do
            rm -rf "$work/run"
            at=$(one_of "$total")
            faulty "$kind" "$at" "$how" $(train "$work/run")
            local name="$kind, $how at call $at of $total"
            [ ! -s "$work/log" ] || name="$name ($(cut -d' ' -f2- "$work/log"))"
            if ! ended_well; then
                bad "$name: an exit code and a sentence" "exit code $rc"
                cp -r "$work/run" "$work/err" /tmp/ft/bad 2>/dev/null
                continue
            fi
            [ $rc = 0 ] && [ "$(digest "$work/run")" = "$whole" ] && ok "$name: in vain" && continue
            goes_on "$work/run" "$name: exit code $rc"
        done
    done
}

# ---- sections ----

section_kill() {
    local i at place
    count_calls any
    for ((i = 0; i < moments; i++)); do
        rm -rf "$work/run"
        place=""
        faulty any "$(one_of "$total")" kill $(train "$work/run")
        while at=$(one_of $((2 * total))) && [ $rc = 137 ]; do
            place="$place $(ls "$work/run/checkpoint" 2>/dev/null | grep -c json)"
            if ls "$work/run"/checkpoint/*.json >/dev/null 2>&1; then
                faulty any "$at" kill $(resume "$work/run")
            else
                rm -rf "$work/run"
                faulty any "$at" kill $(train "$work/run")
            fi
        done
        goes_on "$work/run" "killed (checkpoints then:$place)"
    done
}

section_disk() {
    count_calls write
    each_moment write full once
}

section_memory() {
    count_calls memory
    each_moment memory once full
}

section_device() {
    count_calls device
    each_moment device once full
}

section_files() {
    count_calls read
    each_moment read once full
}

section_signals() {
    count_calls any
    each_moment any term int storm
}

section_clock() {
    count_calls clock
    each_moment clock jump
}

all="kill disk memory device files signals clock"
whole_run
run_sections "$all" "$@"
