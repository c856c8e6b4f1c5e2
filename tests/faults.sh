#!/bin/bash
# Faults: the program is killed, the disk is full, memory or the device fails, a kernel returns NaN,
# files vanish or change while they are read, signals storm, clocks jump; each at the k-th call of
# the function that it concerns (support/faults.c).
# After each there must be an exit code and a sentence, an intact last checkpoint, and a training
# that resumes from it to the same weights as an undisturbed one.
#
#   tests/faults.sh [SECTION...]   sections: kill disk memory device nan files changing signals
#                                  clock results small means groups untimed
#   FAULTS=50                      moments for each kind of fault; make test-all takes 1
#   FAULT_SEED=1                   chooses them
# Every check is one line of the count in the last line; the output of a failed one is shown.
set -u
cd "$(dirname "$0")/.." || exit 1

shim=$PWD/build/faults.so
moments=${FAULTS:-50}
RANDOM=${FAULT_SEED:-1}
work=$(mktemp -d "${TMPDIR:-/tmp}/cln-faults-XXXXXX")
trap 'chmod -R u+w "$work"; rm -rf "$work"' EXIT

. tests/support/checks.sh

small=("${adapted[@]}" --distil-steps 5 --save-every 1)
steps=40
whole="" total=0 rc=0 what=""
fresh=("$cln" train "$work/scene" -o "$work/run" "${small[@]}" --steps "$steps")
again=("$cln" train --resume "$work/run" --skip-selftest --progress none)

# ---- checks of its own ----

# faulty CALL AT DO COMMAND...: runs the command with a fault. Its clock is so fast that
# --save-every 1 means every few steps.
faulty() {
    local call=$1 at=$2 how=$3
    shift 3
    # the shell would report a killed command
    { run env LD_PRELOAD="$shim" FAULT_CALL="$call" FAULT_AT="$at" FAULT_DO="$how" \
        FAULT_SPEED=20 FAULT_LOG="$work/log" "$@"; } 2>/dev/null
}

step_rows() {
    grep -v '"event"' "$work/run/metrics.jsonl"
}

# The run that others are compared with; total: its calls of a kind.
whole_run() {
    [ -d "$work/scene" ] || "$make_scene" "$work/scene" --size 24 --train 8 --test 2 >/dev/null
    run "${fresh[@]}"
    mv "$work/run" "$work/whole"
    whole=$(digest "$work/whole")
    check "an undisturbed run" grep -qxE '[0-9a-f]{16}' <<<"$whole"
}

# total: the calls of a kind in a training; without any, nothing is tested
count_calls() {
    rm -rf "$work/run" "$work/log"
    faulty "$1" 0 once "${fresh[@]}"
    total=0
    [ ! -s "$work/log" ] || read -r total _ <"$work/log"
    if [ "$total" -eq 0 ]; then
        bad "calls of $1 are counted" "no log of $shim (make $shim)"
        return 1
    fi
}

# A number from 1 to $1.
one_of() {
    echo $(((RANDOM * 32768 + RANDOM) % $1 + 1))
}

# The program handled the fault: an exit code of its own, and a sentence if it is not 0.
ended_well() {
    [ $rc = 0 ] || { [ $rc -lt 11 ] && [ $rc != 1 ] && said "cl-nascent: "; } ||
        { [ $rc = 130 ] || [ $rc = 143 ]; } && ! said "sanitizer"
}

# The run is resumed, or begun again if it says that it has no checkpoint, and ends like the
# undisturbed one. $1: a name.
goes_on() {
    local anew="" step
    run "${again[@]}"
    if [ $rc != 0 ] && ! ls "$work/run"/checkpoint/*.json >/dev/null 2>&1; then
        anew=", begun again"
        if ! said "cl-nascent: "; then
            bad "$1: resumed" "exit code $rc"
            return
        fi
        rm -rf "$work/run"
        run "${fresh[@]}"
    fi
    step=$(digest "$work/run")
    if [ $rc != 0 ] || [ "$step" != "$whole" ]; then
        bad "$1$anew: it ends with the same weights" "exit code $rc, digest $step, not $whole"
    elif ! cmp -s <(step_rows | "$query" -l step) <(seq $steps); then
        bad "$1$anew: every step has a row" "$(step_rows | wc -l) rows"
    elif ls "$work/run"/checkpoint/*.tmp.* >/dev/null 2>&1; then
        bad "$1$anew: no checkpoint is left half-written" "$(ls "$work/run"/checkpoint)"
    else
        ok "$1$anew"
    fi
}

# each KIND DO...: faults at moments of a training, which then resumes
each_moment() {
    local kind=$1 i at how
    shift
    for how in "$@"; do
        for ((i = 0; i < moments; i++)); do
            rm -rf "$work/run"
            at=$(one_of "$total")
            faulty "$kind" "$at" "$how" "${fresh[@]}"
            local name="$kind, $how at call $at of $total"
            [ ! -s "$work/log" ] || name="$name ($(cut -d' ' -f2- "$work/log"))"
            if ! ended_well; then
                bad "$name: an exit code and a sentence" "exit code $rc"
                continue
            fi
            [ $rc = 0 ] && [ "$(digest "$work/run")" = "$whole" ] && ok "$name: no harm" && continue
            # a driver that builds no kernel: plain ones, which it announces, sum in another order
            [[ $kind$rc = @(device|any)0 ]] && said "plain ones are used" && ok "$name: told" &&
                continue
            goes_on "$name: exit code $rc"
        done
    done
}

# ---- sections ----

section_kill() {
    local i at place
    count_calls any || return
    for ((i = 0; i < moments; i++)); do
        rm -rf "$work/run"
        place=""
        faulty any "$(one_of "$total")" kill "${fresh[@]}"
        while at=$(one_of $((2 * total))) && [ $rc = 137 ]; do
            place="$place $(find "$work/run" -path '*/checkpoint/*.json' 2>/dev/null | wc -l)"
            if ls "$work/run"/checkpoint/*.json >/dev/null 2>&1; then
                faulty any "$at" kill "${again[@]}"
            else
                rm -rf "$work/run"
                faulty any "$at" kill "${fresh[@]}"
            fi
        done
        if [ $rc != 0 ]; then # the last command, in which nothing was killed
            bad "killed (checkpoints then:$place), then not: it ends well" "exit code $rc"
            continue
        fi
        goes_on "killed (checkpoints then:$place)"
    done
}

section_disk() {
    count_calls write &&
        each_moment write full once
}

section_memory() {
    count_calls memory &&
        each_moment memory once full
}

section_device() {
    count_calls device &&
        each_moment device once full
}

# A kernel leaves NaN in one of its outputs. Either it is overwritten before it does harm, and all
# losses and the last weights are numbers; or the training ends as diverged, and its last checkpoint
# is none of the harmed: the training goes on from there.
section_nan() {
    local i at name
    count_calls launch || return
    for ((i = 0; i < moments; i++)); do
        rm -rf "$work/run"
        at=$(one_of "$total")
        faulty launch "$at" nan "${fresh[@]}"
        name="NaN after launch $at of $total ($(cut -d' ' -f2- "$work/log")): exit code $rc"
        if [ $rc != 0 ]; then
            if ! { [ $rc = 6 ] && said "diverged" && said "--lr"; }; then
                bad "$name: diverged, with a way out"
                continue
            fi
            if ls "$work/run"/checkpoint/*.json >/dev/null 2>&1; then
                run "${again[@]}"
                name="$name, resumed"
            fi
        fi
        if [ $rc != 0 ] && ls "$work/run"/checkpoint/*.json >/dev/null 2>&1; then
            bad "$name: the last checkpoint is intact" "exit code $rc"
        elif [ $rc = 0 ] && { ! cmp -s <(step_rows | "$query" -l step) <(seq $steps) ||
            step_rows | grep -q '"loss":null' ||
            ! number_above "$("$query" result.psnr_train <"$work/run/run.json")" 3; }; then
            bad "$name: all losses are numbers" "$(step_rows | grep -m 1 null)"
        else
            ok "$name"
        fi
    done
}

section_files() {
    count_calls read &&
        each_moment read once full
}

# changing NAME FOLDER RUN COMMAND...: files below FOLDER change while a command reads them. RUN
# ends as it does without that, or the command says which file it cannot read; a warning is enough
# for one that matters only to the report.
changing() {
    local name=$1 under=$2 ends=$3 how i at same
    shift 3
    export FAULT_UNDER=$under FAULT_WITH=$work/other/train/r_000.png
    renew
    faulty file 0 once "$@"
    check "$name: undisturbed" [ $rc = 0 ]
    same=$(digest "$ends")
    read -r total _ <"$work/log"
    check "$name: files are read" [ "$total" -gt 2 ]
    for how in cut garble swap; do
        for ((i = 0; i < moments; i++)); do
            at=$(one_of "$total")
            renew
            faulty file "$at" "$how" "$@"
            what="$name, $how of file $at of $total ($(cut -d' ' -f2- "$work/log"))"
            if [ $rc = 0 ] && [ "$(digest "$ends")" = "$same" ]; then
                ok "$what: no harm"
            elif ended_well && said "$(cut -d' ' -f2- "$work/log")"; then
                ok "$what: exit code $rc"
            else
                bad "$what: no harm, or a sentence names the file" "exit code $rc"
            fi
        done
    done
    unset FAULT_UNDER FAULT_WITH
}

# The scene, and the undisturbed run on it.
renew() {
    rm -rf "$work/now"
    mkdir "$work/now"
    cp -r "$work/scene" "$work/now/scene"
    cp -r "$work/whole" "$work/now/run"
}

section_changing() {
    [ -d "$work/other" ] || "$make_scene" "$work/other" --size 16 --train 1 --test 1 >/dev/null
    changing "a training's photos" "$work/now/scene" "$work/now/new" "$cln" train \
        "$work/now/scene" -o "$work/now/new" "${small[@]}" --steps 2
    changing "a run that is resumed" "$work/now/run" "$work/now/run" "$cln" train \
        --resume "$work/now/run" --skip-selftest --progress none --steps $((steps + 1))
    changing "a run that is measured" "$work/now/run" "$work/now/run" "$cln" eval \
        "$work/now/run" --progress none
}

section_signals() {
    count_calls any &&
        each_moment any term int storm
}

section_clock() {
    count_calls clock &&
        each_moment clock jump
    # a budget of seconds, of which a step takes one, is a budget of steps
    rm -rf "$work/run"
    faulty clock 0 tick "${fresh[@]/#--steps/--time-limit}"
    check "by the clock, a second a step: exit code 0" [ $rc = 0 ]
    check "by the clock, a second a step: the weights of as many steps" \
        [ "$(digest "$work/run")" = "$whole" ]
    check "by the clock, a second a step: as many steps" \
        cmp -s <(step_rows | "$query" -l step) <(seq $steps)
    # as after Ctrl-Z; the step that warms up is the first
    rm -rf "$work/run"
    faulty clock 20 tick "${fresh[@]/#--steps/--time-limit}"
    check "by the clock, 100 s in a step: that is told" said "stood still for 99 s"
    check "by the clock, 100 s in a step: the weights of as many steps" \
        [ "$(digest "$work/run")" = "$whole" ]
}

# How many pictures and depths a folder has, and a digest of them and of its figures, but for the
# seconds.
pictures() {
    (cd "$1" && find . -name '*.png' -o -name '*.npy' | wc -l &&
        { find . -name '*.png' -exec md5sum {} + -o -name '*.npy' -exec md5sum {} + | sort
            find . -name '*.json' | sort | xargs cat |
                sed -E 's/"[a-z_]*seconds": *[-+.0-9e]+//g'; } |
        md5sum | cut -c -32) | tr '\n' ' '
}

# The same of pictures alone. A driver that builds no kernel is such an error that the program goes
# on with plain ones, which it announces: they sum in another order, depths differ in their last
# digits, and what they have drawn is not drawn again.
colours() {
    (cd "$1" && find . -name '*.png' | wc -l && find . -name '*.png' -exec md5sum {} + | sort |
        md5sum | cut -c -32) | tr '\n' ' '
}

# A command on the finished run, killed or with a fault, and then repeated without one: the same
# pictures and figures as undisturbed.
results() {
    local name=$1 out=$2 i at how kind sums painted plain same
    shift 2
    rm -rf "$work/good"
    cp -r "$work/whole" "$work/good"
    run "$@"
    check "$name" [ $rc = 0 ]
    sums=$(pictures "$out") painted=$(colours "$out")
    check "$name: there are pictures" [ "${sums%% *}" -gt 1 ]
    for kind in any:kill memory:once device:once write:full read:once; do
        how=${kind#*:}
        kind=${kind%:*}
        rm -rf "$work/good"
        cp -r "$work/whole" "$work/good"
        faulty "$kind" 0 once "$@"
        read -r total _ <"$work/log"
        for ((i = 0; i < moments; i++)); do
            at=$(one_of "$total")
            rm -rf "$work/good"
            cp -r "$work/whole" "$work/good"
            faulty "$kind" "$at" "$how" "$@"
            if [ "$how" != kill ] && ! ended_well; then
                bad "$name: $kind, $how at call $at of $total" "exit code $rc"
                continue
            fi
            plain="" same=$sums
            [ "$kind" != device ] || ! said "plain ones are used" || plain=1 same=$painted
            run "$@"
            check "$name: $kind, $how at call $at of $total, then again${plain:+ (plain kernels)}" \
                [ "$rc $([ -n "$plain" ] && colours "$out" || pictures "$out")" = "0 $same" ]
        done
    done
}

section_results() {
    results eval "$work/good/eval" "$cln" eval "$work/good" --save-images --progress none
    results render "$work/good/render" "$cln" render "$work/good" --progress none
}

# A real full disk: a run that could not keep its checkpoints is refused at once.
section_small() {
    local ways=(unshare -rm --) kib
    [ "$(id -u)" != 0 ] || ways=(unshare -m --)
    mkdir -p "$work/small"
    if ! "${ways[@]}" mount -t tmpfs none "$work/small" 2>/dev/null; then
        skip "a small file system" "mounting is not allowed here"
        return
    fi
    for kib in 100 1000 20000; do
        rm -rf "$work/run"
        run "${ways[@]}" bash -c 'mount -t tmpfs -o size=$2k none "$1" || exit 99
            room=$1
            shift 2
            "$@"
            rc=$?
            mount -o remount,size=1g "$room"
            cp -r "$room/run" "$room/../run" 2>/dev/null
            exit $rc' small "$work/small" $kib \
            "${fresh[@]/#"$work/run"/"$work/small/run"}"
        if [ $rc = 0 ] || ended_well; then
            goes_on "a file system of $kib KiB: exit code $rc"
        else
            bad "a file system of $kib KiB: an exit code and a sentence" "exit code $rc"
        fi
        rm -rf "$work/run"
    done
}

# Preset voxel, by which pixels at edges become means of several rays on the way.
section_means() {
    local whole
    local -a fresh=("$cln" train "$work/scene" -o "$work/run" --preset voxel --antialias 2
        --antialias-after 0.8 --rays 256 --leaf-samples 0 --refresh-every 2 --cull-after 2
        --log-every 1 --save-every 1 --skip-selftest --progress none --steps "$steps")
    rm -rf "$work/run"
    run "${fresh[@]}"
    # 8 photos of 24x24 pixels, 256 rays a step
    check "means of rays begin" said "from step 15 on pixels at edges are means of 4 rays"
    check "leaves split beside them" grep -q '"split":[1-9]' "$work/run/metrics.jsonl"
    whole=$(digest "$work/run")
    section_kill
    [ "$total" -eq 0 ] || each_moment any once full
}

# Kernels may take smaller groups than the device.
section_groups() {
    local digest=$whole preset
    for preset in fast voxel; do
        fresh=("$cln" train "$work/scene" -o "$work/run" --preset "$preset" --rays 256 --steps 5
            --skip-selftest --progress none --tune WG=16)
        rm -rf "$work/run"
        run "${fresh[@]}"
        digest=$(digest "$work/run")
        rm -rf "$work/run"
        run env LD_PRELOAD="$shim" FAULT_GROUPS=4 "${fresh[@]}"
        check "$preset: groups of 4 train" [ "$rc" = 0 ]
        check "$preset: to the same weights" [ "$(digest "$work/run")" = "$digest" ]
    done
    run env LD_PRELOAD="$shim" FAULT_GROUPS=4 "${fresh[@]}" -o "$work/refused" --tune SG=16
    check "a group that a kernel is built for is refused" \
        said "takes groups of at most 4 work-items there, not 16"
    printf '* | * | * | SG=16\n' >"$work/rows"
    rm -rf "$work/run"
    unset 'fresh[-1]' 'fresh[-1]' # --tune
    run env LD_PRELOAD="$shim" FAULT_GROUPS=4 "${fresh[@]}" --tune-file "$work/rows"
    check "a row of it gives way to plain parameters" said "plain ones are used"
    check "which train" [ "$rc" = 0 ]
}

# A device whose queue cannot tell the times of launches.
section_untimed() {
    local digest
    fresh=("$cln" train "$work/scene" -o "$work/run" --rays 256 --steps 5 --skip-selftest
        --progress none)
    rm -rf "$work/run"
    run "${fresh[@]}"
    digest=$(digest "$work/run")
    check "stages have times" grep -q '"stages":{"' "$work/run/metrics.jsonl"
    rm -rf "$work/run"
    run env LD_PRELOAD="$shim" FAULT_UNTIMED=1 "${fresh[@]}"
    check "a device without times trains" [ "$rc" = 0 ]
    check "to the same weights" [ "$(digest "$work/run")" = "$digest" ]
    check "its stages have none" grep -q '"stages":{}' "$work/run/metrics.jsonl"
}

all="kill disk memory device nan files changing signals clock results small means groups untimed"
whole_run
run_sections "$all" "$@"
