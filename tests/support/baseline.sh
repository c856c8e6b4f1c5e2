#!/bin/bash
# Support of cli.sh and training.sh: scenes that are made when a section first wants them, the run
# that others are compared with, and trainings beside the script. Source it after checks.sh, with
# $cln, $make_scene and $work set; at its end, a script calls end_children.
# shellcheck disable=SC2154
small=("${adapted[@]}")
steps=300
children="" child=0 whole=""

# wait_for SECONDS COMMAND...: until it succeeds, while the child runs
wait_for() {
    local end=$((SECONDS + $1))
    shift
    until "$@" 2>/dev/null; do
        [ $SECONDS -lt $end ] && kill -0 "$child" 2>/dev/null || return 1
        sleep 0.02
    done
}

rows_of() {
    [ "$(wc -l <"$1/metrics.jsonl")" -ge "$2" ]
}

# Starts a command in the background with the signals of a fresh shell.
start() {
    env --default-signal=INT,QUIT "$@" >"$work/out" 2>"$work/err" &
    child=$!
    children="$children $child"
}

end_children() {
    local one
    for one in $children; do kill -9 "$one" 2>/dev/null; done
}

finish() {
    wait "$child" 2>/dev/null
    rc=$?
}

scene() { # scene NAME OPTIONS...
    local name=$1
    shift
    [ -d "$work/$name" ] || "$make_scene" "$work/$name" "$@" >/dev/null || bad "make-scene $name"
}

blender() {
    scene blender --size 48 --train 12 --test 3 --depth
}

train() { # train RUN OPTIONS...
    local name=$1
    shift
    run "$cln" train "$work/blender" -o "$work/$name" "${small[@]}" --steps $steps "$@"
}

# The run that the others are compared with.
baseline() {
    blender
    if [ ! -d "$work/whole" ]; then
        train whole
        check "a run of $steps steps" [ $rc = 0 ]
        whole=$(digest "$work/whole")
        check "its digest is 16 hexadecimal digits" grep -qxE '[0-9a-f]{16}' <<<"$whole"
    fi
}
