#!/bin/bash
# One table of cases on every OpenCL device, against float64 and against each other: vendors'
# compilers miscompile silently, and success on one device proves little about the next.
# docs/devices.md has the results. A failure names device and case.
#   tests/device/devices.sh [-q] [SECTION...]      -q: the part that `make test-all` runs
#   table    every check of the self-test against float64, its outputs against the first device that
#            passed all: whole numbers equal, floats within the check's own bounds
#   extremes its rows at extremes, on the device with most compute units
#   unit     the kernels' tests in build/tests on each device (not with -q)
#   train    a scene trained and evaluated on each, networks and voxels: PSNR within 0.1 dB of the
#            first device's; the first device's run evaluated on each: within 0.01 dB
#   broken   kernels broken on purpose are detected and named; `train` refuses them unless forced
#   grind    the tiny shapes under Oclgrind, a simulator: no race, no bad access; all kernels ran
# Devices: all that the loader finds (OCL_ICD_VENDORS), PoCL's pthread and basic, llvmpipe of Mesa's
# rusticl. ONLY=N tests only row N of `cl-nascent devices`.
set -u
cd "$(dirname "$0")/../.." || exit 1

cases=$PWD/build/device-cases
work=$(mktemp -d "${TMPDIR:-/tmp}/cln devices [*] (+) XXXXXX")
trap 'rm -rf "$work"' EXIT
. tests/support/checks.sh
export POCL_DEVICES=${POCL_DEVICES-pthread basic} RUSTICL_ENABLE=${RUSTICL_ENABLE-llvmpipe}
reference="" reference_name=""

# ---- helpers ----

# add NAME: adds the counts of stdout's last line to ours; a failure if there is none
add() {
    local counts line p f s
    counts=$(grep -E '^[0-9]+ passed, [0-9]+ failed' "$work/out" | tail -1)
    if [ -z "$counts" ]; then
        bad "$1" "ended with status $rc; the last row is the last that it came to"
        return 1
    fi
    p=${counts%% passed*}
    f=$(echo "$counts" | sed 's/.* \([0-9]*\) failed.*/\1/')
    s=$(echo "$counts" | sed -n 's/.* \([0-9]*\) skipped.*/\1/p')
    grep -E '^(failed|skipped) |FAILED|^error' "$work/out" | cut -c -200 |
        while IFS= read -r line; do printf '%s: %s\n' "$1" "$line"; done
    echo "$1: $counts"
    passed=$((passed + p))
    failed=$((failed + f))
    skipped=$((skipped + ${s:-0}))
    [ "$f" = 0 ]
}

# Rows and names of the devices, in devices[] and names[]; best: the device of single-device checks.
find_devices() {
    local i name units most=0
    devices=() names=() best=0
    run "$cln" devices --no-test --json
    cp "$work/out" "$work/list"
    for i in $(seq 0 63); do
        name=$("$query" "devices.$i.name" <"$work/list" 2>/dev/null) || break
        [ -n "${ONLY-}" ] && [ "$ONLY" != "$i" ] && continue
        units=$("$query" "devices.$i.compute_units" <"$work/list")
        if [ "$units" -gt "$most" ]; then most=$units best=${#devices[@]}; fi
        devices+=("$i")
        name="$i $name, $("$query" "devices.$i.platform" <"$work/list")"
        names+=("$name $("$query" "devices.$i.driver" <"$work/list")")
    done
    if [ ${#devices[@]} = 0 ]; then skip "all" "no OpenCL device"; fi
}

# break_kernel FILE SED: a folder of kernels in which one file differs
break_kernel() {
    mkdir -p "$work/kernels"
    cp kernels/* include/device_abi.h "$work/kernels/"
    sed -i "$2" "$work/kernels/$1"
    if cmp -s "kernels/$1" "$work/kernels/$1"; then
        bad "kernels/$1 can be broken" "nothing in it matches $2"
        return 1
    fi
}

differ_by() { # A B MOST
    awk -v a="$1" -v b="$2" -v most="$3" \
        'BEGIN { d = a - b; exit !(a != "" && b != "" && d <= most && -d <= most) }'
}

# ---- sections ----

section_table() {
    local i
    for i in "${!devices[@]}"; do
        run timeout 900 "$cases" -d "${devices[$i]}" -s "$shapes" -r "$work/record" \
            ${reference:+-a "$reference"}
        if add "device ${names[$i]}" && [ -z "$reference" ]; then
            mv "$work/record" "$work/reference"
            reference=$work/reference reference_name=${names[$i]}
            echo "device $reference_name is what the others are compared with"
        fi
    done
    [ ${#devices[@]} -gt 1 ] || skip "devices against each other" "there is one"
}

# Kernels as users have them, at extremes; build/tests changes them, and may have none optimised.
section_extremes() {
    expect "device ${names[$best]}: extremes" 0 "" timeout 900 "$cln" selftest --extremes --quick \
        -d "${devices[$best]}"
}

section_unit() {
    local i groups="adam carry composite halo measure mlp rays regularise roulette sampling"
    groups+=" scan_sort shell_rays splat voxel"
    for i in "${!devices[@]}"; do
        # shellcheck disable=SC2086
        run env CLN_TEST_DEVICE="${devices[$i]}" timeout 1800 build/tests $groups
        add "device ${names[$i]}: unit tests"
    done
}

# train_on NAME LEAST SETTINGS...: trains on each device, with a PSNR above LEAST on the first one.
# An empty tree's PSNR on this scene is 10.8 dB.
train_on() {
    local i psnr leaves name first="" first_leaves=0 first_run="" kind=$1 least=$2
    shift 2
    for i in "${!devices[@]}"; do
        name="device ${names[$i]}, $kind"
        expect "$name: trains" 0 "" timeout 1800 \
            "$cln" train "$work/scene" -o "$work/$kind$i" -d "${devices[$i]}" \
            --progress none --quiet --steps 200 "$@" || continue
        run "$cln" eval "$work/$kind$i" -d "${devices[$i]}" --json --quiet --progress none
        psnr=$(json mean.psnr)
        leaves=$("$cln" info "$work/$kind$i" --json | "$query" leaves)
        echo "$name: $psnr dB, $leaves leaves"
        if [ -z "$first" ]; then
            first=$psnr first_leaves=$leaves first_run=$work/$kind$i
            check "$name: learns" number_above "$psnr" "$least"
            continue
        fi
        check "$name: PSNR within 0.1 dB" differ_by "$psnr" "$first" 0.1
        # rounding may change decisions close to a threshold: a twentieth of the leaves
        check "$name: as many leaves" differ_by "$leaves" "$first_leaves" $((first_leaves / 20))
        run "$cln" eval "$first_run" -d "${devices[$i]}" --json --quiet --progress none
        psnr=$(json mean.psnr)
        echo "$name: $psnr dB of the first device's run"
        check "$name: the first one's run, within 0.01 dB" differ_by "$psnr" "$first" 0.01
    done
}

section_train() {
    "$make_scene" "$work/scene" --size 64 --train 24 --test 4 >/dev/null
    train_on networks 16 --preset fast --width 16 --depth 2 --view-width 16 --bands 4 \
        --view-bands 1 --start-level 1 --level-at "2:0.2,3:0.4" --n1 8 --rays 512 \
        --max-leaves 120 --structure-from 0.5 --structure-until 0.9 --split-samples 0
    # the default preset, but for its size
    train_on voxels 22 --rays 1024 --max-leaves 600
}

# noticed NAME FILE SED ROWS: each of ROWS (grep -E patterns) fails
noticed() {
    local row
    break_kernel "$2" "$3" || return
    run "$cases" -d "${devices[$best]}" -s tiny -k "$work/kernels" -a "$work/whole"
    for row in "${@:4}"; do
        if [ $rc = 1 ] && grep -E "^failed  .*: $row" "$work/out" >/dev/null; then
            ok "$1: $row fails"
        else
            bad "$1: $row fails" "exit status $rc"
        fi
    done
}

section_broken() {
    local settings=(--preset fast --width 16 --depth 2 --bands 2 --steps 3 --rays 64 \
        --edge 0.1 --quiet \
        --progress none)
    run "$cases" -d "${devices[$best]}" -s tiny -r "$work/whole"
    add "device ${names[$best]}: tiny shapes" || return
    noticed "a wrong sign" regularise.cl 's/(-g\.xyz \* beta/(g.xyz * beta/' \
        "regularisers backward "
    noticed "one too few" group.cl 's/end\[keys\[i\]\] = i + 1u/end[keys[i]] = i/' \
        "networks backward "
    # only between layers: elsewhere indices would be read too early and could crash the device
    noticed "a missing barrier" layer.h \
        '/local float \*trunk_forward/,/return DEPTH/s/GROUP_SYNC();//' \
        "networks: (colour|density) "
    # correct by float64 (any random number is), but different from other devices
    noticed "other random numbers" sampling.cl \
        's/VLOAD(now->interval), k)/VLOAD(now->interval), k + 1u)/' \
        "samples: places, as on the other"
    [ -d "$work/scene" ] || "$make_scene" "$work/scene" --size 64 --train 24 --test 4 >/dev/null
    break_kernel regularise.cl 's/(-g\.xyz \* beta/(g.xyz * beta/' || return
    expect "train refuses, names the case and the way out" 10 \
        "~regularisers.backward --skip-selftest" \
        "$cln" train "$work/scene" -o "$work/refused" -d "${devices[$best]}" \
        --kernel-dir "$work/kernels" "${settings[@]}"
    check "a refused train writes nothing" [ ! -e "$work/refused" ]
    expect "train continues if forced" 0 "" "$cln" train "$work/scene" -o "$work/refused" \
        -d "${devices[$best]}" \
        --kernel-dir "$work/kernels" "${settings[@]}" --skip-selftest
}

# Oclgrind 21.10 simulates clang 14's code. Its options here:
#   -Drestrict=       `restrict` of inlined helpers leaves calls of an intrinsic,
#                     llvm.experimental.noalias.scope.decl, which it takes for an undefined function
#   --max-errors      by default it logs only the first thousand errors, in no fixed order
#   no --uninitialized
#                     every write of the host replaces its shadow of a global buffer by one of the
#                     write's size, and the rest counts as unwritten; and `freeze` instructions end
#                     a kernel. device-cases fills new buffers with NaN instead, so that reading
#                     unwritten memory fails a comparison.
simulate() {
    rm -f "$work/log"
    run timeout 900 oclgrind --log "$work/log" --max-errors 100000 --build-options -Drestrict= \
        --data-races \
        --inst-counts "$cases" -s tiny "$@"
    touch "$work/log"
}

reports() {
    grep -E "$1" "$work/log" >/dev/null
}

section_grind() {
    local kernel ran missing=""
    if ! command -v oclgrind >/dev/null; then
        skip "grind" "oclgrind is not installed"
        return
    fi
    if [ ! -e "$work/whole" ] && [ ${#devices[@]} -gt 0 ]; then
        run "$cases" -d "${devices[$best]}" -s tiny -r "$work/whole"
    fi
    if [ -e "$work/whole" ]; then simulate -a "$work/whole"; else simulate; fi
    add "Oclgrind"
    ran=$(sed -n "s/.*executed for kernel '\([a-z_0-9]*\)'.*/\1/p" "$work/out" | sort -u)
    head -n 40 "$work/log"
    check "no race, no bad access" [ ! -s "$work/log" ]
    # peak_*: ceilings of the benches; share_*, walk_*, stretch_*, halo_*: of several ranks
    # (tests/cli/ranks.sh);
    # sort_varying, sort_buckets: need 32768 and a million pairs,
    # which take half a minute and many minutes here
    for kernel in $(cat kernels/*.cl | tr '\n' ' ' | sed 's/__attribute__((reqd[^)]*)))//g' |
        grep -oE '__kernel +void [a-z_0-9]+' | sed 's/.* //'); do
        case $kernel in
        peak_* | sort_varying | sort_buckets | share_* | walk_* | stretch_* | halo_*) ;;
        *) grep -qx "$kernel" <<<"$ran" || missing="$missing $kernel" ;;
        esac
    done
    check "all kernels ran${missing:+, but not$missing}" [ -z "$missing" ]
    break_kernel stats.cl 's/^ *barrier(.*//' || return
    sed -i '/if (r >= n)/,/return;/d' "$work/kernels/rays.cl"
    simulate -k "$work/kernels"
    check "a missing barrier is a race" reports "data race"
    check "the race's kernel is named" reports "Kernel: stats_leaf"
    check "a missing guard is a bad access" reports 'Invalid (read|write)'
    check "the bad access's kernel is named" reports 'Kernel: rays_make'
}

shapes=all sections=(table extremes unit train broken grind)
if [ "${1-}" = -q ]; then
    shapes=quick sections=(table extremes train broken grind)
    shift
fi
[ $# -gt 0 ] && sections=("$@")
for program in "$cln" "$make_scene" "$query" "$cases"; do
    if [ ! -x "$program" ]; then
        echo "devices.sh: $program is missing; make it first" >&2
        exit 1
    fi
done
find_devices
for s in "${sections[@]}"; do
    if [ "$(type -t "section_$s")" != function ]; then
        echo "devices.sh: no section $s" >&2
        exit 2
    fi
    [ ${#devices[@]} = 0 ] && [ "$s" != grind ] && continue
    started=$SECONDS
    "section_$s"
    echo "-- $s: $((SECONDS - started)) s"
done
count
