#!/bin/sh
# The size of the leaf networks on a fixed tree (the paper's Table 3): trains every size from its
# initial weights for the same time on the final tree of an adaptive run. Nothing else should run on
# the machine.
#
#   bench/scenes/network_size.sh SCENE OUT LIMIT [TRAIN OPTIONS]
#   small, two cores:
#     bench/scenes/network_size.sh build/demo/scene build/bench-size 1m --max-leaves 200
#   large, a GPU:
#     bench/scenes/network_size.sh ../lego build/bench-size 1h --max-leaves 2700
#
#   TREE=RUN     use this run's tree; by default an adaptive run of the fast preset comes first
#   SIZES=...    WIDTHxDEPTH each (64x4 64x8 128x4 128x8 256x4 256x8)
#   VIEW_WIDTH   neurons of the view layer (256)
#   LR           learning rate of every size (0.128 / width); the final rate is a twentieth of it
# More: bench/common/lib.sh. TRAIN OPTIONS go to every run, the first one included.
set -eu
[ $# -ge 3 ] || { sed -n '2,/^[^#]/s/^# \{0,1\}//p' "$0"; exit 2; }
# shellcheck source=bench/common/lib.sh
. "$(dirname "$0")/../common/lib.sh"
bench_open network_size "$1" "$2" "$3"
shift 3

tree=${TREE:-}
if [ -z "$tree" ]; then
    tree=$out/tree
    bench_train tree "the tree's own run" fast "$@"
    [ $trained = yes ] || bench_fail "without the tree there is nothing to compare"
fi
for size in ${SIZES:-64x4 64x8 128x4 128x8 256x4 256x8}; do
    width=${size%x*} depth=${size#*x}
    # shellcheck disable=SC2046
    bench_train "W$width-D$depth" "W$width-D$depth" fast $(bench_network "$width" "$depth") "$@" \
        --tree-from "$tree"
done
bench_table "Network size on one tree: PSNR over training time, dB"
