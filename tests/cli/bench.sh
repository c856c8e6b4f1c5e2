#!/bin/bash
# The kernels' bench, on a row or two; what scripts of measurements make of their rows, with
# programs that only write these.
#   tests/cli/bench.sh [SECTION...]    sections: bench ceiling mutate stages
#   BUILD=build/sanitize               the program to test
set -u
cd "$(dirname "$0")/../.." || exit 1

work=$(mktemp -d "${TMPDIR:-/tmp}/cln-bench-XXXXXX")
trap 'rm -rf "$work"' EXIT
. tests/support/checks.sh
bench=$here/$BUILD/bench-kernels

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

# mutate NAME CODE WORDS VARIABLE=...: tests/mutate.sh of a tree with one source
mutate() {
    expect "$1" "$2" "$3" env PATH="$work/bin:$PATH" JOBS=1 POCL_CACHE_DIR="$work/none" "${@:4}" \
        "$work/tree/tests/mutate.sh" host/base/x.c
}

# A survivor is one until a test notices it; and where nothing ran, nothing was tested.
section_mutate() {
    local results=$work/tree/build/mutants/results
    if ! command -v perl >/dev/null || ! command -v git >/dev/null; then
        skip mutate "no perl or git"
        return
    fi
    mkdir -p "$work/bin" "$work/tree/tests/support" "$work/tree/host/base" "${results%/*}"
    cp tests/mutate.sh "$work/tree/tests"
    cp tests/support/mutants.* "$work/tree/tests/support"
    printf 'int least(int a, int b)\n{\n    return a < b;\n}\n' >"$work/tree/host/base/x.c"
    git -C "$work/tree" init -q
    printf '#!/bin/sh\nexit 2\n' >"$work/bin/make"
    chmod +x "$work/bin/make"
    echo "1 none" >"${results%/*}/times"
    mutate "a tree that cannot be built" 1 "~do.not.pass.without.a.mistake"
    check "no mutant has a row" [ ! -s "$results" ]
    printf '#!/bin/sh\n' >"$work/bin/make"
    (cd "$work/tree" && perl tests/support/mutants.pl list 1 host/base/x.c) |
        sed 's/^/survived\t/; s/$/\treturn/' >"$results"
    check "there is one mutant" [ "$(wc -l <"$results")" = 1 ]
    mutate "a survivor for which there is no time" 1 "" AGAIN=1 LIMIT=0
    check "it stays a survivor" grep -q "^survived" "$results"
    sed -i 's/a < b/b > a/' "$work/tree/host/base/x.c"
    mutate "a survivor whose source has changed" 1 "~x.c:3:.not.applied" AGAIN=1
    check "it stays a survivor, too" grep -q "^survived" "$results"
    sed -i 's/b > a/a < b/' "$work/tree/host/base/x.c"
    mutate "a survivor that a test notices now" 0 "" AGAIN=1 # the tree has no cli.sh: it fails
    check "its row is replaced" [ "$(cut -f 1 "$results")" = cli.sh ]
}

# Launches that are no training are not in the table of a training's seconds.
section_stages() {
    cat >"$work/program" <<'EOF'
#!/bin/sh
case $1 in
eval)
    echo '{"mean": {"psnr": 20, "ssim": 0.5, "seconds": 0.1}, "train_seconds": 10, "step": 100}'
    ;;
train)
    mkdir "$4"
    echo '{"config": {"structure_until": 0.5}, "result": {"leaves": 8, "psnr_train": 21,
        "device_peak": 1, "host_peak": 1}}' >"$4/run.json"
    cat >"$4/metrics.jsonl" <<'ROWS'
{"step":40,"seconds":4,"stages":{"forward":1.5,"evaluation":9.5}}
{"step":60,"seconds":6,"stages":{"forward":1.5,"adam":0.1}}
{"step":100,"seconds":10,"stages":{"forward":2.5,"adam":0.5,"probes":0.25,"evaluation":8}}
ROWS
    ;;
esac
EOF
    chmod +x "$work/program"
    expect "a training's table" 0 "" env CLN="$work/program" \
        bench/scenes/scene.sh none "$work/trained" 10s 5s
    check "its stages" grep -qxF "| forward | 66.67 | 66.7 % |" "$work/out"
    check "what is left for the host" \
        grep -qxF "| host, and the device waiting for it | 23.33 | 23.3 % |" "$work/out"
    check "evaluations are no stage" sh -c '! grep -q "| evaluation" "$1"' - "$work/out"
    check "they are told" grep -qxF "Beside it: evaluation, 8.0 s." "$work/out"
    expect "a missing program is told before the training" 2 "run \`make all bench-programs\`" \
        env CLN="$work/program" QUERY="$work/nothing" bench/scenes/scene.sh none "$work/no" 10s 5s
    check "and nothing was trained" [ ! -e "$work/no" ]
}

run_sections "bench ceiling mutate stages" "$@"
