#!/bin/bash
# Trainings from end to end, on tiny generated scenes: the same bits from the same seed, budgets,
# the tree's decisions, interruptions and what is resumed, damaged checkpoints, memory. Runs on any
# OpenCL device (PoCL is enough). tree.sh has the leaves, endings.sh what is said at the end.
#   tests/cli/training.sh [SECTION...]      sections: train structure regrow resume damage memory
#   BUILD=build/sanitize                    the programs to test
# Every check is one line of the count in the last line; the output of a failed one is shown.
set -u
cd "$(dirname "$0")/../.." || exit 1

# every path of every check has characters that shells and patterns take for something else
work=$(mktemp -d "${TMPDIR:-/tmp}/cln training [*] (+) XXXXXX")
. tests/support/checks.sh
. tests/support/baseline.sh
trap 'end_children; rm -rf "$work"' EXIT

# ---- checks of its own ----

# Bit for bit the baseline's model.
is_whole() {
    [ -n "$whole" ] && [ "$(digest "$1")" = "$whole" ]
}

is_another() {
    local d
    d=$(digest "$1")
    [ -n "$d" ] && [ "$d" != "$whole" ]
}

printed_another() {
    local d
    d=$(json model_digest)
    [ -n "$d" ] && [ "$d" != "$whole" ]
}

# Rows of the steps, and of the structure decisions, of a run.
step_rows() {
    grep -v '"event"' "$1/metrics.jsonl"
}

decision_rows() {
    grep '"event":"structure"' "$1/metrics.jsonl"
}

# stages_fit RUN SECONDS: the device's time, without that of evaluations, is at most SECONDS
stages_fit() {
    sed -n 's/.*"stages":{\([^}]*\)}.*/\1/p' "$1/metrics.jsonl" | tr ',' '\n' |
        awk -F: -v training="$2" '$1 ~ /evaluation/ { apart += $2; next } { sum += $2 }
            END { exit !(apart > 0 && sum > 0 && sum <= training) }'
}

every_step_once() {
    cmp -s <(step_rows "$1" | "$query" -l step) <(seq "$2")
}

# ---- sections ----

section_train() {
    local last psnr
    baseline
    check "train --json is not printed unasked" grep -q 'model digest' "$work/out"
    run "$cln" info "$work/whole" --json
    check "info RUN --json is one document" [ "$(json model_digest)" = "${whole:-none}" ]
    for f in run.json metrics.jsonl report.html checkpoint/latest \
        checkpoint/00000300.safetensors; do
        check "a run leaves $f" [ -s "$work/whole/$f" ]
    done
    check "metrics.jsonl has every step once" every_step_once "$work/whole" $steps
    check "its losses are numbers" [ \
        "$(step_rows "$work/whole" | "$query" -l loss | grep -cE '^[0-9.e+-]+$')" = $steps ]
    check "training makes the loss smaller" eval 'step_rows "$work/whole" | "$query" -l loss |
        awk "NR <= 20 { a += \$1 } { last[NR % 20] = \$1 }
            END { for (i in last) b += last[i]; exit !(b < 0.7 * a) }"'
    check "run.json says done" [ "$("$query" state <"$work/whole/run.json")" = "done" ]

    train twin --json
    check "train --json is one document" [ "$(json state)" = "done" ]
    check "train --json tells the digest" [ "$(json model_digest)" = "${whole:-none}" ]
    check "same seed, same bits" is_whole "$work/twin"
    train other --seed 7
    check "another seed, other bits" is_another "$work/other"
    run "$cln" train "$work/blender" -o "$work/told" "${small[@]}" --steps 2 -v
    check "train -v says what was left out" grep -q '^left out: .*; ' "$work/err"
    run env POCL_MAX_PTHREAD_COUNT=1 "$cln" train "$work/blender" -o "$work/thread" "${small[@]}" \
        --steps $steps
    check "one thread, same bits" is_whole "$work/thread"

    run "$cln" train "$work/blender" -o "$work/usual" --skip-selftest --progress none --rays 512 \
        --steps 8 --json
    check "train without options" [ $rc = 0 ]
    check "by default there are voxels" \
        [ "$("$query" config.encoding <"$work/usual/run.json")" = voxel ]
    expect "--encoding grid at voxels' rates" 2 "--encoding ~--preset.fast" "$cln" train \
        "$work/blender" -o "$work/never" --encoding grid

    psnr=$("$query" result.psnr_test <"$work/whole/run.json")
    train gpu-shaped --json --tune \
        VW=1,NV=1,LS=16,TS=8,NB=16,SL=128,WG=64,SG=256,DB=8,CHUNK=2048,LEAF=0
    check "with a GPU's parameters the training is as good" eval \
        'number_above "$(json psnr_test)" "$(awk -v p="$psnr" "BEGIN { print p - 0.5 }")"'

    run "$cln" train "$work/blender" -o "$work/timed" "${small[@]}" --time-limit 2s --json
    check "--time-limit ends the training" [ $rc = 0 ]
    check "--time-limit ends it after its seconds" eval \
        'number_above "$(json seconds)" 1.9 && number_above 10 "$(json seconds)"'
    last=$(json step)
    expect "--epochs +1 of a run whose budget was time" 0 "" "$cln" train --resume "$work/timed" \
        --skip-selftest --progress none --epochs +1 --json
    # an epoch has 48 x 48 x 12 / 10 rays, 10.8 steps; those begun count as whole
    check "it goes on from where the run ended" \
        [ "$(json step)" -gt $((last + 10)) -a "$(json step)" -le $((last + 23)) ]
    run "$cln" train "$work/blender" -o "$work/target" "${small[@]}" --steps 100000 --eval-every 5 \
        --target-psnr 14 --json
    check "--target-psnr ends the training" eval '[ $rc = 0 ] && number_above 1000 "$(json step)" &&
        number_above "$(json psnr_test)" 14 && number_above "$(json step)" 5'

    # pictures that take far longer than the steps between them
    scene fine --size 128 --train 4 --test 3
    run "$cln" train "$work/fine" -o "$work/evaluated" "${small[@]}" --steps 20 \
        --eval-every 1 --json
    check "evaluations count apart: all other stages sum to at most the training's seconds" \
        stages_fit "$work/evaluated" "$(json seconds)"

    # the best constant pictures of these scenes reach 15.1, 10.4 and 10.3 dB
    scene room --kind room --size 40 --train 10 --test 2
    run "$cln" train "$work/room" -o "$work/inside" "${small[@]}" --steps 60 --json
    check "cameras inside the cube" eval '[ $rc = 0 ] && number_above "$(json psnr_train)" 16'
    scene bent --format nerfstudio --distortion=-0.1,0.02,0.001,-0.001 --size 40 --train 10 --test 2
    run "$cln" train "$work/bent" -o "$work/curved" "${small[@]}" --steps 60 --json
    check "distorted images" eval '[ $rc = 0 ] && number_above "$(json psnr_train)" 12'
    run "$cln" train "$work/blender" -o "$work/splat" "${small[@]}" --steps 60 --stage1 splat --json
    check "--stage1 splat" eval '[ $rc = 0 ] && number_above "$(json psnr_train)" 12'
}

# The adaptive tree on the demo object: what a decision costs in PSNR, its program against a MIP
# solver, and what the tree looks like from outside.
section_structure() {
    local r=$work/grown lp=$work/last.lp
    scene demo --size 80 --train 24 --test 3
    run "$cln" train "$work/demo" -o "$r" --skip-selftest --progress none --preset fast \
        --width 16 --view-width 16 --steps 1000 --start-level 2 --level-at 3:0.2 --n1 8 --rays 512 \
        --refresh-every 64 --log-every 100 --cull-from 0.1 --cull-after 0 --cull-strikes 2 \
        --max-leaves 150 --structure-from 0.4 --structure-every 0.1 --structure-until 0.95 \
        --split-samples 100 --cost-density 1 --merge-factor 1.1 --dump-program "$lp" -v
    check "train with an adaptive tree" [ $rc = 0 ]
    cp "$work/err" "$work/grown.log"
    check "six decisions are rows" [ "$(decision_rows "$r" | wc -l)" = 6 ]
    check "six decisions are in the log" [ "$(grep -c 'objective' "$work/grown.log")" = 6 ]
    decision_rows "$r" | "$query" -l psnr_before >"$work/before"
    decision_rows "$r" | "$query" -l psnr_after >"$work/after"
    decision_rows "$r" | "$query" -l psnr_pretrained >"$work/pretrained"
    decision_rows "$r" | "$query" -l merged >"$work/merged"
    decision_rows "$r" | "$query" -l split >"$work/split"
    paste "$work/before" "$work/after" "$work/pretrained" "$work/merged" "$work/split" >"$work/out"
    check "there were splits and merges" awk '{ m += $4; s += $5 } END { exit !(m > 0 && s > 0) }' \
        "$work/out"
    check "a merge costs less than 0.25 dB once trained" awk \
        '$4 > 0 { some = 1; if ($1 - $3 >= 0.25 * $4) bad = 1 } END { exit bad || !some }' \
        "$work/out"
    decision_rows "$r" | "$query" -l leaves >"$work/leaves"
    check "leaves stay in the budget" awk '$1 > 150 { bad = 1 } END { exit bad }' "$work/leaves"
    if command -v glpsol >/dev/null; then
        run glpsol --lp "$lp" --output "$work/solution"
        check "a MIP solver finds the same optimum" awk \
            -v want="$(decision_rows "$r" | tail -1 | "$query" objective)" \
            '/^Objective:/ { found = 1; d = $4 - want }
            END { exit !(found && d * d <= 1e-10 * want * want) }' \
            "$work/solution"
    else
        skip "a MIP solver finds the same optimum" "no glpsol"
    fi

    # merging costs much, and there is room: leaves are only split
    run "$cln" train "$work/demo" -o "$work/splits" --skip-selftest --progress none \
        --preset fast --width 16 --view-width 16 --steps 200 --start-level 1 --level-at 2:0.1 \
        --n1 8 --rays 512 \
        --log-every 100 --cull-from 1 --cull-after 0 --max-leaves 150 --structure-from 0.6 \
        --structure-every 0.5 --structure-until 0.95 --split-samples 100 --merge-factor 100
    decision_rows "$work/splits" >"$work/out"
    check "a decision only splits" eval \
        'number_above "$(json split)" 5 && [ "$(json merged)" = 0 ]'
    check "splits cost less than 0.05 dB" number_above \
        "$(json psnr_after)" "$(awk -v p="$(json psnr_before)" 'BEGIN { print p - 0.05 }')"
}

# A tree that is culled down to one leaf after half of its steps, just before it grows: what is
# missing comes back, unless that is switched off; and a resumed run decides alike.
section_regrow() {
    local share culled=(--skip-selftest --progress none --preset fast --steps 320
        --level-at 3:0.515 --cull mean
        --cull-mean 6 --cull-from 0.05 --cull-after 160 --refresh-every 16 --no-adaptive --rays 512
        --batch-samples 8192 -v)
    scene missing --size 48 --train 20 --test 3
    for share in 0 0.7 1; do # 1: places where all photos have errors, and surfaces that are cut off
        run "$cln" train "$work/missing" -o "$work/regrow$share" "${culled[@]}" --regrow $share
        check "nearly all leaves are culled (--regrow $share)" grep -q "culled 6[0-9] of 64" \
            "$work/err"
        cp "$work/err" "$work/regrow$share.log"
    done
    check "what is missing is found" grep -q "something is missing: [1-9]" "$work/regrow0.7.log"
    check "nothing is looked for without --regrow" eval '! grep -q missing: "$work/regrow0.log"'
    check "surfaces that end at a leaf's face go on" grep -q \
        "missing: [1-9].* [1-9][0-9]* by surfaces that are cut off" "$work/regrow1.log"
    check "what was missing is learnt again" number_above \
        "$("$query" result.psnr_test <"$work/regrow0.7/run.json")" \
        "$("$query" result.psnr_test <"$work/regrow0/run.json" | awk '{ print $1 + 4 }')"
    run "$cln" train "$work/missing" -o "$work/regrow-slab" "${culled[@]}" --cull-from 1 --slab \
        --bbox=-1.2,-1.2,-1.2,1.2,1.2,0
    check "the upper half is missing, and stays out" eval '
        grep -q "something is missing" "$work/err" &&
        [ "$(grep -c "outside the box" "$work/err")" = 2 ]' # at the start, and when the tree grows
    start "$cln" train "$work/missing" -o "$work/regrow-half" "${culled[@]}" --log-every 1
    wait_for 60 rows_of "$work/regrow-half" 100
    kill -INT "$child" 2>/dev/null
    finish
    run "$cln" train --resume "$work/regrow-half" --skip-selftest --progress none
    check "a resumed run finds the same" \
        eval '[ $rc = 0 ] && same_model "$work/regrow-half" "$work/regrow0.7"'
}

section_resume() {
    local r=$work/stopped key
    baseline
    start "$cln" train "$work/blender" -o "$r" "${small[@]}" --steps $steps
    wait_for 60 rows_of "$r" 30
    run "$cln" train --resume "$r" --skip-selftest --progress none
    check "a second process on a run: exit code 7" [ $rc = 7 ]
    check "a second process on a run: the first is named" grep -q "process $child on" "$work/err"
    kill -INT "$child"
    finish
    check "SIGINT: exit code 130" [ $rc = 130 ]
    check "SIGINT: a checkpoint is there" [ -s "$r/checkpoint/latest" ]
    check "SIGINT: run.json says interrupted" [ "$("$query" state <"$r/run.json")" = interrupted ]
    check "SIGINT: no test PSNR, so no views of it" eval '
        [ "$("$query" result.psnr_test <"$r/run.json") $("$query" result.eval_views \
            <"$r/run.json")" = "null 0" ]'
    check "SIGINT: the training stopped early" is_another "$r"
    expect "resume" 0 "" "$cln" train --resume "$r" --skip-selftest --progress none
    check "interrupted and resumed = not interrupted" is_whole "$r"
    check "the resumed metrics have every step once" every_step_once "$r" $steps
    check "they tell the two processes apart" \
        [ "$(step_rows "$r" | "$query" -l from_step | sort -u | wc -l)" = 2 ]

    r=$work/terminated
    expect "rows of seven steps" 0 "" "$cln" train "$work/blender" -o "$work/sevens" \
        "${small[@]}" --steps $steps --log-every 7
    start "$cln" train "$work/blender" -o "$r" "${small[@]}" --steps $steps --log-every 7
    wait_for 60 rows_of "$r" 8
    kill -TERM "$child"
    finish
    check "SIGTERM: exit code 143" [ $rc = 143 ]
    check "its last row is of where it stopped" [ "$(step_rows "$r" | tail -1 | "$query" step)" = \
        "$("$query" result.step <"$r/run.json")" ]
    check "and so is its PSNR" [ "$(step_rows "$r" | tail -1 | "$query" psnr_train)" = \
        "$("$query" result.psnr_train <"$r/run.json")" ]
    key=$("$query" result.step <"$r/run.json")
    cp -r "$r" "$work/no-more"
    expect "resume without a step that is left" 0 "" "$cln" train --resume "$work/no-more" \
        --skip-selftest --progress none --steps "$key"
    check "its rows are those of the stop" [ "$(step_rows "$r" | "$query" -l psnr_train)" = \
        "$(step_rows "$work/no-more" | "$query" -l psnr_train)" ]
    check "and so is its PSNR" [ "$("$query" result.psnr_train <"$r/run.json")" = \
        "$("$query" result.psnr_train <"$work/no-more/run.json")" ]
    check "its evaluation is in the last row" [ \
        "$(step_rows "$work/no-more" | tail -1 | "$query" psnr_test)" = \
        "$("$query" result.psnr_test <"$work/no-more/run.json")" ]
    expect "resume" 0 "" "$cln" train --resume "$r" --skip-selftest --progress none
    check "terminated and resumed = not interrupted" is_whole "$r"
    for key in loss psnr_train samples_per_ray; do
        check "a row that the end cut in two is of all its steps: $key" [ \
            "$(step_rows "$r" | "$query" -l $key)" = \
            "$(step_rows "$work/sevens" | "$query" -l $key)" ]
    done
    check "rows have it" [ "$(step_rows "$r" | "$query" -l loss | wc -l)" -gt 20 ]

    r=$work/killed
    start "$cln" train "$work/blender" -o "$r" "${small[@]}" --steps $steps
    wait_for 60 rows_of "$r" 20
    kill -USR1 "$child"
    check "SIGUSR1 writes a checkpoint" wait_for 60 [ -s "$r/checkpoint/latest" ]
    kill -9 "$child"
    finish
    check "kill -9 ended the training" [ $rc = 137 ]
    expect "resume after kill -9" 0 "" "$cln" train --resume "$r" --skip-selftest --progress none
    check "killed and resumed = not interrupted" is_whole "$r"

    scene photos --format nerfstudio --size 48 --train 12 --test 3
    expect "--exposure" 0 "" "$cln" train "$work/photos" -o "$work/exposed" "${small[@]}" \
        --steps $steps --exposure
    run "$cln" eval "$work/exposed" --no-save-images --json
    check "eval: PSNR at guessed exposures" \
        number_above "$("$query" mean.psnr_exposed <"$work/out")" 10.7 # a constant: 10.3
    run "$cln" eval "$work/exposed" --no-save-images
    check "all images are fitted" grep -q "its photo: [0-9.]*$" "$work/out"
    cp -r "$work/photos" "$work/plain"
    base64 -d >"$work/plain/images/frame_00014.png" <<<"iVBORw0KGgoAAAANSUhEUgAAADAAAAAwCAIAAADY\
YG7QAAAAOUlEQVR42u3OAQ0AAAgDIDXm+wexhnOQgE5Sl0wdIyQkJCQkJCQkJCQkJCQkJCQkJCQkJCQk\
JPQ5tOCjAW6cvKTxAAAAAElFTkSuQmCC"
    run "$cln" eval "$work/exposed" --no-save-images --scene "$work/plain" \
        -o "$work/of plain"
    check "one of one colour is not" \
        grep -q "its photo: [0-9.]*, of 2 of 3 images$" "$work/out"
    run "$cln" eval "$work/exposed" --no-save-images --split train --json
    check "eval: training photos at their own gains" awk -v a="$("$query" mean.psnr_exposed \
        <"$work/out")" -v b="$("$query" mean.psnr <"$work/out")" \
        'BEGIN { exit !(a > b) }'
    r=$work/exposed-stopped
    start "$cln" train "$work/photos" -o "$r" "${small[@]}" --steps $steps --exposure
    wait_for 60 rows_of "$r" 100 # after gains have changed
    kill -INT "$child"
    finish
    check "SIGINT with --exposure: exit code 130" [ $rc = 130 ]
    expect "resume with gains" 0 "" "$cln" train --resume "$r" --skip-selftest --progress none
    check "gains resume to the same bits" same_model "$r" "$work/exposed"

    scene cloudy --kind room --format nerfstudio --fault clouds --size 48 --train 24 --test 3
    expect "photos under passing clouds" 0 "~as.those.before.and.after" "$cln" train \
        "$work/cloudy" -o "$work/clouds" "${small[@]}" --steps $steps
    r=$work/clouds-stopped
    start "$cln" train "$work/cloudy" -o "$r" "${small[@]}" --steps $steps
    wait_for 60 rows_of "$r" 30 # gains are measured
    kill -INT "$child"
    finish
    run "$cln" train --resume "$r" --skip-selftest --progress none
    check "gains that are measured resume to the same bits" same_model "$r" "$work/clouds"
    run "$cln" train "$work/cloudy" -o "$work/cloudless" "${small[@]}" --steps $steps --no-exposure
    check "gains bring photos under clouds together" \
        number_above "$("$query" result.psnr_train <"$work/clouds/run.json")" \
        "$("$query" result.psnr_train <"$work/cloudless/run.json")"

    scene shaken --fault shaken --size 48 --train 12 --test 3
    expect "--refine-poses" 0 "" "$cln" train "$work/shaken" -o "$work/refined" "${small[@]}" \
        --steps $steps --refine-poses
    r=$work/refined-stopped
    start "$cln" train "$work/shaken" -o "$r" "${small[@]}" --steps $steps --refine-poses
    wait_for 60 rows_of "$r" 150 # after poses have changed
    kill -INT "$child"
    finish
    check "SIGINT with --refine-poses: exit code 130" [ $rc = 130 ]
    expect "resume with poses" 0 "" "$cln" train --resume "$r" --skip-selftest --progress none
    check "poses resume to the same bits" same_model "$r" "$work/refined"
    for run in refined refined-stopped; do
        expect "export --cameras of $run" 0 "" "$cln" export "$work/$run" --cameras \
            "$work/$run.json"
        check "$run: its poses are corrected" grep -q "poses that training corrected" "$work/out"
    done
    check "both export the same cameras" cmp -s "$work/refined.json" "$work/refined-stopped.json"
    check "both keep the given ones" cmp -s "$work/refined/cameras.json" \
        "$work/refined-stopped/cameras.json"
    mv "$work/shaken" "$work/hidden"
    expect "export of the corrected ones without the scene" 0 "~without.photos" \
        "$cln" export "$work/refined" --cameras "$work/refined-alone.json"
    check "they are the same" cmp -s "$work/refined.json" "$work/refined-alone.json"
    mv "$work/hidden" "$work/shaken"
    expect "train without --refine-poses" 0 "" "$cln" train "$work/shaken" -o "$work/unrefined" \
        "${small[@]}" --steps 2
    expect "export of given poses" 0 "" "$cln" export "$work/unrefined" --cameras "$work/given.json"
    check "given poses are not called corrected" eval '! grep -q corrected "$work/out"'
    check "training cameras have moved" [ "$("$query" frames.0.transform_matrix.0.3 \
        <"$work/refined.json")" != "$("$query" frames.0.transform_matrix.0.3 \
        <"$work/given.json")" ]
    check "test cameras have not" [ "$("$query" frames.14.transform_matrix.0.3 \
        <"$work/refined.json")" = "$("$query" frames.14.transform_matrix.0.3 \
        <"$work/given.json")" ]

    cp -r "$work/whole" "$work/longer"
    expect "resume with +N steps" 0 "" "$cln" train --resume "$work/longer" --skip-selftest \
        --progress none --steps +20 --json
    check "it trains to the sum of steps" [ "$(json step)" = $((steps + 20)) ]
    expect "resume of what is not a run" 3 "blender" "$cln" train --resume "$work/blender" \
        --skip-selftest
    expect "resume with another network" 8 "~width|network" \
        "$cln" train --resume "$work/longer" --skip-selftest --width 32 --view-width 32
    expect "resume with other moments" 8 "another --moments -o --settings-of" \
        "$cln" train --resume "$work/longer" --skip-selftest --moments float32
}

newest() {
    find "$1/checkpoint" -name '*.safetensors' | sort | tail -1
}

section_damage() {
    local r=$work/damaged file size
    baseline
    # two checkpoints: one by SIGUSR1 on the way, one at the end
    start "$cln" train "$work/blender" -o "$r" "${small[@]}" --steps $steps
    wait_for 60 rows_of "$r" 30
    kill -USR1 "$child"
    finish
    check "SIGUSR1: the training runs to its end" [ $rc = 0 ]
    check "two checkpoints" [ "$(find "$r/checkpoint" -name '*.safetensors' | wc -l)" = 2 ]
    check "a checkpoint on the way changes nothing" is_whole "$r"

    cp -r "$r" "$work/cut"
    file=$(newest "$work/cut")
    size=$(stat -c %s "$file")
    truncate -s $((size / 2)) "$file"
    expect "truncated newest checkpoint: a warning, the one before" 0 "$(basename "$file")" \
        "$cln" info "$work/cut" --json
    check "the older checkpoint's digest is printed" printed_another
    expect "train from the older one" 0 "" "$cln" train --resume "$work/cut" --skip-selftest \
        --progress none
    check "the training from the older one ends with the same bits" is_whole "$work/cut"

    cp -r "$r" "$work/flipped"
    file=$(newest "$work/flipped")
    printf '\x55\xaa\x55\xaa' | dd of="$file" bs=1 seek=$((size * 3 / 4)) conv=notrunc 2>/dev/null
    expect "four bytes changed: noticed" 0 "$(basename "$file")" "$cln" eval "$work/flipped" --json
    check "the changed checkpoint is not used" printed_another

    for file in "$work/flipped/checkpoint/"*.safetensors; do truncate -s 100 "$file"; done
    expect "all checkpoints damaged: eval" 8 "checkpoint" "$cln" eval "$work/flipped"
    expect "all checkpoints damaged: resume" 8 "checkpoint" \
        "$cln" train --resume "$work/flipped" --skip-selftest --progress none
}

section_memory() {
    local r limit limited psnr whole_peak frames i
    blender
    expect "too little device memory: the plan is printed" 5 \
        "device-mem ~[0-9](\.[0-9])?.?(MiB|KiB|GiB)" \
        "$cln" train "$work/blender" -o "$work/never" --skip-selftest --steps 1 --device-mem 1M
    check "too little device memory: nothing is written" [ ! -e "$work/never" ]
    expect "too little host memory to read an image" 5 "--host-mem ~smaller.copies" \
        "$cln" train "$work/blender" -o "$work/never" --skip-selftest --steps 1 --host-mem 20K
    expect "too little host memory for the rest: the plan is printed" 5 "--host-mem ~images.[0-9]" \
        "$cln" train "$work/blender" -o "$work/never" --steps 1 --host-mem 200M
    check "before the kernels are checked" not_said "checking the kernels"
    expect "four parts are too small, by name" 5 "weights ~iB.in.each.of.4.parts" \
        "$cln" train "$work/blender" -o "$work/never" --skip-selftest --steps 1 --max-alloc 64K
    check "too little memory: nothing is written" [ ! -e "$work/never" ]

    # the plan comes before the first buffer; both peaks are reported
    run "$cln" train "$work/blender" -o "$work/planned" "${small[@]}" --steps 20 --no-adaptive \
        --level-at "" -v
    check "the plan is said before anything is allocated" awk '/memory plan:/ { planned = NR }
        /buffer for/ && !first { first = NR }
        END { exit !(planned && first > planned) }' "$work/err"
    check "the plan of host memory, too" grep -q "host memory, estimated: .*images" "$work/err"
    check "peaks are printed at the end" grep -qE \
        "^peak memory +[0-9.]+ [KMG]iB device, [0-9.]+ [KMG]iB host" "$work/out"
    r=$work/planned/run.json
    check "the peak is below the plan" number_above "$("$query" plan.total <"$r")" \
        "$("$query" result.device_peak <"$r")"
    limit=$("$query" host_plan.total <"$r")
    check "host memory is below its plan" number_above "$limit" "$("$query" result.host_peak <"$r")"
    run "$cln" train "$work/blender" -o "$work/hosted" "${small[@]}" --steps 20 --no-adaptive \
        --level-at "" --host-mem "$limit" --json
    check "a training that keeps to --host-mem" [ "$(json state)" = "done" ]
    check "its peak is below --host-mem" number_above "$limit" "$(json host_peak)"

    # 61 photos of 4 MiB do not fit: they lie in a file, and training draws the same pixels
    "$make_scene" "$work/large" --size 1024 --train 1 --test 1 >/dev/null
    "$make_scene" "$work/little" --size 64 --train 1 --test 1 >/dev/null
    mv "$work/little/test/r_000.png" "$work/large/test/r_000.png" # drawn in no time
    frames=
    for i in {11..70}; do
        ln "$work/large/train/r_000.png" "$work/large/train/$i.png"
        frames+=",{\"file_path\":\"./train/$i\",\"transform_matrix\":[[1,0,0,0.$i],[0,1,0,0],"
        frames+="[0,0,1,4],[0,0,0,1]]}"
    done
    printf '{"camera_angle_x":0.7,"frames":[%s]}' "${frames#,}" >"$work/large/transforms_train.json"
    run "$cln" train "$work/large" -o "$work/in-memory" "${small[@]}" --steps 20 \
        --no-adaptive --json
    whole_peak=$(json host_peak)
    run "$cln" train "$work/large" -o "$work/stored" "${small[@]}" --steps 20 --no-adaptive \
        --host-mem 480M --json
    check "what does not fit goes to a file" grep -q "their pixels go to a file" "$work/err"
    check "memory is less by most of the photos" number_above "$whole_peak" \
        "$(awk -v p="$(json host_peak)" 'BEGIN { printf "%.0f", p + 150 * 1048576 }')"
    check "the training keeps to --host-mem" number_above 503316480 "$(json host_peak)"
    check "the model is the same" same_model "$work/stored" "$work/in-memory"
    check "the evaluation's pictures and photos are the same" diff -r \
        "$work/in-memory/eval/00000020-test" "$work/stored/eval/00000020-test"
    check "the report has the photos" grep -q 'alt="truth of test/r_000"' "$work/stored/report.html"
    # above twice the photos, below the total need: photos go to the file, without refusal
    limit=$("$query" host_plan.total <"$work/in-memory/run.json")
    limit=$((${limit%.*} - 52428800))
    run "$cln" train "$work/large" -o "$work/between" "${small[@]}" --steps 20 --no-adaptive \
        --host-mem "$limit" --json
    check "photos beyond the rest go to a file" said "~all else.*, most of .*pixels go to a file"
    check "both models are equal" same_model "$work/between" "$work/in-memory"
    check "that training keeps to --host-mem" number_above "$limit" "$(json host_peak)"
    rm -r "$work/large" "$work/in-memory" "$work/stored" "$work/between"

    # a limit with room for level 1 and a half: both kinds of growth stay below it
    limit=$(awk -v a="$("$query" plan.total <"$r")" 'BEGIN { printf "%.0f", a + 60000 }')
    run "$cln" train "$work/blender" -o "$work/level" "${small[@]}" --steps 60 --no-adaptive \
        --device-mem "$limit" --json
    check "growth by level stops at the limit" \
        [ "$(json state)" = "done" -a "$(json leaves)" -le 8 ]
    check "growth that stops at the limit warns" grep -q "the tree stays at level 1" "$work/err"
    check "run.json notes it" [ "$("$query" held_back.leaves <"$work/level/run.json")" = 8 ]
    run "$cln" info "$work/level" "$work/level"
    check "so does info of two runs" \
        grep -q "level: memory held its tree back from step" "$work/out"
    check "the peak is below the limit" number_above "$limit" "$(json device_peak)"
    run "$cln" train "$work/blender" -o "$work/few" "${small[@]}" --steps 1 --level-at ""
    limit=$(awk -v a="$("$query" plan.total <"$work/few/run.json")" \
        'BEGIN { printf "%.0f", a + 1e6 }')
    run "$cln" train "$work/blender" -o "$work/more" "${small[@]}" --steps 60 --level-at "" \
        --cull-from 1 --device-mem "$limit" --max-leaves 4000 --json
    check "the integer program trains on" [ "$(json state)" = "done" ]
    check "its peak is below the limit" number_above "$limit" "$(json device_peak)"
    check "run.json notes that, too" "$query" held_back.step <"$work/more/run.json"
    check "its budget of leaves is smaller" eval \
        'decision_rows "$work/more" | "$query" -l budget | awk "\$1 >= 4000 { bad = 1 }
            END { exit bad || !NR }"'

    # batches cut by a small largest buffer: as good, and pictures the same
    train buffers --no-adaptive --leaf-samples 0 --json
    psnr=$(json psnr_test)
    expect "the self-test is of the device, not of --max-alloc" 0 "" "$cln" train "$work/blender" \
        -o "$work/checked" --steps 1 --max-alloc 1M --progress none
    train small-buffers --no-adaptive --leaf-samples 0 --json --max-alloc 1M
    check "--max-alloc cuts the batches" grep -q "batches are cut to" "$work/err"
    check "cut batches train as well" number_above "$(json psnr_test)" \
        "$(awk -v p="$psnr" 'BEGIN { print p - 1 }')"
    check "cut batches take less memory" number_above \
        "$("$query" result.device_peak <"$work/buffers/run.json")" "$(json device_peak)"
    run "$cln" eval "$work/buffers" --json --progress none
    cp "$work/out" "$work/whole.json"
    run "$cln" eval "$work/buffers" --json --progress none --max-alloc 512K
    check "pictures in smaller batches are the same" [ "$(json mean.psnr)" = \
        "$("$query" mean.psnr <"$work/whole.json")" ]

    # by that limit batches depend on the leaves, and on whether these were in parts: a resumed run
    # has the same, and keeps the limit without being asked to
    limited=(--skip-selftest --progress none --eval-images 1 --start-level 2 --cull-after 16
        --refresh-every 16 --level-at "3:0.1,4:0.9" --structure-from 0.5 --steps 100 --no-adaptive
        --max-alloc 5M --log-every 1)
    "$make_scene" "$work/limited" --size 64 --train 20 --test 2 >/dev/null
    run "$cln" train "$work/limited" -o "$work/limited-whole" "${limited[@]}" --json
    start "$cln" train "$work/limited" -o "$work/limited-stopped" "${limited[@]}"
    wait_for 60 rows_of "$work/limited-stopped" 70
    kill -INT "$child" 2>/dev/null
    finish
    check "it stopped on the way" [ $rc = 130 ]
    run "$cln" train --resume "$work/limited-stopped" --skip-selftest --progress none
    check "--max-alloc is the run's" \
        grep -q "the largest buffer has 5.0 MiB, as in the run before" "$work/err"
    check "interrupted and resumed with limited batches = not interrupted" \
        same_model "$work/limited-stopped" "$work/limited-whole"

    # 512 leaves, whose arrays do not fit one buffer; eval, without the limit, has them in one
    run "$cln" train "$work/blender" -o "$work/parts" "${small[@]}" --start-level 3 --level-at "" \
        --no-adaptive --steps 2 --max-alloc 1M -v
    check "the plan says what is split" grep -qE \
        "memory plan: leaf weights [0-9.]+ MiB in 3 parts, optimiser state [0-9.]+ MiB in 3" \
        "$work/err"
    run "$cln" eval "$work/parts" --json --progress none
    cp "$work/out" "$work/whole.json"
    run "$cln" eval "$work/parts" --json --progress none --max-alloc 1M -v
    check "pictures from parts: the plan" grep -qE \
        "memory plan: leaf weights [0-9.]+ MiB in 3 parts" "$work/err"
    check "pictures agree" [ "$(json mean.psnr)" = "$("$query" mean.psnr <"$work/whole.json")" ]
}

run_sections "train structure regrow resume damage memory" "$@"
