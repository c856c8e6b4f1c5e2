#!/bin/bash
# Error against run time on one scene, for docs/results.md: trains with test PSNR at the given points, then
# evaluates every test view. Nothing else should run on the machine; what it prints is a table in Markdown.
#
#   bench/scene.sh SCENE RUN LIMIT POINTS [TRAIN OPTIONS]
#   bench/scene.sh ../lego build/lego-10m 10m 1m,2m,5m
#
# Seconds are training seconds: growth, refresh and culling count, evaluation and building kernels do not.
# PSNR at the points is over the evenly chosen test views of --eval-images (8), the last line over all.
set -eu
[ $# -ge 4 ] || { sed -n '2,9s/^# \{0,1\}//p' "$0"; exit 2; }
scene=$1 run=$2 limit=$3 points=$4
shift 4
cln=${CLN:-build/cl-nascent}

"$cln" train "$scene" -o "$run" --time-limit "$limit" --eval-at "$points" --progress none "$@" >&2
echo "| training seconds | steps | leaves | PSNR train | PSNR test |"
echo "|---|---|---|---|---|"
grep '"psnr_test"' "$run/metrics.jsonl" | sed -E \
    's/.*"step":([0-9]+),"seconds":([0-9.]+).*"psnr_train":([0-9.]+).*"leaves":([0-9]+).*"psnr_test":([0-9.]+).*/\2 \1 \4 \3 \5/' |
    awk '{printf "| %.0f | %d | %d | %.2f | %.2f |\n", $1, $2, $3, $4, $5}'
echo
"$cln" eval "$run" --save-images | tail -n 12
