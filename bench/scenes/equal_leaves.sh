#!/bin/sh
# Whole levels of voxels, without their empty leaves, each beside an adaptive tree of at most as
# many leaves as it ended with, for the same number of steps. A table in Markdown. Leaves and PSNR
# are the same in every run (one device, one seed), so other work may run on the machine; processor
# seconds are of the whole process, with its start, and tell whether the times are equal, too.
#
#   bench/scenes/equal_leaves.sh SCENE OUT STEPS [TRAIN OPTIONS]
#   bench/scenes/equal_leaves.sh build/demo/scene build/bench-equal 600
#
#   LEVELS=...   whole levels (4 5 6)
#   VIEWS        test views, evenly chosen (12; 0 = all)
#   CLN, QUERY   the programs (build/cl-nascent, build/json-query)
# TRAIN OPTIONS go to every run, ADAPTIVE="--max-level 6 ..." to adaptive ones alone. Finished runs
# are kept; another OUT is needed for other options.
set -eu
[ $# -ge 3 ] || { sed -n '2,/^[^#]/s/^# \{0,1\}//p' "$0"; exit 2; }
scene=$1 out=$2 steps=$3
shift 3
# shellcheck source=bench/scenes/programs.sh
. "$(dirname "$0")/programs.sh"
mkdir -p "$out"

# Seconds on processors of finished children, by what `times` of the shell itself (in a subshell it
# has none) has written to a file.
seconds_in() {
    sed -n 2p "$1" | tr 'ms' '  ' | awk '{ print 60 * ($1 + $3) + $2 + $4 }'
}

value() {
    "$query" "$2" <"$1"
}

# row RUN LABEL OPTIONS...: a run and its row; sets $leaves
row() {
    run=$out/$1 label=$2
    shift 2
    if [ ! -s "$run.row" ]; then
        rm -rf "$run"
        times >"$out/.before"
        "$cln" train "$scene" -o "$run" --preset voxel --steps "$steps" --eval-every 0 \
            --progress none "$@" >"$run.log" 2>&1 || { tail -n 3 "$run.log" >&2; exit 1; }
        times >"$out/.after"
        "$cln" eval "$run" --max-images "${VIEWS:-12}" --no-save-images --progress none --json \
            >"$run.json" 2>>"$run.log"
        awk -v label="$label" -v leaves="$(value "$run/run.json" result.leaves)" \
            -v train="$(value "$run/run.json" result.psnr_train)" \
            -v psnr="$(value "$run.json" mean.psnr)" -v ssim="$(value "$run.json" mean.ssim)" \
            -v before="$(seconds_in "$out/.before")" -v after="$(seconds_in "$out/.after")" 'BEGIN {
            printf "| %s | %d | %.2f | %.2f | %.3f | %.0f |\n", label, leaves, train, psnr, ssim,
                after - before }' >"$run.row"
    fi
    cat "$run.row"
    leaves=$(value "$run/run.json" result.leaves)
}

growth="3:0.01,4:0.03,5:0.08,6:0.25"
# The part of the growth that ends at a level.
until_level() {
    echo "$growth" | sed "s/,$(($1 + 1)):.*//"
}

echo "| tree | leaves | PSNR train | PSNR test | SSIM test | processor seconds |"
echo "|---|---|---|---|---|---|"
for level in ${LEVELS:-4 5 6}; do
    row "level-$level" "level $level" --no-adaptive --level-at "$(until_level "$level")" "$@"
    # shellcheck disable=SC2086
    row "adaptive-$level" "adaptive" --adaptive --max-leaves "$leaves" ${ADAPTIVE:-} "$@"
done
