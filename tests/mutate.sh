#!/bin/bash
# Would the tests notice a mistake? Puts one at a time (a mutant: an operator, a number, a
# condition, a statement less, arguments swapped) into copies of this tree and runs tests until one
# fails. Not a part of make test: it takes hours. perl is needed.
#
#   tests/mutate.sh [FILE...]    sources to change (kernels, and host without cli, report and
#                                ranks; not peak.cl, where only speed matters, nor what only
#                                several ranks run: share, stretch.c and checkpoint_parts.c, which
#                                tests/cli/ranks.sh tests)
#   AGAIN=1 tests/mutate.sh      only those that survived, after tests were added
#   COUNT=150                    mutants that compile
#   SEED=1                       which ones
#   JOBS=2                       copies, in build/mutants
#   LIMIT=9999                   minutes after which no new one is begun
#   SPEND=9999                   processor seconds of tests that a mutant may cost; those that they
#                                do not notice have survived, for AGAIN=1 with more
# Only tests of a room and of rooms above it can notice a mistake in it; a group ends at
# its first failed test, counts as hung after some processor seconds, and begins with a copy of the
# driver's cache of kernels. Seconds of groups are measured once, by a run without a mistake, and
# kept in build/mutants/times.
# Results are rows in build/mutants/results, which a further call keeps; remove it to start again.
# tests/support/mutants.txt explains survivors that no test can tell: file, changed line (of a
# statement less: "without" and the statement), reason.
# The last line counts; the exit code is 1 if a mutant survived that is not explained there, if a
# copy could not be made, and if there are no results.
set -u
cd "$(dirname "$0")/.." || exit 1

count=${COUNT:-150} seed=${SEED:-1} jobs=${JOBS:-2} limit=${LIMIT:-9999}
spend=${SPEND:-9999}
out=$PWD/build/mutants
results=$out/results
perl=tests/support/mutants.pl
programs=(build/tests build/cl-nascent build/make-scene build/json-query)
mkdir -p "$out"
touch "$results"
export LC_ALL=C

# ---- one copy ----

# The tree as it is, with what is built, and the driver's compiled kernels. The first one's tests
# pass, and times has the seconds of each group.
make_copy() {
    local copy=$1
    rm -rf "$copy"
    mkdir -p "$copy"
    git ls-files -z -co --exclude-standard | tar -c --null -T - 2>/dev/null | tar -x -C "$copy"
    mkdir -p "$copy/build"
    cp -a build/obj build/sanitize "$copy/build/" 2>/dev/null
    cp -a "${POCL_CACHE_DIR:-${XDG_CACHE_HOME:-$HOME/.cache}/pocl/kcache}" "$copy/pocl" 2>/dev/null
    (
        cd "$copy" || exit 1
        make --no-print-directory "${programs[@]}" >log 2>&1 || exit 1
        flock 9
        [ -s "$out/times" ] ||
            { POCL_CACHE_DIR=$copy/pocl build/tests >log 2>&1 &&
                sed -n 's/^\([a-z0-9_]*\)  *[0-9]* passed.*, \([0-9.]*\) s$/\2 \1/p' log |
                sort -n >"$out/times"; }
    ) 9>"$out/lock" || {
        tail -n 5 "$copy/log"
        echo "mutate: $copy: the tests do not pass without a mistake, either" >&2
        return 1
    }
}

# Test groups of the rooms in $1
groups_of() {
    local room
    for room in $1; do
        sed -n 's/^int test_group_\([a-z0-9_]*\)(void)$/\1/p' tests/"$room"/test_*.c 2>/dev/null
    done | paste -sd '|'
}

# Seconds and names of test groups in the order in which they may notice a mistake in a file: of its
# name (or of kernels that need it, or that it needs), of its room, of rooms above (kernels are
# pipeline's); quick ones first.
order() {
    local file=$1 room name own users
    local rooms="cli api export train view render check pipeline report model scene device ranks io"
    name=$(basename "$file")
    name=${name%%.*}
    room=$(basename "$(dirname "$file")")
    [ "$room" != kernels ] || room=pipeline
    case $file in kernels/*.h) # the files that need it, in three rounds, and those that it needs
        for _ in 1 2 3; do
            users=$(grep -lE "^/\* needs:.*\<(${name// /|})\>" kernels/* | sed 's|.*/||; s|\..*||')
            name=$(printf '%s\n' $name $users | sort -u | paste -sd ' ')
        done
        name+=" $(sed -n '1s|^/\* needs: \(.*\) \*/$|\1|p' "$file")" ;; # walk.h: shell_rays
    esac
    own="^($(for name in $name; do printf '%s(s|_.*)?|%s|' "$name" "${name%%_*}"; done)-)$"
    rooms="$rooms reference base"
    build/tests -l | awk -v own="$own" -v near="^($(groups_of "$room"))$" \
        -v may="^($(groups_of "${rooms%%"$room"*} $room"))$" '
        FILENAME != "-" { seconds[$2] = $1; next } # none for a new group
        $1 ~ may { print ($1 ~ own ? 0 : $1 ~ near ? 1 : 2), seconds[$1] + 0, $1 }' \
        "$out/times" - | sort -n -k1,1 -k2,2 | cut -d ' ' -f 2-
}

# spent: processor seconds of what this copy has run so far (not by $(...) or a pipe, which are
# processes without children)
count_spent() {
    times >used
    spent=$(awk 'NR == 2 {
        for (i = 1; i <= 2; i++) { split($i, t, "m"); sum += 60 * t[1] + t[2] }
        printf "%d", sum }' used)
}

# Is something left of $most, for the current mutant?
may_spend() {
    count_spent
    [ "$spent" -lt "$most" ]
}

# notices SECONDS COMMAND...: it fails, or takes far too long
notices() {
    local seconds=$1
    shift
    ! (ulimit -t "$seconds" && exec timeout -k 5 1800 "$@") >log 2>&1 </dev/null
}

# What notices the mistake in FILE, or nothing.
noticed_by() {
    local file=$1 seconds group script
    local most=$((spent + spend)) compile=15
    export POCL_CACHE_DIR=$PWD/pocl
    [ "${file%%/*}" != kernels ] || compile=200 # no program is in the driver's cache
    while read -r seconds group; do
        may_spend || return
        notices $((compile + 5 * ${seconds%.*})) build/tests -x "$group" && by=$group && return
    done < <(order "$file")
    may_spend || return
    make --no-print-directory "${programs[@]}" >log 2>&1
    if [ "${file%%/*}" = kernels ]; then
        notices 300 build/cl-nascent selftest && by=selftest && return
        may_spend || return
        notices 900 make --no-print-directory grind && by=grind
        return
    fi
    for script in cli training tune captures check poses first_hour odd_places view; do
        may_spend || return
        notices 600 "tests/cli/$script.sh" && by=$script.sh && return
    done
    export ASAN_OPTIONS=allocator_may_return_null=1:detect_leaks=1
    export UBSAN_OPTIONS=halt_on_error=1:suppressions=$PWD/tests/support/ubsan.supp
    export LSAN_OPTIONS=suppressions=$PWD/tests/support/lsan.supp:print_suppressions=0
    make --no-print-directory SANITIZE=address,undefined build/sanitize/tests >log 2>&1
    while read -r seconds group; do
        may_spend || return
        notices 600 build/sanitize/tests -x "$group" && by="$group, sanitized" && return
    done < <(order "$file" | head -n 12)
}

# Adds the row of $row's mutant; its earlier row, of a survivor, goes now that this one is there.
record() {
    (
        flock 9
        grep -vF $'\t'"$row"$'\t' "$results" >"$results.new"
        printf '%s\t%s\t%s\t%s\n' "$@" >>"$results.new"
        mv "$results.new" "$results"
    ) 9>"$out/lock"
}

# Takes mutants from the list, each worker every JOBS-th.
work() {
    local number=$1 copy=$out/copy$1 n=0 kind file line column old new by row changed before
    make_copy "$copy" || return 1
    cd "$copy" || return 1
    while IFS=$'\t' read -r kind file line column old new; do
        [ $((n++ % jobs)) = "$number" ] || continue
        [ "$(wc -l <"$results")" -lt "$count" ] || break
        [ $SECONDS -lt $((limit * 60)) ] || break
        row=$(printf '%s\t%s\t%s\t%s\t%s' "$file" "$line" "$column" "$old" "$new")
        [ -n "${AGAIN:-}" ] || ! grep -qF $'\t'"$row"$'\t' "$results" || continue
        cp "$file" kept
        if ! perl $perl apply "$file" "$line" "$column" "$old" "$new"; then
            echo "$file:$line: not applied, the text has changed" >&2
            continue
        fi
        count_spent
        before=$spent
        if make --no-print-directory build/tests >log 2>&1; then
            by=
            noticed_by "$file"
            changed=$(perl $perl line "$file" "$line")
            [ "$kind" != statement ] || changed="without ${old#"${old%%[! ]*}"}"
            record "${by:-survived}" "$kind" "$row" "$changed"
            count_spent
            printf '%s:%s: %s, %d s: %s\n' "$file" "$line" "${by:-SURVIVED}" \
                $((spent - before)) "$changed"
        fi
        cp kept "$file"
    done <"$out/list"
}

# ---- all ----

if [ -n "${AGAIN:-}" ]; then
    grep "^survived" "$results" | cut -f 2-7 >"$out/list"
    count=$(($(wc -l <"$results") + 1)) # all of the list
else
    files=("$@")
    [ $# -gt 0 ] || for file in kernels/* host/*/*.c; do
        case $file in
        kernels/peak.cl | kernels/share.cl | host/cli/* | host/report/* | host/ranks/*) ;;
        host/pipeline/share.c | host/pipeline/stretch.c | host/model/checkpoint_parts.c) ;;
        *) files+=("$file") ;;
        esac
    done
    perl $perl list "$seed" "${files[@]}" >"$out/list"
fi
trap 'kill $(jobs -p) 2>/dev/null' EXIT
workers=() failed=0
for ((i = 0; i < jobs; i++)); do
    work "$i" &
    workers+=($!)
done
for i in "${workers[@]}"; do
    wait "$i" || failed=1
done

# Those that survived and are not explained.
awk -F '\t' -v failed=$failed '
    FILENAME ~ /mutants.txt$/ { if (!/^#/) why[$1 FS $2] = 1; next }
    $1 != "survived" { killed++; next }
    ($3 FS $8) in why { explained++; next }
    { left++; printf "survived  %s:%s  %s  (%s -> %s)\n", $3, $4, $8, $6, $7 }
    END {
        printf "%d mutants: %d noticed, %d survived, %d of them explained; " \
            "%.1f %% noticed of the others\n",
            killed + explained + left, killed, explained + left, explained,
            killed + left ? 100 * killed / (killed + left) : 0
        exit left > 0 || failed || !(killed + explained + left)
    }' tests/support/mutants.txt "$results"
