#!/bin/sh
# The adaptive tree against its baselines, for the same time on one scene. Two tables:
#   methods   the presets nerf (one network), kilonerf (a uniform grid, from scratch), fast, voxel
#   levels    whole levels 3, 4, 5, without their empty leaves, each with an adaptive tree of at
#             most as many leaves as it ended with, adapted from the next coarser level
# Nothing else should run on the machine.
#
#   bench/scenes/baselines.sh SCENE OUT LIMIT [TRAIN OPTIONS]
#   small, two cores:
#     VIEWS=2 bench/scenes/baselines.sh build/demo/scene build/bench-baselines 1m
#   ten minutes a run:
#     FINAL=0 bench/scenes/baselines.sh ../lego build/bench-baselines 10m
#
#   PARTS="methods levels"
#   LEVELS=...   of the second table (3 4 5)
#   GROWTH=...   times of whole levels (bench/common/lib.sh)
# More: bench/common/lib.sh. VIEWS determines the time beyond training: the nerf preset renders
# slowly on a CPU. TRAIN OPTIONS go to every run.
set -eu
[ $# -ge 3 ] || { sed -n '2,/^[^#]/s/^# \{0,1\}//p' "$0"; exit 2; }
# shellcheck source=bench/common/lib.sh
. "$(dirname "$0")/../common/lib.sh"
scene=$1 out=$2 limit=$3
shift 3

for part in ${PARTS:-methods levels}; do
    bench_open "$part" "$scene" "$out" "$limit"
    case $part in
    methods)
        for preset in nerf kilonerf fast voxel; do
            bench_train "$preset" "$preset" "$preset" "$@"
        done
        bench_table "One network, a uniform grid, an adaptive tree, voxels: PSNR over time, dB"
        ;;
    levels)
        for level in ${LEVELS:-3 4 5}; do
            # shellcheck disable=SC2046
            bench_train "level-$level" "level $level" fast --no-adaptive $(bench_growth "$level") \
                "$@"
            [ $trained = yes ] || continue
            leaves=$(bench_value "level-$level" result.leaves)
            # shellcheck disable=SC2046
            bench_train "adaptive-$level" "adaptive, at most $leaves leaves" fast --adaptive \
                $(bench_growth $((level - 1))) --structure-from "$(bench_growth_at "$level")" \
                --max-level 5 "$@" --max-leaves "$leaves"
        done
        bench_table "Whole levels and adaptive trees of as many leaves: PSNR over training time, dB"
        ;;
    *) bench_fail "PARTS: '$part' is not methods or levels" ;;
    esac
done
