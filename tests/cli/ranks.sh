#!/bin/bash
# Training, evaluation and rendering by several processes (docs/scale-out.md): the same model and
# pictures as by one, bit for bit, also when resumed by another number of them; what differs between
# them, and one that dies, end all.
#   tests/cli/ranks.sh [SECTION...]    sections are in the last line
# Skipped without OpenMPI (libopenmpi-dev openmpi-bin), which neither build nor tests install.
set -u
cd "$(dirname "$0")/../.." || exit 1

cln=$PWD/build/cl-nascent
ranked=$PWD/build/mpi/cl-nascent
make_scene=$PWD/build/make-scene
work=$(mktemp -d "${TMPDIR:-/tmp}/cln ranks XXXXXX")
trap 'rm -rf "$work"' EXIT
. tests/support/checks.sh

if ! command -v mpirun >/dev/null || ! pkg-config --exists ompi-c; then
    skip ranks "no OpenMPI (apt-get install libopenmpi-dev openmpi-bin)"
    count
    exit
fi
${MAKE:-make} --no-print-directory MPI=1 build/mpi/cl-nascent >"$work/out" 2>&1 ||
    bad "make MPI=1"

export OMPI_ALLOW_RUN_AS_ROOT=1 OMPI_ALLOW_RUN_AS_ROOT_CONFIRM=1 POCL_MAX_PTHREAD_COUNT=1
mpi=(mpirun --oversubscribe --bind-to none)

# a tree that grows, is culled, splits and merges on the way
small=(--skip-selftest --progress none --width 16 --depth 2 --view-width 16 --view-bands 1 --bands 4
    --start-level 1 --level-at 2:0.4 --n1 8 --rays 256 --batch-samples 4096 --refresh-every 16
    --log-every 1 --cull-from 0.3 --cull-after 0 --max-leaves 60 --structure-from 0.5
    --structure-every 0.1 --structure-until 0.95 --split-samples 0 --distil-steps 20)

digest() {
    "$cln" info "$1" --json 2>/dev/null | "$query" model_digest
}

# same RUN RUN: their models, bit for bit
same() {
    local d
    d=$(digest "$1")
    [ -n "$d" ] && [ "$d" = "$(digest "$2")" ]
}

baseline() {
    [ -d "$work/scene" ] && return
    "$make_scene" "$work/scene" --size 48 --train 8 --test 2 >/dev/null || bad "make-scene"
    expect "train with one process" 0 "" "$cln" train "$work/scene" -o "$work/one" "${small[@]}" \
        --steps 200
}

section_same() {
    baseline
    expect "train with two ranks" 0 "" "${mpi[@]}" -n 2 "$ranked" train "$work/scene" \
        -o "$work/two" "${small[@]}" --steps 200 -v
    check "leaves moved between them" said "moved to other ranks"
    check "the model is that of one process" same "$work/one" "$work/two"
    check "one of them speaks" [ "$(grep -c '^run ' "$work/out")" = 1 ]
    check "rows tell what was sent" grep -q '"sent_bytes"' "$work/two/metrics.jsonl"
    local more=(--steps 60 --distortion-loss 0.01 --edge 0.01 --sparsity 0.01 --stage1 splat
        --moments bfloat16)
    run "$cln" train "$work/scene" -o "$work/more" "${small[@]}" "${more[@]}"
    expect "three ranks, with regularisers and splatting" 0 "" "${mpi[@]}" -n 3 "$ranked" train \
        "$work/scene" -o "$work/three" "${small[@]}" "${more[@]}"
    check "their model is that of one process" same "$work/more" "$work/three"
}

# start RUN OPTIONS...: two ranks in the background, once they train; $child: mpirun
start() {
    local on=$1 end=$((SECONDS + 60))
    shift
    "${mpi[@]}" -n 2 "$ranked" train "$work/scene" -o "$on" "${small[@]}" "$@" >"$work/out" \
        2>"$work/err" &
    child=$!
    until [ -s "$on/metrics.jsonl" ] || [ $SECONDS -ge $end ]; do
        sleep 0.02
    done
}

section_resume() {
    baseline
    start "$work/on" --steps 200
    kill -TERM "$(pgrep -P "$child" | tail -n 1)" # any of them
    wait "$child"
    check "a signal to one stops all, after a checkpoint" said "stopped by a signal"
    check "before the end" [ "$(digest "$work/on")" != "$(digest "$work/one")" ]
    expect "three ranks go on with the run of two" 0 "resumed" "${mpi[@]}" -n 3 "$ranked" train \
        --resume "$work/on" --skip-selftest --progress none
    check "the model is that of one process" same "$work/one" "$work/on"
}

section_dies() {
    baseline
    start "$work/dies" --steps 1000000
    kill -9 "$(pgrep -P "$child" | tail -n 1)"
    wait "$child"
    check "a rank that dies ends all" [ $? != 0 ]
    check "and is named" grep -qE 'process rank [01] with PID' "$work/err" "$work/out"
}

section_differ() {
    baseline
    expect "ranks of different settings are refused" 2 "rank settings" "${mpi[@]}" -n 1 "$ranked" \
        train "$work/scene" -o "$work/no" "${small[@]}" --steps 20 : -n 1 "$ranked" \
        train "$work/scene" -o "$work/no" "${small[@]}" --steps 20 --seed 7
    check "nothing is written" [ ! -e "$work/no" ]
}

# Pictures by ranks: files equal to one process's, and a model too large for one is shown by four.
section_pictures() {
    baseline
    run "$cln" eval "$work/one" -o "$work/eval-one" --save-images
    expect "evaluate with two ranks" 0 "" "${mpi[@]}" -n 2 "$ranked" eval "$work/one" \
        -o "$work/eval-two" --save-images
    check "one of them speaks" [ "$(grep -c '^mean' "$work/out")" = 1 ]
    check "pictures are those of one process" diff -r -x '*.json' "$work/eval-one" "$work/eval-two"
    check "so are the figures" diff <(grep -v seconds "$work/eval-one/"*-test.json) \
        <(grep -v seconds "$work/eval-two/"*-test.json)
    run "$cln" render "$work/one" -o "$work/render-one" --normals --antialias 2
    expect "render with three ranks" 0 "" "${mpi[@]}" -n 3 "$ranked" render "$work/one" \
        -o "$work/render-two" --normals --antialias 2
    check "frames are those of one process" diff -r "$work/render-one" "$work/render-two"
    rm "$work/render-two/test_r_001.png"
    expect "render what is missing" 0 "" "${mpi[@]}" -n 2 "$ranked" render "$work/one" \
        -o "$work/render-two" --normals --antialias 2
    check "one frame" grep -q '1 rendered.* 1 left as it is' "$work/out"
    check "frames are those of one process again" diff -r "$work/render-one" "$work/render-two"
    expect "ranks of different frames are refused" 2 "checkpoint or choice of frames" \
        "${mpi[@]}" -n 1 "$ranked" render "$work/one" -o "$work/no" : \
        -n 1 "$ranked" render "$work/one" -o "$work/no" --width 24 --height 24
    check "nothing is written" [ ! -e "$work/no" ]
    expect "view by several is refused" 2 "one process" "${mpi[@]}" -n 2 "$ranked" view "$work/one"
    run "$cln" train "$work/scene" -o "$work/large" --skip-selftest --progress none --width 64 \
        --depth 8 --start-level 2 --level-at "" --max-level 5 --rays 256 --batch-samples 2048 \
        --n1 8 --steps 1
    expect "a model too large for one process" 5 "~network.weights device-mem" "$cln" render \
        "$work/large" -o "$work/four" --device-mem 38M
    expect "is rendered by four" 0 "" "${mpi[@]}" -n 4 "$ranked" render "$work/large" \
        -o "$work/four" --device-mem 38M
    run "$cln" render "$work/large" -o "$work/alone"
    check "as with room for all of it" diff -r "$work/alone" "$work/four"
}

# The bytes that bench/scale computes are those that a training counted.
section_scale() {
    ${MAKE:-make} --no-print-directory MPI=1 build/mpi/bench-scale >"$work/out" 2>&1 ||
        bad "make MPI=1 build/mpi/bench-scale"
    baseline
    run "${mpi[@]}" -n 2 "$ranked" train "$work/scene" -o "$work/bytes" "${small[@]}" \
        --refresh-every 8 --steps 128 --start-level 2 --level-at "" --no-adaptive --cull-from 1
    expect "bytes of a step" 0 "" build/mpi/bench-scale bytes "$work/bytes"
    check "are the model's within 5 %" awk '{ exit !($2 > 1000 && $3 > -0.05 && $3 < 0.05) }' \
        "$work/out"
    expect "messages between two" 0 "" "${mpi[@]}" -n 2 build/mpi/bench-scale messages
    check "take time" awk '{ exit !($1 > 0 && $2 > 0 && NF == 2) }' "$work/out"
    expect "a run of one process has none" 3 "several" build/mpi/bench-scale bytes "$work/one"
}

run_sections "same resume dies differ pictures scale" "$@"
