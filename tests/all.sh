#!/bin/bash
# The suite, from the repository's root. `make test` runs what every change is to pass, in some ten
# minutes: lint, unit tests, those of kernels and readers under AddressSanitizer and
# UndefinedBehaviorSanitizer, the command line end to end. `make test-all` (all.sh all) runs the
# rest, too: what takes longer, or seldom breaks alone. Together they run each section of each
# script. A driver compiles kernels with one thread, so as many
# parts as there are processors run at once, long ones first, so that all processors are busy to the
# end; a part that mostly waits runs beside them. Each is printed when it ends, with its seconds and
# those of processors. It ends with a line "N passed, N failed[, N skipped]"; the last line here is
# their sum, and the exit status is non-zero if anything failed. A part that breaks without this
# line counts as one failure. Failures are repeated before the sum.
# shellcheck disable=SC2046,SC2086 # lists of words
set -u
cd "$(dirname "$0")/.." || exit 1

make=${MAKE:-make}
jobs=$(nproc 2>/dev/null || echo 2)
all=0
[ "${1:-}" != all ] || all=1
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

# more NAME COMMAND...: a part of `make test-all` alone
more() {
    [ "$all" = 0 ] || part "$@"
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

# Groups of unit tests: building kernels is most of what `kernels`, `checks` and `devices` do, and
# `readers` read what others wrote. `rest` is all that is in no set but `readers`.
kernels='sampling|splat|composite|measure|adam|rays|shell_rays|roulette|carry|regularise|voxel|halo'
networks=mlp checks='selftest|results' devices='extremes|devices|tuner|field_render'
long='float64|agree|surface|scan_sort|refine|units'
readers='colmap|clip|colour|image|film|progress|run_folder|safetensors|checkpoint|config|settings'
readers+='|broken_formats|cameras_file|cutout|depth_images|masks|metashape|missing|origin|phones'
readers+='|placing|readers|scene|scene_input|store|view_request|model'

# groups PROGRAM SET [EXCEPT]
groups() {
    local of=("$1") listed
    listed=$("$1" -l)
    case $2 in
    rest) listed=$(grep -v -x -E "$kernels|$networks|$checks|$devices|$long" <<<"$listed") ;;
    *) listed=$(grep -x -E "${!2}" <<<"$listed") ;;
    esac
    case $2 in kernels | networks | checks | devices) of=("${quick[@]}" "$1") ;; esac
    "${of[@]}" $(grep -v -x -E "${3:-}" <<<"$listed")
}

# others SECTION...: the arguments that leave these out
others() {
    printf -- '-%s ' "$@"
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
# Sections of scripts that every change is to pass.
ranks="same dies" trainings="train resume damage" faults="kill disk memory files"
captures="missing masks objects nerfstudio phone" hour="words training" trees="culling resume"
viewer="page pictures refused token" endings="killed again lost"
# Long ones first. Under sanitizers when those without have ended, as the driver keeps what it
# compiled: side by side both would compile the same.
beside "ranks: hangs" tests/cli/ranks.sh hangs
part "unit: rest" groups build/tests rest
part "unit: kernels" groups build/tests kernels
part "command line" "${quick[@]}" tests/cli/cli.sh
part lint tests/lint.sh
part trainings tests/cli/training.sh $trainings
part "unit: checks" groups build/tests checks
part "unit: networks" "${quick[@]}" build/tests mlp/test_points mlp/test_no_samples \
    mlp/test_small_networks
part "unit: extremes" "${quick[@]}" build/tests extremes/test_passes
part ranks tests/cli/ranks.sh $ranks
part "sanitized unit: kernels" groups build/sanitize/tests kernels
part "sanitized unit: readers" groups build/sanitize/tests readers
part captures "${quick[@]}" tests/cli/captures.sh $captures
part faults env FAULTS=1 tests/faults.sh $faults
part "first hour" "${quick[@]}" tests/cli/first_hour.sh $hour
part tree tests/cli/tree.sh $trees
part viewer "${quick[@]}" tests/cli/view.sh $viewer
part endings "${quick[@]}" tests/cli/endings.sh $endings
part poses "${quick[@]}" tests/cli/poses.sh
# leaks.sh looks for leaks: looking for them while the driver's threads end now and then crashes
sanitized=("${quick[@]}" BUILD=build/sanitize ASAN_OPTIONS="$ASAN_OPTIONS:detect_leaks=0")
part "sanitized command line" "${sanitized[@]}" tests/cli/cli.sh usage scenes
part "fuzz corpus" tests/fuzz/fuzz.sh replay

more "unit: long" groups build/tests long
more "unit: devices" groups build/tests devices
more "unit: all networks" groups build/tests networks
more "more ranks" tests/cli/ranks.sh $(others hangs $ranks)
more devices tests/device/devices.sh -q
more "captures: trees" tests/cli/captures.sh depth sparse forward beyond
more "more captures" "${quick[@]}" tests/cli/captures.sh \
    $(others depth sparse forward beyond $captures)
# Without what builds many kernels, or takes long for the same host code.
more "sanitized unit: rest" groups build/sanitize/tests rest \
    "$readers|learning|regrow|opaque|extreme_scenes"
more "sanitized unit: long" groups build/sanitize/tests long "float64|agree|refine|units"
more "sanitized unit: checks" groups build/sanitize/tests checks
more "sanitized unit: devices" groups build/sanitize/tests devices "tuner|extremes"
more "sanitized unit: some" build/sanitize/tests mlp/test_points mlp/test_no_samples \
    mlp/test_in_parts mlp/test_small_networks agree/test_positions agree/test_merged \
    agree/test_lamp_on_camera
more "more trainings" tests/cli/training.sh $(others $trainings)
more "endings: doubts" tests/cli/endings.sh short doubtful
more "more endings" "${quick[@]}" tests/cli/endings.sh $(others short doubtful $endings)
more "more faults" env FAULTS=1 tests/faults.sh $(others $faults)
more check "${quick[@]}" tests/cli/check.sh
more "more of the first hour" "${quick[@]}" tests/cli/first_hour.sh $(others $hour)
more "odd places" "${quick[@]}" tests/cli/odd_places.sh
more "more tree" tests/cli/tree.sh $(others $trees)
more tune "${quick[@]}" tests/cli/tune.sh
more "sanitized training" "${sanitized[@]}" tests/cli/training.sh resume
more "more viewer" "${quick[@]}" tests/cli/view.sh $(others silence $viewer)
more "viewer: silence" tests/cli/view.sh silence # a large picture
more leaks "${quick[@]}" tests/cli/leaks.sh
more install tests/cli/install.sh
more bench tests/cli/bench.sh
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
