#!/bin/bash
# Fuzzing of every reader of bytes from outside (fuzz.c lists the targets).
#
#   tests/fuzz/fuzz.sh SECONDS [TARGET...]   searches so long in each target, with libFuzzer (make
#                                            fuzz); found inputs stay in build/fuzz/corpus
#   TIMEOUT=20                               seconds that an input may take: more beside other work
#   tests/fuzz/fuzz.sh replay                reads the corpus and always the same changes of it
#                                            (make test)
#
# Prints a line for each target. Inputs that fail are in build/fuzz/found; once mended, they
# belong in tests/fuzz/corpus/TARGET. The last line is "N passed, N failed".
set -u
cd "$(dirname "$0")/../.." || exit 1

export UBSAN_OPTIONS=halt_on_error=1:print_stacktrace=1:suppressions=$PWD/tests/support/ubsan.supp
export ASAN_OPTIONS=allocator_may_return_null=1:detect_leaks=1
changes=50
scratch=/dev/shm
[ -w $scratch ] || scratch=/tmp
TMPDIR=$(mktemp -d "$scratch/cln-fuzz-XXXXXX") || exit 1
export TMPDIR
trap 'rm -rf "$TMPDIR"' EXIT

# one PROGRAM TARGET ARGUMENT...: "ok" or what is wrong
one() {
    local program=$1 target=$2 log
    shift 2
    ln -sf "$PWD/$program" "build/fuzz/bin/$target"
    log=build/fuzz/$target.log
    if "build/fuzz/bin/$target" "$@" "tests/fuzz/corpus/$target" >"$log" 2>&1; then
        echo "ok      $target: $(grep -E '^[0-9]+ inputs|^Done' "$log" | tail -1)"
    else
        grep -E 'ERROR|SUMMARY|fuzz:|runtime error|^    #[0-9] ' "$log" | head -20
        echo "FAILED  $target: see $log"
    fi
}
export -f one

mkdir -p build/fuzz/bin build/fuzz/found
if [ "${1:-}" = replay ]; then
    program=build/sanitize/fuzz-alone
    $program | xargs -P 2 -I{} bash -c "one $program {} -runs=$changes"
else
    seconds=${1:?usage: tests/fuzz/fuzz.sh SECONDS [TARGET...]}
    shift
    program=build/fuzz/fuzz
    # shellcheck disable=SC2046
    [ $# != 0 ] || set -- $($program)
    for target in "$@"; do
        mkdir -p "build/fuzz/corpus/$target"
        one $program "$target" -max_total_time="$seconds" -timeout="${TIMEOUT:-20}" \
            -rss_limit_mb=3000 -max_len=16384 -artifact_prefix="$PWD/build/fuzz/found/$target-" \
            "build/fuzz/corpus/$target"
    done
fi | tee build/fuzz/all.log
passed=$(grep -c '^ok ' build/fuzz/all.log)
failed=$(grep -c '^FAILED ' build/fuzz/all.log)
echo "$passed passed, $failed failed"
[ "$failed" = 0 ] && [ "$passed" != 0 ]
