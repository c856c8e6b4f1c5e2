#!/bin/sh
# View extrapolation, the paper's visual claim: how error grows away from the training cameras.
# Trains on part of the views of the generated object (--from of build/make-scene: a cone of
# directions, a height, a distance), with the presets voxel, fast, nerf and kilonerf for the same
# time, and prints PSNR and depth error of test views all around by angle and distance from the
# nearest training camera.
# Nothing else should run on the machine.
#
#   bench/scenes/extrapolation.sh OUT LIMIT [TRAIN OPTIONS]
#   bench/scenes/extrapolation.sh build/bench-extrapolation 2m
#
#   FROM=...      cone low near
#   PRESETS=...   voxel fast nerf kilonerf
#   SIZE=200 TRAIN=60 TEST=32   width and height of the pictures; training and test views
# More: bench/common/lib.sh. Scenes and runs that exist are kept. OUT/FROM/extrapolation.md keeps
# the tables.
set -eu
[ $# -ge 2 ] || { sed -n '2,/^[^#]/s/^# \{0,1\}//p' "$0"; exit 2; }
# shellcheck source=bench/common/lib.sh
. "$(dirname "$0")/../common/lib.sh"
base=$1 limit=$2
shift 2
maker=${MAKER:-build/make-scene} places=${VIEWS_TABLE:-build/bench-views}

for from in ${FROM:-cone low near}; do
    scene=$base/$from/scene
    [ -e "$scene/transforms_test.json" ] ||
        "$maker" "$scene" --from "$from" --depth --size "${SIZE:-200}" --train "${TRAIN:-60}" \
            --test "${TEST:-32}" >&2
    bench_open "extrapolation-$from" "$scene" "$base/$from" "$limit"
    runs=
    for preset in ${PRESETS:-voxel fast nerf kilonerf}; do
        bench_train "$preset" "$preset" "$preset" "$@"
        [ "$trained" = yes ] || continue
        "$cln" eval "$out/$preset" --no-save-images --progress none -q >&2
        "$cln" render "$out/$preset" --split test --progress none -q >&2
        runs="$runs $preset=$out/$preset"
    done
    bench_table "Trained from $from: PSNR over training time, dB"
    # shellcheck disable=SC2086 # names of presets, and a folder of ours
    "$places" "$scene" $runs | tee "$out/extrapolation.md"
done
