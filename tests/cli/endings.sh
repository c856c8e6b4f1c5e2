#!/bin/bash
# How trainings end, and what is then said of them: killed ones, ones too short for their tree, ones
# that learnt little, ones that are finished and started again, and those that do not fit
# the disk or memory.
#   tests/cli/endings.sh [SECTION...]      sections are in the last line
#   BUILD=build/sanitize                   the programs to test
set -u
cd "$(dirname "$0")/../.." || exit 1

work=$(mktemp -d "${TMPDIR:-/tmp}/cln-endings-XXXXXX")
trap 'rm -rf "$work"' EXIT

. tests/support/checks.sh

# printed TEXT: TEXT is on the last stdout, literally
# The scene of most sections.
scene() {
    [ -e "$work/scene" ] || "$make_scene" "$work/scene" --size 32 --train 8 --test 2 >/dev/null
}

# ---- sections ----

# A process that ended without a word leaves "running" in run.json, and a lock that nobody holds.
section_killed() {
    local i
    scene
    "$cln" train "$work/scene" -o "$work/killed" "${tiny[@]}" --steps 1000000 --save-every 1 \
        >/dev/null 2>&1 &
    for ((i = 0; i < 600; i++)); do
        [ -e "$work/killed/checkpoint/latest" ] && break
        sleep 0.1
    done
    expect "info while it trains" 0 "" "$cln" info "$work/killed" --json
    check "it is running" [ "$(json state)" = running ]
    check "nothing is said of a broken end" not_said "--resume"
    kill -KILL $!
    wait $! 2>/dev/null
    expect "info of a killed run: the way on" 0 "~without.a.word train --resume ~from.step.[0-9]" \
        "$cln" info "$work/killed"
    check "its state is not running" grep -q "^state *broken off" "$work/out"
    run "$cln" bugreport "$work/killed"
    check "bugreport has the same state" printed '"broken off"'
    rm "$work/killed/checkpoint/latest" # which programs do not need
    expect "info without latest" 0 "" "$cln" info "$work/killed" --json
    check "it has the checkpoint all the same" number_above "$(json leaves)" 0
    cp -r "$work/killed" "$work/placed"
    sed 's/"because": "/&metres from here, latitude -48.75, longitude 16.2, height 360.1, by GPS/' \
        "$work/killed/run.json" >"$work/placed/run.json"
    expect "info tells the place on the earth" 0 "" "$cln" info "$work/placed" --json
    check "it does" printed "latitude -48.75"
    expect "bugreport does not" 0 "" "$cln" bugreport "$work/placed" --no-test
    check "but how the scene was read" eval 'printed "metres from here, by GPS" && ! printed 16.2'
    expect "nor does a copy" 0 "" "$cln" export "$work/placed" --copy "$work/placed copy"
    check "in its run.json" eval 'grep -q "metres from here, by GPS" "$work/placed copy/run.json" &&
        ! grep -q "latitude\|360\.1" "$work/placed copy/run.json"'
    expect "eval of a killed run" 0 "" "$cln" eval "$work/killed" --no-save-images
    check "its report has the state" grep -q "state other'>broken off<" "$work/killed/report.html"
    check "and the way on" grep -q "cl-nascent train --resume $work/killed</code> goes on" \
        "$work/killed/report.html"
    "$cln" train --resume "$work/killed" --skip-selftest --progress none --steps 1 >/dev/null 2>&1
    expect "resumed to its end, it is done" 0 "" "$cln" info "$work/killed" --json
    check "its state" [ "$(json state)" = "done" ]
}

# advice PATTERN: what the last stderr proposes
advice() {
    grep -oE -- "$1" "$work/err" | head -1
}

decisions() {
    grep -c '"event":"structure"' "$1/metrics.jsonl"
}

# Too few steps for single leaves: what is proposed works.
section_short() {
    local -a grows=("$work/scene" --preset voxel --rays 128 --leaf-samples 0 --skip-selftest
        --progress none --cell-pixels 0 --cull-after 16 --refresh-every 16)
    local -a coarse=(--cell-pixels 1 --start-level 1 --level-at "2:0.01,3:0.03")
    local longer
    scene
    expect "a training too short for its tree" 0 "~warning:.no.single.leaf" \
        "$cln" train -o "$work/short" "${grows[@]}" --steps 120
    longer=$(advice "--steps [0-9]+ or more" | tr -dc 0-9)
    check "another number of steps is named" [ "${longer:-0}" -gt 120 ]
    expect "so many steps are enough" 0 "" \
        "$cln" train -o "$work/longer" "${grows[@]}" --steps "$longer"
    check "nothing is said" not_said "no single leaf was split"
    check "the tree adapted" [ "$(decisions "$work/longer")" -gt 0 ]
    expect "a try of a few steps" 0 "~single.leaf" \
        "$cln" train -o "$work/try" "${grows[@]}" --steps 20
    check "is not warned" not_said "warning: no single leaf"
    expect "fewer leaves than the first tree has" 0 \
        "~warning:.the.first.tree.has.64.leaves ~or.a.lower.--start-level.than.2" \
        "$cln" train -o "$work/less" "${grows[@]}" --steps 20 --max-leaves 10 --start-level 2
    check "and no advice to split them" not_said "no single leaf"
    expect "photos that tell no finer voxels" 0 "~nor.would.any.be.in.more.steps:.*cell-pixels.1" \
        "$cln" train -o "$work/coarse" "${grows[@]}" "${coarse[@]}" --steps 60 --antialias 1
    check "nor is that hoped of single leaves" said "level 1, and single leaves cannot split"
    check "no number of steps is advised" not_said "or more"
    expect "nor before pixels are means of rays" 0 "~level.1.for.now" \
        "$cln" train -o "$work/before" "${grows[@]}" "${coarse[@]}" --steps 60
    longer=$(advice "--steps [0-9]+ or more" | tr -dc 0-9)
    expect "but then: so many steps are enough" 0 "~from.step.[0-9]*.on.pixels.at.edges" \
        "$cln" train -o "$work/means" "${grows[@]}" "${coarse[@]}" --steps "${longer:-1}"
    check "leaves were split" [ "$("$query" result.leaves <"$work/means/run.json")" -gt 8 ]
    # by the generator's cameras a few corners of the cube are near enough to one or two of them
    expect "photos that tell them in some corners alone" 0 "~hardly.any.would.*cell-pixels.0.3" \
        "$cln" train -o "$work/corners" "${grows[@]}" --steps 60 --cell-pixels 0.3
    check "nor is it then" not_said "or more"
    expect "and with more steps" 0 "" "$cln" train -o "$work/corners on" "${grows[@]}" \
        --steps 260 --cell-pixels 0.3 --split-samples 0 -v
    check "decisions say why they split none" grep -qE \
        "of [0-9]+ leaves voxels half as wide .* --cell-pixels 0.3 .* were not split" "$work/err"
}

# Photos that are learnt by heart, as there are few.
section_overfit() {
    local gap
    "$make_scene" "$work/six" --size 24 --train 6 --test 4 --plain >/dev/null || bad "make-scene"
    expect "six photos" 0 "~test.views.are.*dB.below.training.views..overfit.:.more.photos" \
        "$cln" train "$work/six" -o "$work/heart" --steps 500 --rays 256 --skip-selftest \
        --progress none
    check "it is no warning" not_said "warning: test views"
    "$make_scene" "$work/opaque" --format nerfstudio --plain --size 24 --train 10 \
        --test 4 >/dev/null
    expect "with gains" 0 "~overfit" "$cln" train "$work/opaque" -o "$work/lit" --steps 400 \
        --rays 256 --skip-selftest --progress none --exposure --space cube --downscale 1
    cp "$work/lit/run.json" "$work/out"
    gap=$(awk "BEGIN { printf \"%.1f\", $(json result.psnr_train) - $(json result.psnr_fitted) }")
    check "it is told of colours that were fitted, as test photos have no gains" \
        said "test views are $gap dB below"
}

# An evaluation that takes longer than the training.
section_slow() {
    "$make_scene" "$work/wide" --size 400 --train 4 --test 4 >/dev/null || bad "make-scene"
    expect "a moment's training, large test photos" 0 \
        "~warning:.the.evaluation.at.the.end,.of.4.test.photos.*--eval-images ~--downscale.than.1" \
        "$cln" train "$work/wide" -o "$work/slow" "${tiny[@]}" --time-limit 0.02s
    expect "time enough" 0 "" "$cln" train "$work/wide" -o "$work/fast" "${tiny[@]}" \
        --eval-images 1 --downscale 8 --time-limit 1s
    check "is no warning" not_said "evaluation at the end"
}

# pose_of_next FOLDER: each photo in it gets the pose of the next one
pose_of_next() {
    local i files=("$1"/*.png)
    mv "${files[0]}" "$1/first"
    for ((i = 1; i < ${#files[@]}; i++)); do mv "${files[i]}" "${files[i - 1]}"; done
    mv "$1/first" "${files[-1]}"
}

# Test views that stay far behind training views: a check is proposed. No word of a few steps, nor
# of a good scene.
section_doubtful() {
    local -a learn=(--preset voxel --rays 4096 --skip-selftest --progress none)
    "$make_scene" "$work/good" --size 48 --train 40 --test 4 >/dev/null
    cp -r "$work/good" "$work/shifted ones"
    pose_of_next "$work/shifted ones/train"
    expect "poses that are wrong: the next step" 0 "~warning:.test.views.are ~poses check" \
        "$cln" train "$work/shifted ones" -o "$work/wrong" "${learn[@]}" --steps 160 --json
    check "its JSON has the warning" eval '[[ "$(json warnings.0)" == "test views are "* ]]'
    check "the run keeps it" eval '"$cln" info "$work/wrong" --json | grep -q "\"test views are"'
    check "and its report" grep -q "^<li>test views are" "$work/wrong/report.html"
    check "its command is quoted" said "\`cl-nascent check '$work/shifted ones'\`"
    check "the report says the same" grep -qF -- "$(advice "test views are .* look elsewhere")" \
        "$work/wrong/report.html"
    check "with the command" grep -q "<code>cl-nascent check .*/shifted ones.*</code> looks" \
        "$work/wrong/report.html"
    "$make_scene" "$work/guessed" --format nerfstudio --size 48 --train 7 --test 4 >/dev/null
    pose_of_next "$work/guessed/images"
    expect "of few photos, in a cube that is a guess" 0 "~warning:.test.views.are" \
        "$cln" train "$work/guessed" -o "$work/guess" "${learn[@]}" --steps 160
    check "these come first" said "the cube, which is a guess, may be far too large or small \
(--bbox), or 7 training photos are few, or poses or lenses are wrong"
    check "the report says the same" grep -qF -- "$(advice "test views are .*write-mask\)")" \
        "$work/guess/report.html"
    expect "after a few steps nothing is known" 0 "" \
        "$cln" train "$work/shifted ones" -o "$work/early" "${learn[@]}" --steps 4
    check "nothing is said" not_said "test views are"
    expect "poses that are right" 0 "" \
        "$cln" train "$work/good" -o "$work/right" "${learn[@]}" --steps 160
    check "nothing is said of them" not_said "test views are"
    check "nor in the report" eval '! grep -q "cl-nascent check" "$work/right/report.html"'
    check "of what the training PSNR is" \
        grep -qE "^PSNR .* train \(mean of the last [0-9]+ steps\)," "$work/out"
}

# Photos of which one has half of the light: `eval` proposes gains.
section_exposure() {
    local kind
    for kind in none exposure; do
        "$make_scene" "$work/light-$kind" --format nerfstudio --fault $kind --size 48 --train 4 \
            --test 2 >/dev/null
    done
    run "$cln" train "$work/light-none" -o "$work/light" --preset voxel --rays 1024 \
        --skip-selftest --progress none --steps 160
    check "photos before white are told" said "stand before one colour (1,1,1)"
    check "and what differs from it is as sure as alpha" \
        number_above "$("$query" config.opaque_loss <"$work/light/run.json")" 0.09
    run "$cln" train "$work/light-none" -o "$work/asked" --preset voxel --rays 1024 \
        --skip-selftest --progress none --steps 2 --opaque-loss 0.0625
    run "$cln" train "$work/light-none" -o "$work/asked again" --settings-of "$work/asked" \
        --skip-selftest --progress none
    check "but one that is asked for, also by another run's settings" \
        [ "$("$query" config.opaque_loss <"$work/asked again/run.json")" = 0.0625 ]
    for kind in none exposure; do
        expect "eval of photos, $kind" 0 "" "$cln" eval "$work/light" --split train \
            --scene "$work/light-$kind" -o "$work/light-eval-$kind" --no-save-images
        check "--exposure is proposed for those that differ alone" [ \
            "$kind $(grep -c 'train with --exposure' "$work/out")" = \
            "$kind $([ $kind = none ] && echo 0 || echo 1)" ]
    done
    sed -i 's/"exposure": "auto"/"exposure": true/' "$work/light/run.json"
    expect "eval of such photos by a run with --exposure that has no gains for them" 0 "" \
        "$cln" eval "$work/light" --split train --scene "$work/light-exposure" \
        -o "$work/light-eval-gains" --no-save-images
    check "it is told, and --exposure not proposed" eval \
        'printed "has no gains for these" && ! printed "train with --exposure"'
    run "$cln" train "$work/light-exposure" -o "$work/gains" --preset voxel --rays 1024 \
        --skip-selftest --progress none --steps 70 --exposure
    for kind in exposure none; do
        run "$cln" eval "$work/gains" --scene "$work/light-$kind" -o "$work/gains-$kind" \
            --no-save-images --json
        check "gains are of the run's photos, not of as many others: $kind" \
            [ "$kind $(json mean.psnr_exposed | sed 's/[0-9.]*[0-9]/told/')" = \
            "$kind $([ $kind = none ] && echo null || echo told)" ]
    done
}

sums() {
    (cd "$1" && find . -type f ! -name lock -exec sha256sum {} + | sort)
}

# A finished run that is resumed without a larger budget stays what it is.
section_again() {
    local before i
    scene
    expect "train" 0 "" "$cln" train "$work/scene" -o "$work/done" "${tiny[@]}" --steps 20
    before=$(sums "$work/done")
    expect "smaller photos, with nothing left to train" 2 "--downscale ~nothing.is.left budget" \
        "$cln" train --resume "$work/done" --skip-selftest --progress none --downscale 2
    check "the way on is named" said "train --resume $work/done --steps +20"
    expect "no more steps" 2 "--steps ~adds.nothing" \
        "$cln" train --resume "$work/done" --skip-selftest --progress none --steps +0
    check "nothing was written" [ "$(sums "$work/done")" = "$before" ]
    expect "other views of the evaluation" 0 "~nothing.is.left" \
        "$cln" train --resume "$work/done" --skip-selftest --progress none --eval-images 1
    # as if the first start had taken more memory
    sed -i -e 's/"device_peak": [0-9]*/"device_peak": 8000000000000001/' \
        -e 's/"host_peak": [0-9]*/"host_peak": 8000000000000002/' "$work/done/run.json"
    expect "smaller photos and more steps" 0 "" "$cln" train --resume "$work/done" \
        --skip-selftest --progress none --downscale 2 --steps +2 --json
    check "processors' seconds are told" number_above "$(json cpu_seconds)" 0
    cp "$work/done/run.json" "$work/out"
    check "they are in run.json" number_above "$(json result.cpu_seconds)" 0
    check "memory is the most of all starts" [ \
        "$(json result.device_peak) $(json result.host_peak)" = \
        "8000000000000001 8000000000000002" ]
    check "the start that went on is in the history, and what it changed" \
        [ "$(json history.1.step) $(json history.1.changed.steps.0)" = "20 20" ]
    tail -n 1 "$work/done/metrics.jsonl" >"$work/out"
    check "the last row has the last evaluation, and these seconds" eval \
        'number_above "$(json psnr_test)" 1 && number_above "$(json cpu_seconds)" 0'
    expect "info of it" 0 "" "$cln" info "$work/done"
    check "tells of the other settings" grep -qE \
        '^  resumed at step 20 with other settings: steps 20 -> 22, downscale 0 -> 2 ' "$work/out"
    cp -r "$work/done" "$work/twin"
    expect "beside its twin" 0 "" "$cln" info "$work/done" "$work/twin"
    check "it is no run in one go" printed "No setting of the last start differs."
    cp -r "$work/done" "$work/back" # to an earlier checkpoint
    rm "$work/back/checkpoint/00000022."*
    expect "info of a model before the result" 0 "" "$cln" info "$work/back" --json
    check "has no figures of the one that is gone" [ "$(json step) $(json result)" = "20 null" ]
    expect "a copy of it" 0 "" "$cln" export "$work/back" --copy "$work/back copy"
    cp "$work/back copy/run.json" "$work/out"
    check "has none, either" [ "$(json result)" = null ]
    expect "eval of it" 0 "" "$cln" eval "$work/back" --no-save-images
    check "its report has none, either" grep -q "It ended at step 22, but the checkpoint of that" \
        "$work/back/report.html"
    for i in 21 23; do # of more steps of the one that is gone
        sed "s/\"step\": 22/\"step\": $i/; s/\"psnr\": /&9/" \
            "$work/done/eval/00000022-test-1.json" >"$work/back/eval/000000$i-test-1.json"
    done
    mkdir "$work/back/eval/00000023-test-1.json.dropped"
    expect "it is not done" 0 "" "$cln" train "$work/scene" -o "$work/back" --resume-or-start \
        --skip-selftest --progress none --downscale 2 --steps 22 --json
    check "but is trained to its end again" eval \
        '[ "$(json step)" = 22 ] && ! said "nothing is trained" &&
            [ -s "$work/back/checkpoint/00000022.json" ]'
    check "figures of the other model are set aside, but for those that cannot be" \
        [ "$(cd "$work/back/eval" && echo 00000021*.json* 00000022*.json* 00000023*.json)" = \
        "00000021-test-1.json.dropped 00000022-test-1.json 00000023-test-1.json" ]
    check "which is told" said "cannot be renamed"
    check "and its report has none of them" eval \
        '! grep -qE ">9[0-9]{2}[.]" "$work/back/report.html"'
    # a start that is killed leaves no result, but what starts before it took, and its newest row
    cp -r "$work/done" "$work/gone"
    sed -i 's/"device_peak": [0-9]*/"device_peak": 1/' "$work/gone/run.json"
    sed -i '$s/"host_mem":[0-9]*/"host_mem":9000000000000000/' "$work/gone/metrics.jsonl"
    run "$cln" train --resume "$work/gone" --skip-selftest --progress none --steps +2 --json
    check "memory, after one that was killed" [ "$(json device_peak) $(json host_peak)" = \
        "8000000000000001 9000000000000000" ]
}

# A batch job that is begun again, by the same line whatever became of it before.
section_requeued() {
    local job="$work/queued" before i
    local -a line=("$cln" train "$work/scene" -o "$job" "${tiny[@]}" --log-every 4 --json
        --resume-or-start)
    scene
    mkdir "$job"
    echo mine >"$job/notes"
    expect "a folder with other files" 7 "~other.files" "${line[@]}" --steps 40
    check "they are left alone" [ "$(ls "$job")" = notes ]
    rm "$job/notes"
    "${line[@]}" --steps 1000000 >/dev/null 2>&1 &
    for ((i = 0; i < 600; i++)); do
        [ -s "$job/metrics.jsonl" ] && break
        sleep 0.1
    done
    expect "a run that another process begins" 7 "~process.$!.on.*trains.this.run" \
        "${line[@]}" --steps 40
    expect "likewise a plain start" 7 "~process.$!.on.*trains.this.run" \
        "$cln" train "$work/scene" -o "$job" "${tiny[@]}" --steps 40
    kill -KILL $!
    wait $! 2>/dev/null
    echo mine >"$job/notes"
    expect "killed before the first checkpoint" 0 "~begins.again" "${line[@]}" --steps 40
    before=$(json model_digest)
    expect "beside one in one go" 0 "" "$cln" train "$work/scene" -o "$work/straight" \
        "${tiny[@]}" --log-every 4 --json --steps 40
    check "it has the same bits" [ "$(json model_digest)" = "$before" ]
    check "and the same rows" [ "$(grep -o '"step":[0-9]*' "$job/metrics.jsonl")" = \
        "$(grep -o '"step":[0-9]*' "$work/straight/metrics.jsonl")" ]
    check "what else is there stays" [ "$(cat "$job/notes")" = mine ]
    expect "with a checkpoint it goes on" 0 "~resumed.at.step.40" "${line[@]}" --steps 50
    check "to the new budget" [ "$(json step)" = 50 ]
    check "nothing is said of what is given as before" not_said "has no effect"
    before=$(json model_digest)$(sums "$job")
    expect "begun again when it is done" 0 "~is.done" "${line[@]}" --steps 50
    check "it tells its result, and writes nothing" \
        [ "$(json state)$(json model_digest)$(sums "$job")" = "done$before" ]
    expect "begun again with fewer steps" 0 "~is.done" "${line[@]}" --steps 44
    check "it does likewise" [ "$(json state)$(json model_digest)$(sums "$job")" = "done$before" ]
    expect "with another preset" 2 "~began.with.preset.fast" "${line[@]}" --preset voxel
    cp "$work/scene/train/r_001.png" "$work/photo"
    cp "$work/scene/train/r_000.png" "$work/scene/train/r_001.png"
    expect "of photos that changed since" 3 "~not.the.scene" "${line[@]}" --steps 50
    check "prints no result of others" [ ! -s "$work/out" ]
    mv "$work/photo" "$work/scene/train/r_001.png"
    expect "of the photos that they were" 0 "~is.done" "${line[@]}" --steps 50
    line[2]=$work/none
    expect "of a scene that is not there" 3 "~none" "${line[@]}" --steps 50
    line[2]=$work/scene
    mv "$job/checkpoint" "$work/away"
    expect "done, without its checkpoint" 7 "~its.checkpoint.is.gone" "${line[@]}" --steps 50
    check "nothing is written over" [ "$("$query" state <"$job/run.json")" = "done" ]
    rm -r "$work/straight"
    line=("$cln" train "$work/scene" -o "$work/straight" "${tiny[@]}" --resume-or-start --steps 400
        --target-psnr 1 --eval-every 4)
    expect "one that reached its test PSNR" 0 "" "${line[@]}"
    before=$(sums "$work/straight")
    expect "begun again" 0 "~is.done" "${line[@]}"
    check "trains no more" [ "$(sums "$work/straight")" = "$before" ]
}

# A run whose process was killed has no result: what metrics.jsonl has is taken over.
section_lost() {
    local job="$work/job" test commit
    scene
    run "$cln" train "$work/scene" -o "$job" "${tiny[@]}" --log-every 4 --json --steps 12
    test=$(json psnr_test)
    check "it was measured at its end" [ "$(json eval_step)" = 12 ]
    sed -i 's/"result": {/"lost": {/; s/"state": "done"/"state": "running"/' "$job/run.json"
    commit=$("$query" commit <"$job/run.json")
    sed -i "s/$commit/0123abc/" "$job/run.json"
    "$cln" train --resume "$job" --steps +1000000 --log-every 999999 --save-every 1 --json \
        --skip-selftest --progress none >"$work/out" 2>"$work/err" &
    for ((i = 0; i < 600; i++)); do
        [ "$(cat "$job/checkpoint/latest")" != 00000012 ] && break
        sleep 0.1
    done
    kill -TERM $!
    wait $!
    check "stopped soon after a resume" [ $? = 143 ]
    check "the figures of before are told" [ "$(json psnr_test) $(json eval_step)" = "$test 12" ]
    check "another program is told" said "~another.program,.*0123abc"
    for key in psnr_test eval_step psnr_train; do
        check "run.json has them: $key" [ "$("$query" result.$key <"$job/run.json")" != null ]
    done
    check "and those of training are of its own steps" [ "$(json psnr_train)" = \
        "$(grep psnr_train "$job/metrics.jsonl" | tail -1 | "$query" psnr_train)" ]
    cp -r "$job" "$work/other"
    rm -r "$work"/*/eval
    expect "info RUN RUN" 0 "" "$cln" info "$job" "$work/other"
    check "tells of which step test figures are" grep -qE '^  measured at step +12 +12' "$work/out"
    check "and by which programs it was trained" grep -q " of commit 0123abc -> " "$work/out"
}

# The settings of a run, used again: all of them, and in a conf by the names that run.json has.
section_reused() {
    local digest
    local -a plain=(--skip-selftest --progress none --json)
    scene
    run "$cln" train "$work/scene" -o "$work/first" "${tiny[@]}" --steps 12 --seed 7 --json
    digest=$(json model_digest)
    printf 'view_width = 16\nlr 0.5\nt_min 0.0002\n' >"$work/scene/cl-nascent.conf"
    expect "a run's settings" 0 "" "$cln" train "$work/scene" -o "$work/second" \
        --settings-of "$work/first" "${plain[@]}"
    check "make the same model, whatever the conf says" [ "$(json model_digest)" = "$digest" ]
    cp "$work/second/run.json" "$work/out"
    check "of the same preset" [ "$(json preset)" = fast ]
    expect "and another seed" 0 "" "$cln" train "$work/scene" -o "$work/third" \
        --settings-of "$work/first" --seed 2 "${plain[@]}"
    check "another one" [ "$(json model_digest)" != "$digest" ]
    expect "the runs side by side" 0 "" "$cln" info "$work/first" "$work/third"
    check "differ in the seed" grep -qE '^  seed +7 +2$' "$work/out"
    check "and have a mean and a deviation" \
        grep -qE '^Over 2 seeds, .* PSNR train, of rays [0-9.]+ \+- [0-9.]+' "$work/out"
    run "$cln" train "$work/scene" -o "$work/halved" "${tiny[@]}" --steps 1 --downscale 2 --json
    expect "settings that are of the other scene are told" 0 "~taken.over,.too:.--downscale=2$" \
        "$cln" train "$work/scene" -o "$work/halved again" --settings-of "$work/halved" \
        "${plain[@]}"
    expect "a preset, too" 2 "--settings-of --preset" "$cln" train "$work/scene" -o "$work/none" \
        --settings-of "$work/first" --preset voxel
    expect "of what is no run" 3 "~settings-of" "$cln" train "$work/scene" -o "$work/none" \
        --settings-of "$work/scene"
    expect "a conf with a key of run.json" 0 "~conf:.view-width.16,.lr.0.5" \
        "$cln" info "$work/scene"
    check "in which nothing is set twice" not_said again
    printf 'lr 0.5\nadaptive\n\nno-adaptive\n' >"$work/scene/cl-nascent.conf"
    expect "one that takes back what it sets" 0 \
        "~warning:.*conf:.line.4.sets.adaptive.again,.after.line.2" "$cln" info "$work/scene"
    printf 'preset nerf\nlr 0.5\npreset voxel\n' >"$work/scene/cl-nascent.conf"
    expect "one of two presets" 0 "~warning:.*conf:.line.3.sets.preset.again,.after.line.1" \
        "$cln" info "$work/scene"
    rm "$work/scene/cl-nascent.conf"
}

# What a run found by itself, where it is found otherwise for another scene: the options that keep
# it do.
section_anew() {
    local -a keep
    local kind
    for kind in 1 2; do
        "$make_scene" "$work/moment $kind" --format nerfstudio --masks --size 48 --train 12 \
            --test 2 --seed $kind >/dev/null
    done
    run "$cln" train "$work/moment 1" -o "$work/first moment" "${tiny[@]}" --steps 1
    expect "the same scene again" 0 "" "$cln" train "$work/moment 1" -o "$work/again" \
        --settings-of "$work/first moment" --skip-selftest --progress none
    check "nothing is found otherwise" not_said "found anew"
    sed -i 's/"as": "alpha"/"as": "ignore"/; s/"space": "cube"/"space": "shell"/' \
        "$work/first moment/run.json"
    sed -i '/"background": \[/,/\]/ s/1.0/0.25/' "$work/first moment/run.json"
    expect "another one: what differs is told" 0 "~found.anew ~masks.alpha..there.ignore.
        ~space.cube..there.shell. ~background.1,1,1..there.0.25,0.25,0.25. ~cube.of.half.side" \
        "$cln" train "$work/moment 2" -o "$work/second moment" \
        --settings-of "$work/first moment" --skip-selftest --progress none
    read -ra keep <<<"$(sed -n "s/.*to keep the run's://p" "$work/err")"
    check "by four options" [ ${#keep[@]} = 4 ]
    expect "which keep them" 0 "~what.they.drop.does.not.count" "$cln" train "$work/moment 2" \
        -o "$work/kept moment" --settings-of "$work/first moment" --skip-selftest \
        --progress none "${keep[@]}"
    check "so that nothing is found otherwise" not_said "found anew"
    check "nor is the cube another" [ "$("$query" dataset.half <"$work/kept moment/run.json")" = \
        "$("$query" dataset.half <"$work/first moment/run.json")" ]
    expect "side by side" 0 "" "$cln" info "$work/second moment" "$work/kept moment"
    check "the runs differ in masks" grep -qE '^  masks +alpha \(auto\) +ignore$' "$work/out"
}

# Photos of another moment by the same names and poses: told where a run goes on with them, and
# where its tree is taken over. A run goes on with no other scene.
section_moments() {
    local s=$work/stage
    local -a box=("--bbox=-1.5,-1.5,-1.5,1.5,1.5,1.5")
    "$make_scene" "$s" --format nerfstudio --size 32 --train 8 --test 2 >/dev/null
    "$make_scene" "$work/other moment" --format nerfstudio --size 32 --train 8 --test 2 \
        --seed 2 >/dev/null
    run "$cln" train "$s" -o "$work/moment" "${tiny[@]}" "${box[@]}" --steps 4
    expect "its tree, for the same photos" 0 "~tree.of" "$cln" train "$s" -o "$work/same tree" \
        "${tiny[@]}" "${box[@]}" --steps 4 --tree-from "$work/moment" --holdout 3
    check "is no mistake" not_said "leaves are missing"
    expect "another scene: refused" 3 "~none.begins.with.another.scene's.model ~settings-of" \
        "$cln" train --resume "$work/moment" "$work/other moment" --steps 8
    cp -r "$s" "$work/elsewhere"
    rm "$s/images/frame_00001.png"
    run "$cln" train "$s" -o "$work/fewer" "${tiny[@]}" "${box[@]}" --steps 4 --missing skip
    expect "in another folder, with a photo more: goes on" 0 "~1.photo.is.new ~resumed.at.step.4" \
        "$cln" train --resume "$work/fewer" "$work/elsewhere" --steps 6 --progress none \
        --skip-selftest
    check "from there on there" grep -q '"path": ".*/elsewhere"' "$work/fewer/run.json"
    cp "$work/elsewhere/images/frame_00001.png" "$s/images"
    cp "$s/images/frame_00002.png" "$s/images/frame_00001.png"
    expect "one photo is another" 0 "~1.of.10.photos,.or.their.masks,.have.changed" \
        "$cln" train --resume "$work/moment" --steps 6 --progress none --skip-selftest
    check "which is no warning" not_said "ghosts"
    cp "$work/other moment/images/"*.png "$s/images"
    expect "all are: a warning" 0 "~warning:.*all.10.photos ~ghosts" "$cln" eval "$work/moment" \
        -o "$work/judged moment"
    expect "its tree, for other photos" 0 "~warning:.*10.of.10.photos.are.not ~are.missing" \
        "$cln" train "$s" -o "$work/other tree" "${tiny[@]}" "${box[@]}" --steps 4 \
        --tree-from "$work/moment"
    expect "the run goes on with all of them" 0 "~all.10.photos ~ghosts ~settings-of.*/moment" \
        "$cln" train --resume "$work/moment" --steps 8 --progress none --skip-selftest
}

# The manual's example of moments of a fixed rig: one lacks photos, the others give a film, figures
# and surfaces.
section_rig() {
    local i m
    for i in 0 1 2; do
        "$make_scene" "$work/rig/moment_000$i" --format nerfstudio --masks --size 32 \
            --train 10 --test 0 --seed $((i + 1)) >/dev/null
    done
    rm "$work"/rig/moment_0001/images/frame_0000[1-4].png
    cd "$work/rig" || exit 1
    expect "the first moment" 0 "" "$cln" train moment_0000 -o run_0000 "${tiny[@]}" --steps 8 \
        --bbox=-1.5,-1.5,-1.5,1.5,1.5,1.5 --masks alpha --holdout 0
    for i in 1 2; do
        m=$(printf %04d $i)
        run "$cln" train "moment_$m" -o "run_$m" --settings-of run_0000 --progress none \
            --skip-selftest || :
        [ $rc = 0 ] || echo "$m: exit code $rc" >>failed.txt
    done
    check "one that lacks photos is left out" [ "$(cat failed.txt)" = "0001: exit code 3" ]
    expect "a path" 0 "" "$cln" export run_0000 --cameras path.json
    for i in 0 2; do
        m=$(printf %04d $i)
        expect "a frame of each" 0 "" "$cln" render "run_$m" --poses path.json --frames $i -o film/
        expect "figures" 0 "" "$cln" eval "run_$m" --split train --json
        expect "and a surface" 0 "" "$cln" export "run_$m" --mesh "$m.glb"
    done
    check "frames have their numbers" eval '[ -e film/images_frame_00001.png ] &&
        [ -e film/images_frame_00003.png ]'
    cd "$here" || exit 1
}

# A run whose parts are links to another's: training would change that one.
section_links() {
    local name
    scene
    run "$cln" train "$work/scene" -o "$work/theirs" "${tiny[@]}" --steps 4
    echo precious >"$work/precious"
    for name in lock metrics.jsonl checkpoint; do
        rm -rf "$work/mine"
        cp -r "$work/theirs" "$work/mine"
        rm -rf "$work/mine/$name"
        ln -s "$work/precious" "$work/mine/$name"
        [ "$name" != checkpoint ] || ln -sfn "$work/theirs/checkpoint" "$work/mine/checkpoint"
        expect "a $name that is a link" 7 "~mine/$name.is.a.link" \
            "$cln" train --resume "$work/mine" --steps +4
    done
    check "what it leads to is as it was" [ "$(cat "$work/precious")" = precious ]
    check "of checkpoints, too" [ "$(ls "$work/theirs/checkpoint")" = \
        "$(printf '%s\n' 00000004.json 00000004.safetensors latest)" ]
    rm -rf "$work/mine/checkpoint" "$work/mine/lock"
    cp -r "$work/theirs/checkpoint" "$work/mine"
    mkfifo "$work/mine/lock"
    expect "a lock that is a pipe" 0 "" timeout 20 "$cln" info "$work/mine"
    rm "$work/mine/lock" "$work/mine/metrics.jsonl"
    mkfifo "$work/mine/metrics.jsonl"
    expect "measurements that are a pipe" 7 "~mine/metrics.jsonl.is.no.file;.move.it.away" \
        timeout -k 1 60 "$cln" train --resume "$work/mine" --steps +4
    mkdir "$work/no scene"
    mkfifo "$work/no scene/x.json" "$work/no scene/images.txt"
    expect "a folder of pipes" 3 "~no.scene" timeout -k 1 20 "$cln" info "$work/no scene"
    ln -s theirs "$work/whole"
    cp -r "$work/scene" "$work/linked"
    mv "$work/linked/train/r_001.png" "$work/elsewhere.png"
    expect "info of a scene whose photos are all in it" 0 "" "$cln" info "$work/scene" --json
    check "tells of none outside" [ "$(json outside)" = null ]
    ln -s ../../elsewhere.png "$work/linked/train/r_001.png"
    expect "info of one with a photo elsewhere" 0 "" "$cln" info "$work/linked" --json
    check "counts it" [ "$(json outside.views)" = 1 ]
    check "and tells where it is" eval '[[ $(json outside.first) = */elsewhere.png ]]'
    expect "a link to a whole run" 0 "" "$cln" train --resume "$work/whole" --steps +4
}

# --target-psnr by itself is looked for at steps; and what is measured needs test views.
section_target() {
    scene
    expect "a target, without --eval-every" 0 "~target.of.1.dB.test.PSNR.reached:.*64.steps" \
        "$cln" train "$work/scene" -o "$work/target" "${tiny[@]}" --steps 200 --target-psnr 1 --json
    check "it ends at the first look" [ "$(json step)" = 64 ]
    expect "one that is not reached" 0 "~target.of.99.dB.test.PSNR.not.reached" \
        "$cln" train "$work/scene" -o "$work/missed" "${tiny[@]}" --steps 20 --target-psnr 99
    cp -r "$work/scene" "$work/untested"
    rm -r "$work/untested/transforms_test.json" "$work/untested/test"
    expect "without test views" 0 "~target-psnr.has.no.effect ~eval-every.has.no.effect" \
        "$cln" train "$work/untested" -o "$work/blind" "${tiny[@]}" --steps 5 --target-psnr 9 \
        --eval-every 2 --holdout 0
}

# Evaluations that never come.
section_points() {
    scene
    expect "points beyond the steps" 0 \
        "~eval-at.60.has.no.effect:.it.is.a.step,.beyond.--steps.20 ~seconds.end.in.s" \
        "$cln" train "$work/scene" -o "$work/points" "${tiny[@]}" --steps 20 --eval-at 10,60
    check "the other one is not named" not_said "--eval-at 10"
    expect "points beyond the time" 0 "~eval-at.60s.has.no.effect ~time-limit.1s" \
        "$cln" train "$work/scene" -o "$work/times" "${tiny[@]}" --time-limit 1s \
        --eval-at 60s,60
    check "a step may come" not_said "--eval-at 60 has"
}

# Models that stay are runs, which go on to the same end.
section_kept() {
    local r=$work/keeps digest s=$work/keeps/at/00000020
    scene
    expect "--save-at" 0 "~step.20.stays.as.*at/00000020 ~save-at.99.has.no.effect" "$cln" train \
        "$work/scene" -o "$r" "${tiny[@]}" --steps 40 --save-at 20,30,99 --log-every 4 --json
    digest=$(json model_digest)
    check "both are there" [ "$(cd "$r/at" && echo *)" = "00000020 00000030" ]
    expect "info of one" 0 "" "$cln" info "$s" --json
    check "it is of that step" [ "$(json step) $(json state)" = "20 interrupted" ]
    expect "eval of one" 0 "" "$cln" eval "$s" --no-save-images --json
    check "its figures are of that step" [ "$(json step)" = 20 ]
    mkdir "$work/elsewhere"
    cp -r "$s" "$work/elsewhere/copy"
    expect "a copy is rendered" 0 "" "$cln" render "$work/elsewhere/copy" --orbit 2 --width 16 \
        --height 16 --progress none
    expect "one goes on" 0 "" "$cln" train --resume "$s" --skip-selftest --progress none --json
    check "to the same bits" [ "$(json model_digest)" = "$digest" ]
    check "with the same rows" [ "$("$query" -l loss <"$s/metrics.jsonl" | sort | uniq)" = \
        "$("$query" -l loss <"$r/metrics.jsonl" | sort | uniq)" ]
    cp -r "$s" "$work/one kept"
    cp -r "$s" "$work/another kept"
    expect "three equal runs" 0 "" "$cln" info "$work/one kept" "$s" "$work/another kept" --json
    check "are told in a sentence" grep -q \
        "one kept, 00000020 and another kept ended with the same model, to the bit" "$work/out"
    expect "and again, with another end" 0 "" "$cln" train --resume "$s" --steps +4 --save-at 43 \
        --skip-selftest --progress none
    check "as it is asked for" [ -s "$s/at/00000043/run.json" ]
    digest=$(json model_digest)
    cp "$r/at/00000030/run.json" "$work/thirty.json"
    rm -r "$r/checkpoint"
    sed -i 's/"state": "done"/"state": "running"/' "$r/run.json" # killed, before a checkpoint
    expect "a training that comes by again" 0 "~at/00000020.is.there.already" "$cln" train \
        "$work/scene" -o "$r" "${tiny[@]}" --steps 40 --save-at 20,30,99 --log-every 4 \
        --resume-or-start
    expect "leaves alone what has gone on" 0 "" "$cln" info "$s" --json
    check "it is still at its end" [ "$(json step)" = 44 ]
    check "and what has not" cmp -s "$r/at/00000030/run.json" "$work/thirty.json"
    rm -r "$r/at"
    touch "$r/at"
    expect "a model that cannot be kept does not end the training" 0 \
        "~save-at:.step.42.is.not.kept:.*keeps/at" "$cln" train --resume "$r" --steps +4 \
        --save-at 42 --skip-selftest --progress none
    expect "wrong points" 2 "--save-at soon" "$cln" train "$work/scene" -o "$work/wrong" \
        --save-at soon
}

# Nothing is lost where only the last file cannot be written.
section_barred() {
    scene
    expect "a run" 0 "" "$cln" train "$work/scene" -o "$work/barred" "${tiny[@]}" --steps 5
    rm "$work/barred/report.html"
    mkdir -p "$work/barred/report.html/folder"
    expect "a report that cannot be written" 7 \
        "~report.html:.cannot.write ~while.the.checkpoint.of.step.10.is.whole" \
        "$cln" train --resume "$work/barred" --skip-selftest --progress none --steps 10
    expect "the model is there" 0 "" "$cln" eval "$work/barred" -o "$work/barred eval" --json
    check "of the last step" [ "$(json step)" = 10 ]
}

# A disk that the largest tree would not fit: a warning that names what fits. In a file system of 48
# MiB; only root can mount one, in a name space of its own.
section_disk() {
    local leaves i
    scene
    mkdir -p "$work/small"
    if ! unshare -m mount -t tmpfs -o size=48m none "$work/small" 2>/dev/null; then
        skip "a small disk" "nothing can be mounted"
        return
    fi
    on_small() {
        unshare -m sh -c 'mount -t tmpfs -o size=48m none "$0" && exec "$@"' "$work/small" "$@"
    }
    expect "a tree that would not fit, if it became so large" 0 "~may.have.too.little.room" \
        on_small "$cln" train "$work/scene" -o "$work/small/run" --preset voxel --rays 512 \
        --skip-selftest --progress none --steps 10
    leaves=$(advice "with --max-leaves [0-9]+" | tr -dc 0-9)
    check "another --max-leaves is named" [ "${leaves:-0}" -gt 0 ]
    expect "with which nothing is said" 0 "" \
        on_small "$cln" train "$work/scene" -o "$work/small/run" --preset voxel --rays 512 \
        --skip-selftest --progress none --steps 10 --max-leaves "$leaves"
    check "nothing of the disk" not_said "too little room"
    expect "a disk that not even the pictures fit" 7 "~may.have.too.little.room" timeout 60 \
        unshare -m sh -c 'mount -t tmpfs -o size=200k none "$0" && exec "$@"' "$work/small" \
        "$cln" train "$work/scene" -o "$work/small/run" --preset fast --width 16 --view-width 16 \
        --skip-selftest --progress none --steps 10 --start-level 0 --space cube --level-at ""
    expect "a first tree that does not fit" 7 "~too.little.room ~first.checkpoint:.up.to free" \
        on_small "$cln" train "$work/scene" -o "$work/small/run" --preset voxel --rays 512 \
        --skip-selftest --progress none --steps 10 --start-level 5 --level-at ""
    "$cln" train "$work/scene" -o "$work/large" --preset voxel --rays 512 --skip-selftest \
        --progress none --steps 10 --start-level 4 --level-at "" >/dev/null 2>&1
    expect "a resumed one without room for one checkpoint more" 7 \
        "~too.little.room ~next.checkpoint" \
        unshare -m sh -c 'mount -t tmpfs -o size=300m none "$0" && cp -r "$1" "$0/run" &&
            fallocate -l "$(($(df --output=avail -B1 "$0" | tail -1) - 1000000))" "$0/full" &&
            shift && exec "$@"' "$work/small" "$work/large" \
        "$cln" train --resume "$work/small/run" --skip-selftest --progress none --steps 20
    if ! command -v ffmpeg >/dev/null; then
        skip "films on a full disk" "there is no ffmpeg"
        return
    fi
    for i in gif mkv mp4; do
        expect "a .$i film on a full disk" 7 "~no.room.is.left ~make.room" \
            unshare -m sh -c 'mount -t tmpfs -o size=100k none "$0" &&
                fallocate -l "$(($(df --output=avail -B1 "$0" | tail -1) - 4096))" "$0/full" &&
                "$@"; code=$?; ls "$0" | grep -v full >"$0.left"; exit $code' "$work/small" \
            "$cln" render "$work/large" --orbit 4 --width 128 -o "$work/small/f.$i" \
            --progress none
        check "nothing of it is left" [ -e "$work/small.left" -a ! -s "$work/small.left" ]
    done
}

# The folder where PoCL keeps kernels: of another account, full, filling up, and empty.
section_cache() {
    local cold="~building.kernels.for.*once.for.scenes.and.settings.of.this.kind" i
    scene
    "$cln" devices --no-test | grep -q "Portable Computing Language" || {
        skip "PoCL's kernels" "the device is another's"
        return
    }
    # optimised, as building others may take too little time to be told
    expect "kernels are built: that is said" 0 "$cold" \
        env -u POCL_EXTRA_BUILD_FLAGS POCL_CACHE_DIR="$work/kernels" \
        "$cln" train "$work/scene" -o "$work/cold" "${tiny[@]}" --steps 2
    check "once" [ "$(grep -c "building kernels" "$work/err")" = 1 ]
    expect "they are there" 0 "" env -u POCL_EXTRA_BUILD_FLAGS POCL_CACHE_DIR="$work/kernels" \
        "$cln" train "$work/scene" -o "$work/warm" "${tiny[@]}" --steps 2
    check "nothing is said" not_said "building kernels"
    # while another process compiles, with a time limit in case nobody notices the signal
    mkdir "$work/busy"
    exec 9>"$work/busy/cl-nascent.lock"
    flock 9
    POCL_CACHE_DIR=$work/busy timeout -k 1 60 "$cln" train "$work/scene" -o "$work/waits" \
        "${tiny[@]}" --steps 2 >"$work/out" 2>"$work/err" 9>&- &
    for ((i = 0; i < 200; i++)); do
        said "waiting for it" && break
        sleep 0.1
    done
    check "another process builds kernels: it is waited for" said "another process is building"
    kill -TERM $!
    wait $!
    check "until a signal comes" [ $? = 143 ]
    check "then nothing was written" [ ! -e "$work/waits" ]
    exec 9>&-
    POCL_CACHE_DIR=$work/busy "$cln" train "$work/scene" -o "$work/waits" "${tiny[@]}" --steps 2 \
        >"$work/out" 2>"$work/err" &
    for ((i = 0; i < 600; i++)); do
        compgen -G "$work/busy/[A-P][A-P]" >/dev/null && break
        sleep 0.1
    done
    check "who builds kernels holds the lock" eval '! flock -n "$work/busy/cl-nascent.lock" true'
    kill -KILL $!
    wait $! 2>/dev/null
    check "and no longer than it lives" flock -n "$work/busy/cl-nascent.lock" true
    expect "an empty POCL_CACHE_DIR is none" 0 "" env POCL_CACHE_DIR= "$cln" devices --no-test
    expect "a place for kernels that XDG_CACHE_HOME names, and is none" 4 \
        "~none/pocl/kcache.\(by.XDG_CACHE_HOME\).cannot.be.written POCL_CACHE_DIR" \
        env -u POCL_CACHE_DIR XDG_CACHE_HOME=/proc/none "$cln" devices --no-test
    check "it is not for want of a GPU" not_said "GPUs need"
    mkdir -p "$work/small" "$work/empty"
    if ! unshare -m mount -t tmpfs none "$work/small" 2>/dev/null; then
        skip "a full kernel cache" "nothing can be mounted"
        return
    fi
    # in_small KIB FREE COMMAND...: POCL_CACHE_DIR has so many KiB, and so many bytes free (0: all)
    in_small() {
        unshare -m bash -c 'mount -t tmpfs -o size=$1k none "$0" && cp -r "$2"/. "$0" &&
            if [ $3 != 0 ]; then
                fallocate -l $(($(df --output=avail -B1 "$0" | tail -1) - $3)) "$0/full"
            fi
            export POCL_CACHE_DIR=$0
            shift 3
            "$@"' "$work/small" "$@"
    }
    expect "no room for kernels" 7 "~$work/small.has.too.little.room ~16.0.MiB POCL_CACHE_DIR" \
        in_small 5000 "$work/empty" 0 "$cln" train "$work/scene" -o "$work/full" "${tiny[@]}" \
        --steps 2
    expect "nor for what is on its way to them" 7 "~$work/small.has.too.little.room ~2.0.MiB" \
        in_small 20000 "$work/kernels" 1000000 "$cln" eval "$work/cold"
    expect "room enough for none" 0 "~warning:.*$work/small.has.*free POCL_CACHE_DIR" \
        in_small 20000 "$work/kernels" 4000000 "$cln" train "$work/scene" -o "$work/full" \
        "${tiny[@]}" --steps 2
    # PoCL or LLVM end the process, when launches compile
    expect "a disk that fills up meanwhile" 7 "~no.room.left POCL_CACHE_DIR" \
        in_small 30000 "$work/empty" 0 bash -c '"$@" 2> >(tee "$0" >&2) & pid=$!
            until grep -q ^memory "$0" 2>/dev/null || ! kill -0 $pid; do sleep 0.02; done
            cat /dev/zero >"$POCL_CACHE_DIR/full"
            wait $pid' "$work/meanwhile" "$cln" train "$work/scene" -o "$work/filled" "${tiny[@]}" \
        --steps 2
    expect "kernels where nobody can write" 7 "~$work/kernels.cannot.be.written POCL_CACHE_DIR" \
        unshare -m sh -c 'mount --bind "$0" "$0" && mount -o remount,ro,bind "$0" &&
            POCL_CACHE_DIR=$0 exec "$@"' "$work/kernels" \
        "$cln" train "$work/scene" -o "$work/never" "${tiny[@]}" --steps 2
    check "it is no error in a kernel" not_said "please report"
}

# A folder for kernels that several accounts share: PoCL makes folders in it that are one's own.
section_shared() {
    local as=(setpriv --reuid=54321 --clear-groups env HOME="$work/other"
        POCL_CACHE_DIR="$work/pocl" "$work/cln")
    scene
    cp "$cln" "$work/cln"
    chmod -R go+rX "$work"
    mkdir -p "$work/other"
    if ! chown 54321 "$work/other" 2>/dev/null || ! "${as[@]}" --version >/dev/null 2>&1; then
        skip "a kernel cache of several accounts" "only root can be another one"
        return
    fi
    mkdir -m 1777 "$work/pocl"
    cp -r kernels "$work/other/kernels"
    mkdir -m 700 "$work/pocl/AA"
    echo "an error;" >>"$work/other/kernels/scan.cl"
    expect "an error in a kernel, beside another's folder" 4 \
        "~warning:.*$work/pocl/AA ~scan.cl:.*error: --kernel-dir" "${as[@]}" train "$work/scene" \
        -o "$work/other/run" "${tiny[@]}" --steps 2 --kernel-dir "$work/other/kernels"
    rm -r "$work/pocl"/*
    expect "a folder that all can write to, and that was chosen" 4 \
        "~warning:.another.account.can.write.to.$work/pocl, POCL_CACHE_DIR" "${as[@]}" train \
        "$work/scene" -o "$work/other/run" "${tiny[@]}" --kernel-dir "$work/other/kernels"
    rm -r "$work/pocl"/*
    mkdir -m 700 "$work/pocl"/{A..P}{A..P}
    expect "kernels in folders of another account" 7 \
        "~cache.$work/pocl.cannot.be.written ~its.folder.AA.belongs.to.user.0 POCL_CACHE_DIR" \
        "${as[@]}" train "$work/scene" -o "$work/other/run" "${tiny[@]}" --steps 2
    check "nor are plain ones used" not_said "plain ones"
    [[ $cln != /tmp/* ]] || return 0
    expect "one of another account, without HOME" 7 \
        "~as.HOME.is.not.set,.and.another.account.can.write.to./tmp/pocl: POCL_CACHE_DIR" \
        unshare -m sh -c 'mount -t tmpfs none /tmp && mkdir -p /tmp/pocl/kcache &&
            chown 54321 /tmp/pocl && unset HOME XDG_CACHE_HOME POCL_CACHE_DIR &&
            "$0" selftest --quick' "$cln"
}

# A machine whose memory has no room for all of --max-leaves, but for the photos.
section_memory() {
    local s=$work/laptop leaves
    "$make_scene" "$s" --size 128 --train 6 --test 2 >/dev/null
    expect "leaves give way before photos, which need no file" 0 "~room.for.a.tree.of.about" \
        env TMPDIR="$work/none" "$cln" train "$s" -o "$work/on laptop" --skip-selftest \
        --progress none --steps 1 --rays 64 --host-mem 1G
    check "none is spoken of" eval '! said "go to a file"'
    expect "resumed, it still has room for them" 0 "" env TMPDIR="$work/none" "$cln" train \
        --resume "$work/on laptop" --skip-selftest --progress none --steps +1
    expect "check of such a scene" 0 "" "$cln" check "$s" --probe 0 --host-mem 1G
    tr -s " \n" " " <"$work/out" >"$work/line"
    check "says which tree has room" grep -qE \
        "room for a tree of about [0-9]+ leaves: growth that would not fit is left out" "$work/line"
    leaves=$(sed -n 's/.*--max-leaves \([0-9]*\) --max-level [0-9]* asks for no more.*/\1/p' \
        "$work/line")
    check "names a --max-leaves" number_above "${leaves:-0}" 64
    check "says where photos are" grep -q "pixels, 512 KiB, stay in memory" "$work/line"
    check "and what the disk has" grep -qE "[KMGT]iB are free here" "$work/line"
    expect "with fewer leaves" 0 "" "$cln" check "$s" --probe 0 --host-mem 1G --max-leaves 64
    check "it depends" eval 'tr -s " \n" " " <"$work/out" |
        grep -q "room for that tree while it is no deeper than level 3"'
    expect "with much memory" 0 "" "$cln" check "$s" --probe 0 --host-mem 9G
    check "nothing is said" eval '! grep -qE "room for|stay in memory" "$work/out"'
    echo host-mem 1G >"$s/cl-nascent.conf"
    expect "info of such a scene" 0 "" "$cln" info "$s"
    check "says it in words" eval \
        'grep -qE "tree_note +there is room for a tree of about" "$work/out" &&
        grep -qE "photos_note +.*stay in memory" "$work/out"'
    echo max-leaves 262144 >"$s/cl-nascent.conf"
    expect "what a tree needs, and what is free" 0 "" "$cln" info "$s" --json
    if number_above "$(json training.host_memory_free)" "$(json training.host_memory_needed)"; then
        skip "plans beyond what is free" "memory has room for the largest"
        return
    fi
    expect "a tree beyond what is free now" 0 "" "$cln" info "$s"
    check "info names what is not" grep -qE \
        "free_note +.*free now, and .*: --host-mem [0-9]+M keeps" "$work/out"
    expect "training says it in a line" 0 "~memory:.of.*free.now,.*--host-mem.[0-9]+M" \
        "$cln" train "$s" -o "$work/beyond" --skip-selftest --progress none --steps 1 --rays 64
    expect "check does, too" 0 "" "$cln" check "$s" --probe 0
    check "with the option" eval 'tr -s " \n" " " <"$work/out" | grep -q "free now.*--host-mem"'
}

# The demo on a machine that makes a few steps in its time.
section_demo() {
    mkdir -p "$work/there/build"
    ln -s "$cln" "$work/there/build/cl-nascent"
    printf '#!/bin/sh\nexec "%s" "$1" --size 16 --train 4 --test 1\n' "$make_scene" \
        >"$work/there/build/make-scene"
    chmod +x "$work/there/build/make-scene"
    expect "the demo in a second" 0 "" env -C "$work/there" DEMO_TIME_LIMIT=1s "$here/tests/demo.sh"
    check "it says how little that is, and the way on" grep -qE \
        'made [0-9]+ steps in 1s, .* of 3,000; for more' "$work/out"
    check "the variable is named" printed "DEMO_TIME_LIMIT=20m make demo"
}

run_sections "killed short overfit barred slow doubtful exposure again requeued lost reused \
    anew moments rig links target points kept disk cache shared memory demo" "$@"
