#!/bin/sh
# The level of the tree (the paper's Table 4): whole levels 0 to 4 without their empty leaves, and
# the adaptive tree, all with the same network and for the same time. Nothing else should run on the
# machine.
#
#   bench/scenes/tree_level.sh SCENE OUT LIMIT [TRAIN OPTIONS]
#   small, two cores:
#     NETWORK=fast bench/scenes/tree_level.sh build/demo/scene build/bench-level 1m
#   large, a GPU:
#     bench/scenes/tree_level.sh ../lego build/bench-level 1h --max-leaves 2700
#
#   NETWORK=64x8 WIDTHxDEPTH of the leaf networks (the paper's W64-D8), or "fast": the fast preset's
#   LEVELS=...   0 1 2 3 4 all
#   GROWTH=...   times of whole levels (bench/common/lib.sh)
# More: bench/common/lib.sh. TRAIN OPTIONS go to every run.
#
# Rays cross a coarse tree's leaves on long paths: levels 0, 1 and 2 get more samples per leaf and
# ray and a finer stage 1 than the fast preset's 8, 16 and 12 cells along an axis, chosen for small
# leaves. Level 0 is one leaf and is not culled.
set -eu
[ $# -ge 3 ] || { sed -n '2,/^[^#]/s/^# \{0,1\}//p' "$0"; exit 2; }
# shellcheck source=bench/common/lib.sh
. "$(dirname "$0")/../common/lib.sh"
bench_open tree_level "$1" "$2" "$3"
shift 3

network=
if [ "${NETWORK:-64x8}" != fast ]; then
    size=${NETWORK:-64x8}
    network=$(bench_network "${size%x*}" "${size#*x}")
fi
sampling() {
    echo "--n1 $1 --samples-per-leaf $2 --samples-per-ray $3"
}
for level in ${LEVELS:-0 1 2 3 4 all}; do
    case $level in
    0) tree="$(sampling 64 64 64) --cull-from 1 --min-leaf-samples 1" ;;
    1) tree=$(sampling 32 32 32) ;;
    2) tree=$(sampling 24 16 16) ;;
    *) tree= ;;
    esac
    if [ "$level" = all ]; then
        label="all (adaptive)"
    else
        label="level $level"
        tree="$tree --no-adaptive $(bench_growth "$level")"
    fi
    # shellcheck disable=SC2086
    bench_train "level-$level" "$label" fast $network $tree "$@"
done
bench_table "Tree level: PSNR over training time, dB"
