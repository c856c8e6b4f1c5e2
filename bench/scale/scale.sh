#!/bin/sh
# How training scales over ranks: short trainings by one process measure the stages, a pair of
# processes measures the messages. From them a model (bench/scale/model.h has its assumptions)
# computes 1 to 1,024 ranks; runs by 2 and 4 ranks check it. Takes two minutes, in which nothing
# else should run on the machine.
#
#   make bench-scale                    into build/bench-scale
#   bench/scale/scale.sh OUT [TRAIN OPTIONS]
#
#   STEPS=...    steps of a run; the second half is measured (64)
#   RANKS=...    numbers of ranks of the runs that check the model ("2 4")
#   CLN, SCALE, MAKE_SCENE: the programs, of `make bench-scale-programs`
# Prints the tables, also into OUT/scale.md. A rank has one thread. Every call makes its runs again.
# TRAIN OPTIONS go to every run (a larger network, or --preset voxel).
set -eu
[ $# -ge 1 ] || { sed -n '2,/^[^#]/s/^# \{0,1\}//p' "$0"; exit 2; }
out=$1
shift
cln=${CLN:-build/mpi/cl-nascent}
scale=${SCALE:-build/mpi/bench-scale}
make_scene=${MAKE_SCENE:-build/make-scene}
for program in "$cln" "$scale" "$make_scene"; do
    [ -x "$program" ] ||
        { echo "scale: $program is not there; make bench-scale-programs" >&2; exit 1; }
done
command -v mpirun >/dev/null ||
    { echo "scale: no mpirun (apt-get install libopenmpi-dev openmpi-bin)" >&2; exit 1; }
export OMPI_ALLOW_RUN_AS_ROOT=1 OMPI_ALLOW_RUN_AS_ROOT_CONFIRM=1 POCL_MAX_PTHREAD_COUNT=1
mkdir -p "$out/runs"
[ -d "$out/scene" ] || "$make_scene" "$out/scene" --size 100 --train 16 --test 1 >/dev/null

# measure NAME RANKS LEVEL SAMPLES [TRAIN OPTIONS]: a run, $run
measure() {
    run=$out/runs/$1 ranks=$2 level=$3 samples=$4
    shift 4
    echo "== $run" >&2
    rm -rf "$run"
    mpirun --oversubscribe --bind-to none -n "$ranks" "$cln" train "$out/scene" -o "$run" \
        --preset fast --skip-selftest --start-level "$level" --level-at "" --no-adaptive \
        --cull-from 1 --batch-samples "$samples" --rays "$((samples / 16))" \
        --refresh-every 8 --eval-at "" \
        --steps "${STEPS:-64}" --log-every 8 --progress none "$@" >"$run.log" 2>&1 ||
        { cat "$run.log" >&2; exit 1; }
}

alone='' together=''
for level in 2 3; do
    for samples in 4096 16384; do
        measure "1-$level-$samples" 1 "$level" "$samples" "$@"
        alone="$alone $run"
    done
done
for ranks in ${RANKS:-2 4}; do
    for samples in 4096 16384; do
        measure "$ranks-3-$samples" "$ranks" 3 "$samples" "$@"
        together="$together $run"
    done
done
messages=$(mpirun --oversubscribe --bind-to none -n 2 "$scale" messages)
# shellcheck disable=SC2086 # lists of words: OUT has no spaces
"$scale" predict $messages "$(nproc)" $alone -- $together $alone >"$out/scale.md"
cat "$out/scale.md"
echo "== $out/scale.md" >&2
