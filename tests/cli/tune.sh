#!/bin/bash
# Kernel parameters by measurement: `tune`, the rows that it writes and others read, and devices
# that compute wrong results.
#   tests/cli/tune.sh [SECTION...]     sections: tune refused
#   BUILD=build/sanitize               the programs to test
set -u
cd "$(dirname "$0")/../.." || exit 1

work=$(mktemp -d "${TMPDIR:-/tmp}/cln tune [*] (+) XXXXXX")
trap 'rm -rf "$work"' EXIT
. tests/support/checks.sh

net=(--preset fast --width 16 --depth 2 --view-width 16 --bands 2 --view-bands 1)
"$make_scene" "$work/blender" --size 32 --train 6 --test 2 >/dev/null

# Every set of the last `tune --json` but the first was judged by its figures, and stderr says so.
sets_agree() {
    local i=1 verdict ratio pairs slower against line
    while verdict=$(json "tries.$i.verdict") && [ -n "$verdict" ]; do
        ratio=$(json "tries.$i.ratio") pairs=$(json "tries.$i.pairs")
        slower=$(json "tries.$i.slower") against=$(json "tries.$i.against")
        line=$(grep -F "$(json "tries.$i.tune"): " "$work/err")
        case $verdict in
        taken) [[ $line = *"$slower of them: taken" ]] ;;
        "not faster") [[ $line = *"of $pairs pairs"*"$slower of them: not taken, as "* ]] ;;
        "not timed") [[ $line = *"no time is left to time it"* && $ratio$pairs = null0 ]] ;;
        refused) [[ $line = *"refused, and not timed"* && $ratio$pairs = null0 ]] ;;
        *) false ;;
        esac || return 1
        [ "$pairs" = 0 ] || awk -v v="$verdict" -v r="$ratio" -v p="$pairs" \
            -v s="$slower" -v a="$against" 'BEGIN { fast = r < 0.98 && s <= 2
                exit !(a > 0 && p >= 3 && s <= p && fast == (v == "taken")) }' || return 1
        i=$((i + 1))
    done
    [ $i -gt 1 ] || [ "$(json complete)" = false ]
}

section_tune() {
    local rows=$work/config/cl-nascent/tune.txt
    expect "tune" 0 "" "$cln" tune "${net[@]}" --budget 2 --progress none
    check "tune prints the row" grep -q '| W16-D2-V16 | VW=' "$work/out"
    check "tune says when it is used" grep -q '^used  *for such networks from now on$' "$work/out"
    check "tune writes the row to the user's file" grep -qF "$(tail -1 "$work/out")" "$rows"
    expect "train uses the row for such networks" 0 "" \
        "$cln" train "$work/blender" -o "$work/tuned" "${tiny[@]}" --steps 2 -v
    check "train names the row" said "$rows, line 3"
    check "train names the parameters" grep -q "kernel parameters: VW=" "$work/err"
    check "run.json names the row" eval \
        '[[ "$("$query" tune_from <"$work/tuned/run.json")" = "$rows, line 3"* ]]'
    expect "train on it, without -v" 0 "" \
        "$cln" train "$work/blender" -o "$work/tuned 2" "${tiny[@]}" --steps 2
    check "train says that kernels are tuned" said "kernels: as tuned in $rows, line 3"
    expect "--tune goes before the row" 0 "" \
        "$cln" train "$work/blender" -o "$work/given" "${tiny[@]}" --steps 2 --tune VW=4
    check "then they are not as tuned" eval '! said "as tuned in"'
    check "run.json: --tune" eval '"$query" tune_from <"$work/given/run.json" | grep -q "^--tune"'
    expect "groups of a few work-items" 0 "" "$cln" selftest --quick --tune LS=2,SG=2
    echo '* | * | W32-* | VW=4,NV=1,TS=4' >>"$rows"
    expect "devices" 0 "" "$cln" devices --no-test --json
    check "devices names the parameters" grep -q '"VW=4,NV=1,LS=1,TS=4,' "$work/out"
    check "devices names their source" [ "$(json devices.0.tune_from)" = "$rows, line 4" ]
    check "the row is not for voxels" eval '[[ "$(json devices.0.voxel_tune_network)" = X[0-9]* &&
        "$(json devices.0.voxel_tune_from)" != "$rows"* ]]'
    echo '* | * | X* | VW=4,WG=8' >>"$rows"
    expect "devices, with a row for voxels" 0 "" "$cln" devices --no-test --json
    check "devices names the parameters of voxels" \
        grep -q '"voxel_tune": "VW=4,.*,WG=8,' "$work/out"
    check "and their source" [ "$(json devices.0.voxel_tune_from)" = "$rows, line 5" ]
    expect "devices, as text" 0 "" "$cln" devices --no-test
    check "it has the row of networks" \
        grep -qF "from $rows, line 4, for networks of W32" "$work/out"
    check "and that of voxels" grep -qF "from $rows, line 5, for voxels of X" "$work/out"
    expect "tune again, to another file" 0 "" "$cln" tune "${net[@]}" --budget 2 --json \
        --progress none --tune VW=4,TS=5 -o "$work/rows/mine.txt"
    check "tune --json is one document" [ "$(json schema)" = cl-nascent.tune/1 ]
    check "the other file has its row" grep -qF "$(json row)" "$work/rows/mine.txt"
    check "sets are judged by their figures, and stderr says so" sets_agree
    check "the first set is the start of the search" grep -q '^VW=4,NV=[0-9]*,LS=1,TS=5,' \
        <<<"$(json tries.0.tune)"

    echo '* | * | * | VW=8,XX=1' >"$work/wrong.txt"
    expect "a row that is wrong: file, line, reason" 3 "wrong.txt ~line.1 XX VW" \
        "$cln" devices --tune-file "$work/wrong.txt"
    expect "a wrong row by the environment" 3 "wrong.txt" \
        env CL_NASCENT_TUNE_FILE="$work/wrong.txt" "$cln" selftest --quick
    expect "a missing file of rows" 3 "nowhere --tune-file" \
        "$cln" train "$work/blender" -o "$work/never" "${tiny[@]}" --tune-file "$work/nowhere"
    check "train with a missing file of rows writes nothing" [ ! -e "$work/never" ]
}

section_refused() {
    # a compiler that gets sums of products wrong
    mkdir -p "$work/off" && cp kernels/lanes.h "$work/off/"
    printf '#undef MAD\n#define MAD(a, b, c) (1.001f * fma((a), (b), (c)))\n' >>"$work/off/lanes.h"
    expect "train on a device that fails the self-test: case, way out" 10 \
        "~voxels:.[a-z]+: ~does.not.compute --skip-selftest" \
        "$cln" train "$work/blender" -o "$work/refused" "${tiny[@]:1}" --steps 2 \
        --kernel-dir "$work/off"
    check "it names the device" said "$("$cln" devices --no-test --json | "$query" devices.0.name)"
    check "the refused training wrote nothing" [ ! -e "$work/refused" ]
    expect "--skip-selftest trains all the same" 0 "" \
        "$cln" train "$work/blender" -o "$work/forced" "${tiny[@]}" --steps 2 \
        --kernel-dir "$work/off"
}

run_sections "tune refused" "$@"
