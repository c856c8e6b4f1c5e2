# shellcheck shell=sh disable=SC2034
# Shell functions of the scene benches, which source it. POSIX sh.
#
#   bench_open NAME SCENE OUT LIMIT     comes first: checks the programs, makes the folder OUT
#   bench_train RUN LABEL PRESET OPTIONS...
#                                       one run in OUT/RUN, and its row in the table; sets
#                                       $trained to "no" if it does not fit the device
#   bench_value RUN PATH                a number of its run.json
#   bench_table TITLE                   the table on standard output and as OUT/NAME.md, .csv and
#                                       .svg; starts a new table
#
# The same command continues a stopped bench: it keeps finished runs and resumes interrupted ones. A
# run made with other options ends the bench, which then changes nothing. OUT/RUN.log has a run's
# output.
#
# Environment:
#   CL_NASCENT_DEVICE   where to run, as for cl-nascent -d
#   POINTS              test PSNR at these training times ("1m,2m,5m"); otherwise at 1/32, 1/16,
#                       1/8, 1/4 and 1/2 of LIMIT
#   VIEWS               test views for each of these points, evenly chosen (8)
#   FINAL               test views at the end (VIEWS; 0 = all)
#   CLN, TABLE, QUERY   the programs (build/cl-nascent, build/bench-table, build/json-query)

bench_say() {
    echo "== $*" >&2
}

bench_fail() {
    echo "$bench: $*" >&2
    exit 1
}

# "90", "90s", "10m", "2h" -> seconds
bench_seconds() {
    echo "$1" | awk '!/^[0-9]+(\.[0-9]+)?[smh]?$/ { exit 1 }
        { print $1 * (/h$/ ? 3600 : /m$/ ? 60 : 1) }' ||
        bench_fail "'$1' is not a time: give seconds, or 90s, 10m, 2h"
}

bench_open() {
    bench=$1 scene=$2 out=$3 limit=$4
    cln=${CLN:-build/cl-nascent}
    table=${TABLE:-build/bench-table}
    query=${QUERY:-build/json-query}
    views=${VIEWS:-8}
    final=${FINAL:-$views}
    for program in "$cln" "$table" "$query"; do
        [ -x "$program" ] || bench_fail "$program is not there; make bench-programs"
    done
    [ -e "$scene" ] || bench_fail "$scene: no such scene"
    # assignments of their own, so that a failure ends the script
    seconds=$(bench_seconds "$limit")
    points=$(awk -v s="$seconds" 'BEGIN {
        for (part = 32; part > 1; part /= 2) printf "%s%gs", (part < 32 ? "," : ""), s / part }')
    points=${POINTS:-$points}
    mkdir -p "$out"
    rows=$out/.rows
    : >"$rows"
}

# Prints done, interrupted, or none (no run, or no checkpoint to resume it from).
bench_state() {
    if [ ! -e "$1/run.json" ]; then
        echo none
    elif [ "$("$query" state <"$1/run.json")" = "done" ]; then
        echo "done"
    elif [ -e "$1/checkpoint/latest" ]; then
        echo interrupted
    else
        echo none
    fi
}

# Trains or resumes; 0 = trained, 5 = does not fit the device. Any other status ends the bench.
bench_run() {
    run=$1 preset=$2
    shift 2
    status=0
    case $(bench_state "$run") in
    "done")
        bench_say "$run exists already"
        return 0
        ;;
    none)
        bench_say "$run: training for $limit"
        rm -rf "$run"
        "$cln" train "$scene" -o "$run" --preset "$preset" "$@" --progress none --json \
            >"$run.log" 2>&1 || status=$?
        ;;
    *)
        bench_say "$run: resuming"
        "$cln" train --resume "$run" "$@" --progress none --json >>"$run.log" 2>&1 || status=$?
        ;;
    esac
    [ $status = 0 ] || [ $status = 5 ] || {
        tail -n 3 "$run.log" >&2
        bench_fail "$run ended with status $status; see $run.log"
    }
    return $status
}

bench_train() {
    name=$1 label=$2 preset=$3
    shift 3
    set -- --time-limit "$limit" --eval-at "$points" --eval-images "$views" "$@"
    run=$out/$name
    given=$(printf '%s\n' "$scene" "$preset" "$@")
    # only a folder with our list of options is ours to remove
    if [ -e "$run" ] && [ ! -e "$run.options" ]; then
        bench_fail "$run was not made by a bench; choose another OUT"
    fi
    if [ -e "$run.options" ] && [ "$(cat "$run.options")" != "$given" ]; then
        bench_fail "$run was made with other options ($run.options); choose another OUT"
    fi
    printf '%s\n' "$given" >"$run.options"
    trained=yes
    if ! bench_run "$run" "$preset" "$@"; then
        bench_say "$run is left out: it does not fit the device ($run.log)"
        trained=no
        return 0
    fi
    if [ "$final" != "$views" ] && [ ! -s "$run.eval-$final.json" ]; then
        bench_say "$run: evaluation"
        "$cln" eval "$run" --max-images "$final" --no-save-images --progress none --json \
            >"$run.eval.new" 2>>"$run.log" || bench_fail "$run: see $run.log"
        mv "$run.eval.new" "$run.eval-$final.json"
    fi
    printf '%s=%s\n' "$label" "$run" >>"$rows"
}

bench_value() {
    "$query" "$2" <"$out/$1/run.json" || bench_fail "$out/$1/run.json: no $2"
}

bench_table() {
    title=$1
    [ -s "$rows" ] || bench_fail "no run fits the device"
    set --
    while IFS= read -r row; do
        set -- "$@" "$row"
    done <"$rows"
    "$table" -t "$title" "$out/$bench" "$@" >"$out/$bench.md"
    cat "$out/$bench.md"
    bench_say "$out/$bench.md, $out/$bench.csv, $out/$bench.svg"
    : >"$rows"
}

# ---- settings of several benches ----

# A leaf network of the paper's kind: WIDTH and DEPTH, view layer of VIEW_WIDTH (256), 10 and 4
# frequencies. The fast preset's learning rate suits its 32 neurons; here it falls with the width,
# unless LR sets it.
bench_network() {
    awk -v w="$1" -v d="$2" -v v="${VIEW_WIDTH:-256}" -v lr="${LR:-0}" 'BEGIN {
        if (lr + 0 == 0) lr = 0.128 / w
        printf "--width %d --depth %d --view-width %d --bands 10 --view-bands 4 --skip", w, d, v
        printf " --lr %g --lr-final %g", lr, lr / 20 }'
}

growth=${GROWTH:-3:0.08 4:0.25 5:0.4}

# A tree that grows to a level, whole levels at a time, like the fast preset's: from level 2, or
# from the level itself if it is lower. GROWTH: LEVEL:FRACTION of the budget.
bench_growth() {
    start=2 at=
    if [ "$1" -lt 2 ]; then
        start=$1
    fi
    for point in $growth; do
        if [ "${point%%:*}" -gt "$start" ] && [ "${point%%:*}" -le "$1" ]; then
            at=$at${at:+,}$point
        fi
    done
    echo "--start-level $start --level-at=$at"
}

# The fraction of the budget at which the tree reaches whole level $1.
bench_growth_at() {
    for point in $growth; do
        if [ "${point%%:*}" = "$1" ]; then
            echo "${point#*:}"
            return
        fi
    done
    echo 0
}
