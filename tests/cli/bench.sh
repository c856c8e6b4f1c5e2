#!/bin/bash
# The kernels' bench, on a row or two.
#   tests/cli/bench.sh [SECTION...]    sections: bench ceiling
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
    check "it names the commit" [ "$(json commit)" = "$(cat "$BUILD/commit")" ]
    [ ! -e .git ] || check "which is one of this checkout's" \
        git cat-file -e "$(sed 's/-dirty$//; s/.*-g//' "$BUILD/commit")^{commit}"
    expect "the same as CSV" 0 "" "$bench" --csv "$work/rows.csv" \
        --only mlp_training/W16-D2-V16-L4-1x1 --budget 0.001
    check "it names the commit, too" [ "$(sed -n '1s/.*,//p; 2s/.*,//p' "$work/rows.csv")" = \
        "commit
$(cat "$BUILD/commit")" ]
    expect "every row has its place in the list" 0 "" "$bench" --list
    check "the list has hundreds of rows" [ "$(wc -l <"$work/out")" -gt 200 ]
}

# A probe that is no ceiling, as it does more than it counts: rows seem to be above it.
section_ceiling() {
    local row=mlp_density/W64-D8-L1-64x1536
    expect "a row below the ceiling" 0 "" "$bench" --only $row --budget 0.001
    mkdir "$work/kernels"
    sed '0,/r < rounds/s//r < 4 * rounds/' kernels/peak.cl >"$work/kernels/peak.cl"
    check "the probe is slower" [ "$(diff kernels/peak.cl "$work/kernels/peak.cl" | wc -l)" = 4 ]
    expect "a row above the ceiling fails" 10 \
        "~1.of.1.rows.are.above.105.%.of.the.FMA.ceiling $row peak.cl" \
        "$bench" --only $row --budget 0.001 --kernel-dir "$work/kernels"
    check "the table marks it" grep -q 'ABOVE THE CEILING$' "$work/out"
    run "$bench" --json --only $row --budget 0.001 --kernel-dir "$work/kernels"
    check "it is not ok" [ "$rc $(json ok) $(json exact)" = "10 false false" ]
}

run_sections "bench ceiling" "$@"
