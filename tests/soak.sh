#!/bin/bash
# A soak: trains for hours with a stop and a resume every few minutes, beside one training of as
# many steps that is not stopped. Fails if the process grows, or if the two end with other weights.
# Not a part of make test. EVERY must be several times as long as a start.
#
#   HOURS=6 tests/soak.sh [SCENE] [TRAIN OPTIONS]
#   SCENE          a scene (the generated one of data/scenes.h, 64 x 64)
#   HOURS=6        of the training with stops
#   EVERY=300      seconds from one stop to the next
#   GROWTH=1.1     memory in the last quarter over that in the second one, the most that is allowed
#   OUT=build/soak a folder for its runs and table, emptied first
# A process begins with little memory and grows as the tree does, so only the process of the run
# without stops is compared with itself, after half of its steps, when the tree is whole; of the
# others, peaks from one resume to the next. The budget in steps is measured first. The last line
# says what was found; the exit code is 1 if something was.
set -eu
cd "$(dirname "$0")/.." || exit 1

hours=${HOURS:-6} every=${EVERY:-300} growth=${GROWTH:-1.1} out=${OUT:-build/soak}
cln=${CLN:-build/cl-nascent}
query=${QUERY:-build/json-query}
make_scene=${MAKE_SCENE:-build/make-scene}
for program in "$cln" "$query" "$make_scene"; do
    [ -x "$program" ] || { echo "soak: $program is missing; make it first" >&2; exit 2; }
done
rm -rf "$out"
mkdir -p "$out"
scene=${1:-$out/scene}
[ $# = 0 ] || shift
[ "$scene" != "$out/scene" ] || "$make_scene" "$scene" --size 64 --train 24 --test 4 >/dev/null
options=(--skip-selftest --progress none -q --save-every 1000000 "$@")
faults=0 child=
trap '[ -z "$child" ] || kill "$child" 2>/dev/null || true' EXIT

value() {
    "$query" "$2" <"$1"
}
digest() {
    "$cln" info "$1" --json | "$query" model_digest
}
found() {
    faults=$((faults + 1))
    echo "soak: $*" >&2
}
# Resident bytes of a process now, in KiB; 0 if it has ended.
resident() {
    awk '/^VmRSS:/ { kib = $2 } END { print kib + 0 }' "/proc/$1/status" 2>/dev/null || echo 0
}
now() {
    date +%s
}

# ---- how many steps are HOURS? ----

# A twentieth of the time, at most 10 minutes, with a schedule that is that short.
probe=$(awk -v h="$hours" 'BEGIN { s = h * 180; print (s > 600 ? 600 : s < 20 ? 20 : s) }')
"$cln" train "$scene" -o "$out/probe" --time-limit "$probe" "${options[@]}" \
    >"$out/probe.log" 2>&1 ||
    { tail -n 3 "$out/probe.log" >&2; echo "soak: the first training failed"; exit 1; }
took=$(value "$out/probe/run.json" result.wall_seconds 2>/dev/null || echo "$probe")
steps=$(awk -v n="$(value "$out/probe/run.json" result.step)" -v s="$took" -v h="$hours" \
    'BEGIN { printf "%d", n / s * h * 3600 }')
echo "soak: $steps steps, about $hours hours with stops and as many without"

# ---- without stops ----

"$cln" train "$scene" -o "$out/whole" --steps "$steps" "${options[@]}" >"$out/whole.log" 2>&1 &
child=$!
: >"$out/whole.rss"
while kill -0 $child 2>/dev/null; do
    kib=$(resident $child)
    [ "$kib" = 0 ] || echo "$(now) $kib" >>"$out/whole.rss"
    sleep 1
done
wait $child ||
    { tail -n 3 "$out/whole.log" >&2; echo "soak: the run without stops failed"; exit 1; }
child=
awk -v growth="$growth" '
    { kib[NR] = $2 }
    END {
        for (i = int(NR / 4) + 1; i <= int(NR / 2); i++) if (kib[i] > early) early = kib[i]
        end = NR < 80 ? NR : NR - 10 # without what its end needs: a checkpoint, the last evaluation
        for (i = int(NR * 3 / 4) + 1; i <= end; i++) if (kib[i] > late) late = kib[i]
        printf "soak: without stops %d MiB in the second quarter, %d MiB in the last\n",
            early / 1024, late / 1024
        exit late > growth * early
    }' "$out/whole.rss" || found "the run without stops grew"

# ---- with stops ----

began=$(now) stops=0 status=0 before=-1 stuck=0
resume=(train "$scene" -o "$out/run" --steps "$steps" "${options[@]}")
: >"$out/stops"
while :; do
    env --default-signal=INT "$cln" "${resume[@]}" >"$out/run.log" 2>&1 &
    child=$!
    from=$(now) peak=0
    while kill -0 $child 2>/dev/null; do
        kib=$(resident $child)
        [ "$kib" -le "$peak" ] || peak=$kib
        if [ $(($(now) - from)) -ge "$every" ]; then
            kill -INT $child 2>/dev/null || true
            from=$(now)
        fi
        sleep 1
    done
    status=0
    wait $child || status=$?
    child=
    step=$(value "$out/run/run.json" result.step 2>/dev/null || echo 0)
    echo "$(($(now) - began)) $step $peak" >>"$out/stops"
    [ $status != 0 ] || break
    if [ $status != 130 ]; then
        tail -n 3 "$out/run.log" >&2
        found "a training ended with exit code $status at step $step"
        break
    fi
    stops=$((stops + 1)) stuck=$((stuck + 1))
    [ "$step" = "$before" ] || stuck=0
    before=$step
    if [ $stuck = 3 ]; then
        found "no step from stop to stop: EVERY is too short"
        break
    fi
    [ -e "$out/run/checkpoint/latest" ] || continue
    resume=(train --resume "$out/run" --skip-selftest --progress none -q)
done
echo "soak: $stops stops in $(($(now) - began)) s; $out/stops has their seconds, steps, peak KiB"
if [ $stops = 0 ]; then
    found "it was not stopped: give a smaller EVERY, or more HOURS"
elif ! awk -v growth="$growth" '
    { kib[NR] = $3 }
    END {
        for (i = int(NR / 4) + 1; i <= int((NR + 1) / 2); i++) if (kib[i] > early) early = kib[i]
        for (i = int(NR * 3 / 4) + 1; i <= NR; i++) if (kib[i] > late) late = kib[i]
        printf "soak: with stops, processes of up to %d MiB early, %d MiB late\n", early / 1024,
            late / 1024
        exit NR >= 8 && late > growth * early
    }' "$out/stops"; then
    found "processes grew from resume to resume"
fi
whole=$(digest "$out/whole") run=$(digest "$out/run")
[ "$whole" = "$run" ] || found "weights differ: $whole without stops, $run with"
rows=$(grep -vc '"event"' "$out/run/metrics.jsonl")
[ "$rows" = "$(grep -vc '"event"' "$out/whole/metrics.jsonl")" ] ||
    found "metrics.jsonl has $rows rows, not as many as without stops"
echo "soak: $steps steps, $stops stops, model $run: $faults faults"
[ $faults = 0 ]
