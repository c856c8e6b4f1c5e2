#!/bin/bash
# The whole suite behind `make test`, from the repository's root: lint, unit tests, the same under
# AddressSanitizer and UndefinedBehaviorSanitizer, the command line end to end, the installed
# library, and the devices side by side. A driver compiles kernels with one thread, so as many
# parts as there are processors run at once, long ones first, so that all processors are busy to the
# end; a part that mostly waits runs beside them. Each is printed when it ends, with its seconds and
# those of processors. It ends with a line "N passed, N failed[, N skipped]"; the last line here is
# their sum, and the exit status is non-zero if anything failed. A part that breaks without this
# line counts as one failure. Failures are repeated before the sum.
set -u
cd "$(dirname "$0")/.." || exit 1

make=${MAKE:-make}
jobs=$(nproc 2>/dev/null || echo 2)
logs=build/test-parts
parts=0
waiting=none # the process of the part that mostly waits
rm -rf "$logs"
mkdir -p "$logs"
trap 'kill $(jobs -p) 2>/dev/null' EXIT

# lines that report a failure
telling='FAILED|^failed|: failed|exit status|ended by|[1-9][0-9]* failed|^=='
telling+='|SUMMARY: |leak of|^ +#[0-9]' # sanitizers

# spent FILE: the processors' seconds of a shell's children, of what `times` wrote
spent() {
    awk 'NR == 2 { for (i = 1; i <= 2; i++) { split($i, t, "[ms]"); s += 60 * t[1] + t[2] } }
        END { printf "%.0f\n", s }' "$1"
}

# finish NAME LOG COMMAND...: runs a part, prints its log in one piece, and leaves its counts and
# its failures beside the log
finish() {
    local name=$1 at=$2 status seconds counts p f s
    shift 2
    SECONDS=0
    "$@" >"$at.log" 2>&1 </dev/null
    status=$?
    seconds=$SECONDS
    times >"$at.times" # here, as subshells have their own
    counts=$(grep -E '^[0-9]+ passed, [0-9]+ failed' "$at.log" | tail -1)
    p=$(echo "$counts" | sed -n 's/^\([0-9]*\) passed.*/\1/p')
    f=$(echo "$counts" | sed -n 's/.* \([0-9]*\) failed.*/\1/p')
    s=$(echo "$counts" | sed -n 's/.* \([0-9]*\) skipped.*/\1/p')
    if [ "$status" != 0 ] && [ "${f:-0}" = 0 ]; then
        echo "$name: exit status $status" >>"$at.log"
        f=1
    fi
    [ "${f:-0}" = 0 ] ||
        grep -E "$telling" "$at.log" | head -n 40 | sed "s/^/$name: /" >"$at.failed"
    {
        flock 9
        printf '\n== %s\n' "$name"
        sed -E "s/^([0-9]+ passed, [0-9]+ failed)/$name: \1/" "$at.log"
        echo "$name: $seconds s, $(spent "$at.times") s of processors"
    } 9>"$logs/lock"
    echo "${p:-0} ${f:-0} ${s:-0}" >"$at.counts"
}

# part NAME COMMAND...: starts it as soon as a processor is free
part() {
    while [ "$(jobs -rp | grep -cvx "$waiting")" -ge "$jobs" ]; do wait -n; done
    parts=$((parts + 1))
    finish "$1" "$logs/$(printf '%02d' $parts)" "${@:2}" &
}

# beside NAME COMMAND...: starts the part that mostly waits, without a processor of its own
beside() {
    parts=$((parts + 1))
    finish "$1" "$logs/$(printf '%02d' $parts)" "${@:2}" &
    waiting=$!
}

# build TARGET...: and the program for several processes, which two parts need
build() {
    "$make" --no-print-directory -j"$jobs" WERROR=1 "$@" || return
    if command -v mpirun >/dev/null && pkg-config --exists ompi-c; then
        "$make" --no-print-directory WERROR=1 MPI=1 build/mpi/cl-nascent
    fi
}

# groups PROGRAM NAME [EXCEPT]: a share of a program's test groups. Building kernels is most of what
# `kernels` and `checks` do.
groups() {
    local kernels='sampling|splat|composite|measure|adam|rays|shell_rays|roulette|carry|regularise'
    local checks='extremes|selftest|devices|tuner|results|field_render'
    kernels+='|voxel|halo'
    # shellcheck disable=SC2046
    case $2 in
    networks) "$1" mlp ;;
    kernels | checks) "${quick[@]}" "$1" $("$1" -l | grep -x -E "${!2}" | grep -v -x -E "${3:-}") ;;
    rest) "$1" $("$1" -l | grep -v -x -E "$kernels|$checks|mlp${3:+|$3}") ;;
    esac
}

# Kernels that are compiled without being optimised, where few samples run on them: PoCL takes half
# as long. Optimised ones are held against float64 by devices.sh, on two of its devices, and trained
# with by devices.sh, training.sh, tree.sh and ranks.sh.
quick=(env POCL_EXTRA_BUILD_FLAGS=-cl-opt-disable)

export ASAN_OPTIONS=allocator_may_return_null=1:detect_leaks=1
export UBSAN_OPTIONS=halt_on_error=1:print_stacktrace=1:suppressions=$PWD/tests/support/ubsan.supp
export LSAN_OPTIONS=suppressions=$PWD/tests/support/lsan.supp:print_suppressions=0

part build build build/cl-nascent build/make-scene build/json-query build/device-cases build/tests \
    build/bench-kernels build/faults.so
wait
part "sanitized build" "$make" --no-print-directory -j"$jobs" SANITIZE=address,undefined \
    build/sanitize/cl-nascent build/sanitize/make-scene build/sanitize/tests \
    build/sanitize/fuzz-alone
wait
# Long ones first. Under sanitizers when those without have ended, as the driver keeps what it
# compiled: side by side both would compile the same.
beside "ranks: hangs" tests/cli/ranks.sh hangs
part "unit: rest" groups build/tests rest
part ranks tests/cli/ranks.sh -hangs
part trainings tests/cli/training.sh
part "unit: checks" groups build/tests checks
part devices tests/device/devices.sh -q
part "unit: networks" groups build/tests networks
part "captures: trees" tests/cli/captures.sh depth sparse forward beyond
part captures "${quick[@]}" tests/cli/captures.sh -depth -sparse -forward -beyond
part "unit: kernels" groups build/tests kernels
# Without what builds many kernels, or takes long for the same host code.
part "sanitized unit: rest" groups build/sanitize/tests rest \
    "float64|refine|learning|regrow|units|opaque|extreme_scenes|agree"
part "sanitized unit: checks" groups build/sanitize/tests checks "tuner|extremes"
part "sanitized unit: kernels" groups build/sanitize/tests kernels
part "endings: doubts" tests/cli/endings.sh short doubtful
part endings "${quick[@]}" tests/cli/endings.sh -short -doubtful
part faults env FAULTS=1 tests/faults.sh
part "command line" "${quick[@]}" tests/cli/cli.sh
part check "${quick[@]}" tests/cli/check.sh
part poses "${quick[@]}" tests/cli/poses.sh
part lint tests/lint.sh
part "first hour" "${quick[@]}" tests/cli/first_hour.sh
part "odd places" "${quick[@]}" tests/cli/odd_places.sh
part tree tests/cli/tree.sh
part tune "${quick[@]}" tests/cli/tune.sh
# leaks.sh looks for leaks: looking for them while the driver's threads end now and then crashes
sanitized=("${quick[@]}" BUILD=build/sanitize ASAN_OPTIONS="$ASAN_OPTIONS:detect_leaks=0")
part "sanitized command line" "${sanitized[@]}" tests/cli/cli.sh usage scenes
part "sanitized training" "${sanitized[@]}" tests/cli/training.sh resume
part viewer "${quick[@]}" tests/cli/view.sh
part leaks "${quick[@]}" tests/cli/leaks.sh
part install tests/cli/install.sh
part bench tests/cli/bench.sh
part "sanitized unit: some" build/sanitize/tests mlp/test_points mlp/test_no_samples \
    mlp/test_in_parts mlp/test_small_networks agree/test_positions agree/test_merged \
    agree/test_lamp_on_camera
part "fuzz corpus" tests/fuzz/fuzz.sh replay
wait

cat "$logs"/*.failed 2>/dev/null | sed '1i\
'
cat "$logs"/*.counts | awk -v parts=$parts '
    { p += $1; f += $2; s += $3; n++ }
    END {
        f += parts - n # ended without a count
        printf "\n%d passed, %d failed%s\n", p, f, s ? ", " s " skipped" : ""
        exit f > 0
    }'
