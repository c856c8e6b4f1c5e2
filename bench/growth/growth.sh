#!/bin/sh
# How cost grows: time of a step by stage, and memory, against leaves, samples of a step and image
# size. Each series changes one of them and keeps the others: whole levels of the tree, no culling,
# no growth, no adaptation, on generated scenes. Nothing else should run on the machine.
#
#   bench/growth/growth.sh OUT [TRAIN OPTIONS]
#   small, two cores:
#     STEPS=64 bench/growth/growth.sh build/bench-growth
#   a GPU:
#     LEVELS="1 2 3 4 5" SAMPLES="65536 262144 1048576 4194304" \
#         bench/growth/growth.sh build/bench-growth
#
#   STEPS=...    steps of a run; the second half is measured (200)
#   LEVELS=...   series leaves: 8 to the power of each (1 2 3 4)
#   SAMPLES=...  series samples: target of a step (4096 16384 65536 262144)
#   SIZES=...    series pixels: width and height of the images (50 100 200 400 800)
#   SERIES="leaves samples pixels"
#   CL_NASCENT_DEVICE, CLN, QUERY: as in bench/common/lib.sh; GROWTH_TABLE, MAKE_SCENE: the other
#                two programs
# Quantities outside the series stay at level 3, 65,536 samples and 200 x 200 pixels. Finished runs
# are kept. TRAIN OPTIONS go to every run (a larger network; --stage1 splat, whose cost depends on
# the pixels).
set -eu
[ $# -ge 1 ] || { sed -n '2,/^[^#]/s/^# \{0,1\}//p' "$0"; exit 2; }
# shellcheck source=bench/common/lib.sh
. "$(dirname "$0")/../common/lib.sh"
bench=growth out=$1
shift
cln=${CLN:-build/cl-nascent}
query=${QUERY:-build/json-query}
growth_table=${GROWTH_TABLE:-build/bench-growth}
make_scene=${MAKE_SCENE:-build/make-scene}
steps=${STEPS:-200}
for program in "$cln" "$query" "$growth_table" "$make_scene"; do
    [ -x "$program" ] || bench_fail "$program is not there; make bench-programs"
done
mkdir -p "$out"
rows=$out/.rows
: >"$rows"

# SERIES NAME LEVEL SAMPLES SIZE [TRAIN OPTIONS]: a run and its row
measure() {
    series=$1 run=$out/$2 level=$3 samples=$4 size=$5 status=0
    shift 5
    given="$level $samples $size $steps $*"
    if [ -e "$run" ] && [ "$(cat "$run.options" 2>/dev/null)" != "$given" ]; then
        bench_fail \
            "$run was made with other options ($run.options) or by hand; choose another OUT"
    fi
    [ -d "$out/scene-$size" ] || "$make_scene" "$out/scene-$size" --size "$size" --train 24 \
        --test 1 >/dev/null
    if [ "$(bench_state "$run")" != "done" ]; then
        bench_say "$run"
        rm -rf "$run"
        printf '%s\n' "$given" >"$run.options"
        "$cln" train "$out/scene-$size" -o "$run" --preset fast --start-level "$level" \
            --level-at "" --no-adaptive \
            --cull-from 1 --batch-samples "$samples" --rays "$samples" --steps "$steps" \
            --log-every "$(((steps + 7) / 8))" --progress none --json "$@" >"$run.log" 2>&1 \
            || status=$?
    fi
    case $status in
    0) printf '%s=%s\n' "$series" "$run" >>"$rows" ;;
    5) bench_say "$run is left out: it does not fit in memory ($run.log)" ;;
    *) bench_fail "$run ended with status $status; see $run.log" ;;
    esac
}

for series in ${SERIES:-leaves samples pixels}; do
    case $series in
    leaves)
        for level in ${LEVELS:-1 2 3 4}; do
            measure leaves "level-$level" "$level" 65536 200 "$@"
        done
        ;;
    samples)
        for samples in ${SAMPLES:-4096 16384 65536 262144}; do
            measure samples "samples-$samples" 3 "$samples" 200 "$@"
        done
        ;;
    pixels)
        for size in ${SIZES:-50 100 200 400 800}; do
            measure pixels "size-$size" 3 65536 "$size" "$@"
        done
        ;;
    *) bench_fail "SERIES: '$series' is not leaves, samples or pixels" ;;
    esac
done
[ -s "$rows" ] || bench_fail "no run fits in memory"
set --
while IFS= read -r row; do
    set -- "$@" "$row"
done <"$rows"
"$growth_table" "$out/growth" "$@" >"$out/growth.md"
cat "$out/growth.md"
bench_say "$out/growth.md, $out/growth.csv, $out/growth-*.svg"
