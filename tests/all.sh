#!/bin/bash
# The whole suite behind `make test`, from the repository's root: lint, unit tests, the same under
# AddressSanitizer and UndefinedBehaviorSanitizer, the command line end to end, the installed
# library, and the devices side by side. Each part ends with a line "N passed, N failed[, N
# skipped]"; the last line here is their sum, and the exit status is non-zero if anything failed. A
# part that breaks without this line counts as one failure. Failures are repeated before the sum.
set -u
cd "$(dirname "$0")/.." || exit 1

make=${MAKE:-make}
jobs=$(nproc 2>/dev/null || echo 2)
passed=0 failed=0 skipped=0 failures=""
mkdir -p build
log=build/test-part.log

# lines that report a failure
telling='FAILED|^failed|: failed|exit status|ended by|[1-9][0-9]* failed|^=='
telling+='|SUMMARY: |leak of|^ +#[0-9]' # sanitizers

# part NAME COMMAND...
part() {
    local name=$1 started=$SECONDS status counts p f s
    shift
    printf '\n== %s\n' "$name"
    "$@" 2>&1 | tee "$log" | sed -u -E "s/^([0-9]+ passed, [0-9]+ failed)/$name: \1/"
    status=${PIPESTATUS[0]}
    counts=$(grep -E '^[0-9]+ passed, [0-9]+ failed' "$log" | tail -1)
    p=$(echo "$counts" | sed -n 's/^\([0-9]*\) passed.*/\1/p')
    f=$(echo "$counts" | sed -n 's/.* \([0-9]*\) failed.*/\1/p')
    s=$(echo "$counts" | sed -n 's/.* \([0-9]*\) skipped.*/\1/p')
    if [ "$status" != 0 ] && [ "${f:-0}" = 0 ]; then
        echo "$name: exit status $status" | tee -a "$log"
        f=1
    fi
    [ "${f:-0}" = 0 ] || failures+=$(grep -E "$telling" "$log" |
        head -n 40 | sed "s/^/$name: /")$'\n'
    passed=$((passed + ${p:-0}))
    failed=$((failed + ${f:-0}))
    skipped=$((skipped + ${s:-0}))
    echo "$name: $((SECONDS - started)) s"
}

# halves PROGRAM GROUP...: runs the groups in two simultaneous processes, because a driver compiles
# kernels with one thread. The last line is their sum.
halves() {
    local program=$1 status=0 other first second
    shift
    first=$(printf '%s\n' "$@" | grep -x -E 'mlp|scan_sort|sampling|composite|splat')
    second=$(printf '%s\n' "$@" | grep -v -x -E 'mlp|scan_sort|sampling|composite|splat')
    # shellcheck disable=SC2086
    "$program" $first >build/test-first.log 2>&1 &
    other=$!
    # shellcheck disable=SC2086
    "$program" $second >build/test-second.log 2>&1 || status=1
    wait $other || status=1
    cat build/test-first.log build/test-second.log | awk '
        /^[0-9]+ passed, [0-9]+ failed/ { p += $1; f += $3; s += $5; n++; next }
        { print }
        END {
            printf "%d passed, %d failed%s\n", p, f, s ? ", " s " skipped" : ""
            exit n != 2
        }' || status=1
    rm -f build/test-first.log build/test-second.log
    return $status
}

unit() {
    # shellcheck disable=SC2046
    halves build/tests $(build/tests -l)
}

# Unit tests under sanitizers, without the groups that build many kernels: those would take minutes
# and run the same host code.
sanitized() {
    # shellcheck disable=SC2046
    halves build/sanitize/tests $(build/sanitize/tests -l | grep -v -x -E "mlp|tuner")
}

export ASAN_OPTIONS=allocator_may_return_null=1:detect_leaks=1
export UBSAN_OPTIONS=halt_on_error=1:print_stacktrace=1:suppressions=$PWD/tests/support/ubsan.supp
export LSAN_OPTIONS=suppressions=$PWD/tests/support/lsan.supp:print_suppressions=0

part build "$make" --no-print-directory -j"$jobs" WERROR=1 build/cl-nascent build/make-scene \
    build/json-query build/device-cases build/tests build/bench-kernels build/faults.so
part lint tests/lint.sh
part unit unit
part "command line" tests/cli/cli.sh
part "first hour" tests/cli/first_hour.sh
part captures tests/cli/captures.sh
part viewer tests/cli/view.sh
part ranks tests/cli/ranks.sh
part faults env FAULTS=1 tests/faults.sh kill disk memory device clock
part install tests/cli/install.sh
part devices tests/device/devices.sh -q
part "sanitized build" "$make" --no-print-directory -j"$jobs" SANITIZE=address,undefined \
    build/sanitize/cl-nascent build/sanitize/make-scene build/sanitize/tests \
    build/sanitize/fuzz-alone
part "sanitized unit" sanitized
part "fuzz corpus" tests/fuzz/fuzz.sh replay
part "sanitized command line" env BUILD=build/sanitize tests/cli/cli.sh usage scenes resume
rm -f "$log"

printf '\n%s' "$failures"
printf '\n%d passed, %d failed%s\n' $passed $failed \
    "$([ $skipped = 0 ] || echo ", $skipped skipped")"
[ $failed = 0 ]
