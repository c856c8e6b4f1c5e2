#!/bin/bash
# The kernels' bench, on one row.
#   tests/cli/bench.sh
#   BUILD=build/sanitize               the program to test
set -u
cd "$(dirname "$0")/../.." || exit 1

BUILD=${BUILD:-build}
cln=$PWD/$BUILD/cl-nascent
make_scene=$PWD/$BUILD/make-scene
bench=$PWD/$BUILD/bench-kernels
work=$(mktemp -d "${TMPDIR:-/tmp}/cln-bench-XXXXXX")
trap 'rm -rf "$work"' EXIT
. tests/support/checks.sh

# A row of the kernels' bench has all that docs/benches.md says. No speed is tested.
section_bench() {
    local key
    expect "a row of the kernels' bench" 0 "" "$bench" --json \
        --only mlp_training/W16-D2-V16-L4-1x1 --budget 0.001
    for key in seconds.min seconds.median seconds.max gflops gbps fma_gflops copy_gbps share nmse \
        worst; do
        check "it has $key" number_above "$(json $key)" -1e-30
    done
    check "it names the kernel" [ "$(json kernel)" = mlp_training ]
    check "it names the shape" [ "$(json shape)" = "W16-D2-V16-L4 1x1" ]
    check "its errors are within their bounds" [ "$(json ok)" = true ]
    expect "every row has its place in the list" 0 "" "$bench" --list
    check "the list has hundreds of rows" [ "$(wc -l <"$work/out")" -gt 200 ]
}

run_sections bench "$@"
