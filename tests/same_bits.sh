#!/bin/bash
# The gate for changes that must not change results: trains short runs with a budget in steps, and
# prints for each the digest of its model and a checksum of its pictures. Not part of `make test`:
# it compares two programs on one machine, because bits differ between devices. It fails itself if
# an interrupted run differs from the same without interruption. A change that only moves code
# prints the same before and after:
#   tests/same_bits.sh PROGRAM >before; ...; tests/same_bits.sh PROGRAM | diff before -
#   tests/same_bits.sh PROGRAM CASE...        only these cases
# PROGRAM is a build/cl-nascent, with build/make-scene next to it. About five minutes on two cores.
set -eu

program=$(realpath "$1")
shift
cases=("$@")
generator=${MAKE_SCENE:-$(dirname "$program")/make-scene}
work=$(mktemp -d "${TMPDIR:-/tmp}/cln-bits-XXXXXX")
trap 'rm -rf "$work"' EXIT
export XDG_CONFIG_HOME=$work/config
: >"$work/lines"
child=0 failed=0
unset CL_NASCENT_DEVICE CL_NASCENT_KERNEL_DIR CL_NASCENT_TUNE_FILE

"$generator" "$work/object" --size 80 --train 20 --test 3 >/dev/null
"$generator" "$work/lens" --kind room --format ngp --size 64 --train 24 --distortion \
    -0.1,0.02,1e-3,-1e-3 >/dev/null
"$generator" "$work/rgb" --format nerfstudio --size 64 --train 16 --test 2 >/dev/null

# A whole schedule in a few hundred steps: growth, culls, splits, merges.
short=(--skip-selftest --progress none -q --preset fast --steps 300 --cull-after 32
    --refresh-every 64 --distil-steps 40 --split-samples 200 --structure-every 0.1 --max-leaves 600)

wanted() {
    [ ${#cases[@]} = 0 ] && return
    local one
    for one in "${cases[@]}"; do
        [ "$one" = "$1" ] && return
    done
    return 1
}

# say NAME RUN: digest of the model, checksums of its output from eval and render
say() {
    local name=$1 run=$2 digest pictures
    digest=$("$program" info "$run" --json |
        grep -o '"model_digest": *"[0-9a-f]*"' | head -n 1 | cut -d'"' -f4)
    "$program" eval "$run" -q --max-images 2 --progress none >/dev/null 2>&1 ||
        "$program" eval "$run" -q --split train --max-images 2 --progress none >/dev/null
    "$program" render "$run" -q --orbit 2 --progress none >/dev/null
    pictures=$(cd "$run" && find eval render \( -name '*.png' -o -name '*.npy' \) -print0 |
        sort -z |
        xargs -0 cat | sha256sum | cut -c -16)
    echo "$name $digest $pictures" | tee -a "$work/lines"
}

# bits NAME SCENE OPTIONS...
bits() {
    local name=$1 scene=$2
    shift 2
    wanted "$name" || return 0
    "$program" train "$work/$scene" -o "$work/run-$name" "${short[@]}" "$@" >/dev/null
    say "$name" "$work/run-$name"
    rm -rf "$work/run-$name"
}

# Waits until the run has so many rows of metrics, or the child has ended.
await_rows() {
    until [ "$(cat "$1/metrics.jsonl" 2>/dev/null | wc -l)" -ge "$2" ]; do
        kill -0 $child 2>/dev/null || return 0
        sleep 0.05
    done
}

# The bits of a case, again or for the first time.
line_of() {
    sed -n "s/^$1 //p" "$work/lines"
}

# interrupted NAME ROWS SCENE OPTIONS...: the run NAME, interrupted whenever metrics.jsonl has so
# many rows ("1 4"): its line must equal that of NAME, which comes before it.
interrupted() {
    local of=$1 rows=$2 scene=$3 name=interrupted-$1 status=0 stops=0
    local run=$work/run-$name
    shift 3
    wanted "$name" || return 0
    env --default-signal=INT "$program" train "$work/$scene" -o "$run" "${short[@]}" "$@" \
        >/dev/null 2>&1 &
    child=$!
    for row in $rows; do
        await_rows "$run" "$row"
        kill -INT $child 2>/dev/null || true
        status=0
        wait $child || status=$?
        [ $status != 0 ] || break # it ended before
        [ $status = 130 ] || return 1
        stops=$((stops + 1))
        env --default-signal=INT "$program" train --resume "$run" --skip-selftest --progress none \
            -q >/dev/null 2>&1 &
        child=$!
    done
    [ $status = 0 ] || wait $child
    say "$name" "$run"
    rm -rf "$run"
    if [ $stops = 0 ]; then
        echo "$0: $name: it ended before it could be interrupted" >&2
        failed=1
    elif [ "$(line_of "$name")" != "$(line_of "$of")" ]; then
        echo "$0: $name differs from $of: ${*:-no options}" >&2
        failed=1
    fi
}

# both NAME ROWS SCENE OPTIONS...: without and, if wanted, with interruptions
both() {
    local name=$1 rows=$2
    shift 2
    if wanted "interrupted-$name" && ! wanted "$name"; then
        cases+=("$name") # to compare with
    fi
    bits "$name" "$@"
    interrupted "$name" "$rows" "$@"
}

paper=(--preset paper --view-width 64 --n1 10 --rays 512 --batch-samples 16384 \
    --samples-per-leaf 12)

both fast "1 5 9" object
bits fast-seed object --seed 7 --random-background
bits fast-rgb rgb
bits fast-lens lens
both fast-splat 3 object --stage1 splat
bits splat-lens lens --stage1 splat --lists padded
bits paper object "${paper[@]}" --steps 100
bits paper-noise object "${paper[@]}" --steps 80 --rrelu-scope neuron --density-noise 0.5 \
    --moments bfloat16
both nerf 1 object --preset nerf --width 64 --rays 256 --batch-samples 16384 --steps 60
both voxel 2 object --preset voxel --rays 512 --steps 100
bits voxel-adaptive object --preset voxel --adaptive --rays 512 --leaf-samples 0 --steps 240 \
    --level-at 2:0.1 --start-level 1 --cell-pixels 0.2 --cull-after 20 --refresh-every 16 \
    --structure-from 0.3 --structure-every 0.2 --structure-until 0.9 --split-samples 0 \
    --max-leaves 150
bits kilonerf object --preset kilonerf --rays 512 --steps 100
bits regularised object --sparsity 0.01 --cauchy 0.001 --opacity-entropy 0.01 \
    --distortion-loss 0.01 \
    --edge 0.01 --view-l2 1e-5
bits merges object --merge-factor 0.3 --structure-from 0.2 --level-at 3:0.05
bits regrow object --steps 240 --level-at 3:0.515 --cull mean --cull-mean 6 --cull-from 0.05 \
    --cull-after 96 --refresh-every 16 --no-adaptive --rays 512 --batch-samples 8192 --regrow 0.7
bits options object --skip --depth 6 --bands-by-level --rrelu-scope element --density relu \
    --init fan-in \
    --loss huber --no-view-dependence
bits exp object --density exp --rolling-refresh --density-weight visibility --cull mean \
    --cost-density 1
bits precrop object --precrop-steps 100 --lr-schedule step --no-skip-uncovered --no-adaptive
bits plain object --tune VW=1,LS=1,TS=4 --steps 100
bits gpu object --tune VW=1,LS=64,TS=8,NB=16,LEAF=0 --steps 100
bits lanes object --tune VW=4,LS=8,LEAF=0 --steps 100
both parts 3 object --max-alloc 1M --steps 200
exit $failed
