#!/bin/bash
# Support of tests/cli/*.sh and devices.sh: checks that count themselves, and the environment of a
# new user. Source it from the repository's root with $work set to a folder of the script.
# BUILD=build/sanitize: the programs to test.
# shellcheck disable=SC2034,SC2154
BUILD=${BUILD:-build} here=$PWD
cln=$here/$BUILD/cl-nascent
make_scene=$here/$BUILD/make-scene
query=$here/build/json-query
passed=0 failed=0 skipped=0
export LC_ALL=C
unset CL_NASCENT_DEVICE CL_NASCENT_KERNEL_DIR CL_NASCENT_TUNE_FILE CL_NASCENT_RANK_WAIT CI NO_COLOR
export TERM=xterm
export XDG_CONFIG_HOME=$work/config # without the user's rows

# A network and a tree that are trained in a second, for those who add --steps.
# shellcheck disable=SC2034
tiny=(--skip-selftest --progress none --preset fast --width 16 --depth 2 --view-width 16
    --view-bands 1 --bands 2 --start-level 1 --level-at "" --no-adaptive --n1 6 --rays 256
    --batch-samples 2048 --refresh-every 8)
# One that grows and is culled on the way; and that splits and merges, too.
grown=(--skip-selftest --preset fast --width 16 --depth 2 --view-width 16 --view-bands 1 --bands 4
    --start-level 1 --level-at 2:0.4 --n1 8 --rays 256 --batch-samples 4096 --refresh-every 16
    --cull-from 0.3 --cull-after 0 --max-leaves 60 --distil-steps 20)
# shellcheck disable=SC2034
adapted=("${grown[@]}" --progress none --log-every 1 --structure-from 0.5 --structure-every 0.1
    --structure-until 0.95 --split-samples 0)

ok() {
    passed=$((passed + 1))
    echo "ok      $1"
}

bad() {
    failed=$((failed + 1))
    echo "FAILED  $1${2:+ ($2)}"
    for f in out err; do
        [ -s "$work/$f" ] && tail -n 15 "$work/$f" | cut -c -400 | sed "s/^/        $f: /"
    done
}

skip() {
    skipped=$((skipped + 1))
    echo "skipped $1: $2"
}

# check NAME COMMAND...: the command (a test) succeeds
check() {
    local name=$1
    shift
    if "$@"; then ok "$name"; else bad "$name" "$*"; fi
}

run() {
    "$@" >"$work/out" 2>"$work/err"
    rc=$?
}

# said WORD: the last stderr contains WORD, ignoring case. WORD is literal unless it begins with ~,
# which makes the rest a pattern of grep -E.
said() {
    case $1 in
    "~"*) grep -qiE -- "${1#"~"}" "$work/err" ;;
    *) grep -qiF -- "$1" "$work/err" ;;
    esac
}

# expect NAME CODE WORDS COMMAND...: the exit code, and each of WORDS on stderr, as for `said`.
# Spaces separate WORDS; a text with spaces needs a separate check: check NAME said TEXT.
expect() {
    local name=$1 code=$2 words word
    read -ra words <<<"$3"
    shift 3
    run "$@"
    if [ $rc != "$code" ]; then
        bad "$name" "exit code $rc, not $code"
        return 1
    fi
    for word in "${words[@]}"; do
        if ! said "$word"; then
            bad "$name" "nothing about '$word' on stderr"
            return 1
        fi
    done
    ok "$name"
}

# The value at a path of the JSON document on the last stdout.
json() {
    "$query" "$1" <"$work/out" 2>>"$work/err"
}

# digest RUN: of its model; empty if there is none
digest() {
    "$cln" info "$1" --json 2>/dev/null | "$query" model_digest
}

# same_model RUN RUN: bit for bit
same_model() {
    local first
    first=$(digest "$1")
    [ -n "$first" ] && [ "$first" = "$(digest "$2")" ]
}

number_above() {
    awk -v a="$1" -v b="$2" 'BEGIN { exit !(a + 0 > b + 0) }'
}

# Prints the last line of a script; returns its exit status.
count() {
    echo "$passed passed, $failed failed$([ $skipped = 0 ] || echo ", $skipped skipped")"
    [ $failed = 0 ]
}

# run_sections "ALL SECTIONS" [SECTION...|-SECTION...]: calls section_NAME of each, of all,
# or of all but those with a dash, and counts. Needs $cln and $make_scene.
run_sections() {
    local program s started sections
    for program in "$cln" "$make_scene" "$query"; do
        if [ ! -x "$program" ]; then
            echo "$0: $program is missing; make it first" >&2
            exit 1
        fi
    done
    read -ra sections <<<"$1"
    shift
    case ${1--} in
    -) ;;
    -*) read -ra sections <<<"$(printf '%s\n' "${sections[@]}" |
        grep -vxF "$(printf '%s\n' "${@#-}")" | tr '\n' ' ')" ;;
    *) sections=("$@") ;;
    esac
    for s in "${sections[@]}"; do
        if [ "$(type -t "section_$s")" != function ]; then
            echo "$0: no section $s" >&2
            exit 2
        fi
        started=$SECONDS
        "section_$s"
        echo "-- $s: $((SECONDS - started)) s"
    done
    count
}

# printed TEXT: TEXT is on the last stdout, literally
printed() {
    grep -qF -- "$1" "$work/out"
}

not_said() {
    ! said "$1"
}

# A pseudo-terminal of COLUMNS columns, for programs that look at theirs: what it shows is in out.
on_terminal() { # on_terminal COLUMNS COMMAND...
    local columns=$1
    shift
    COMMAND=$(printf '%q ' "$@")
    rc=0
    script -qec "stty cols $columns; $COMMAND" /dev/null >"$work/out" 2>"$work/err" </dev/null ||
        rc=$?
}
