#!/bin/bash
# The command line from end to end, on tiny generated scenes: what it prints, what it leaves behind,
# its exit codes, and that nothing is lost. Runs on any OpenCL device (PoCL is enough).
#   tests/cli/cli.sh [SECTION...]      sections: usage devices scenes names train structure
#                                  resume results damage output memory
#   BUILD=build/sanitize           the programs to test
# Every check is one line of the count in the last line; the output of a failed one is shown.
set -u
cd "$(dirname "$0")/../.." || exit 1

BUILD=${BUILD:-build}
here=$PWD
cln=$here/$BUILD/cl-nascent
make_scene=$here/$BUILD/make-scene
# every path of every check has characters that shells and patterns take for something else
work=$(mktemp -d "${TMPDIR:-/tmp}/cln cli [*] (+) XXXXXX")
children="" child=0 whole=""
trap 'for c in $children; do kill -9 "$c" 2>/dev/null; done; chmod -R u+w "$work"; rm -rf "$work"' \
    EXIT

. tests/support/checks.sh

small=("${adapted[@]}")
steps=300

# ---- checks of its own ----

same_tree() {
    diff -r "$1" "$2" >"$work/out" 2>&1
}

# wait_for SECONDS COMMAND...: until it succeeds, while the child runs
wait_for() {
    local end=$((SECONDS + $1))
    shift
    until "$@" 2>/dev/null; do
        [ $SECONDS -lt $end ] && kill -0 "$child" 2>/dev/null || return 1
        sleep 0.02
    done
}

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

rows_of() {
    [ "$(wc -l <"$1/metrics.jsonl")" -ge "$2" ]
}

# Starts a command in the background with the signals of a fresh shell.
start() {
    env --default-signal=INT,QUIT "$@" >"$work/out" 2>"$work/err" &
    child=$!
    children="$children $child"
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

# ---- sections ----

section_usage() {
    local c
    expect "--version" 0 "" "$cln" --version
    check "--version names the program" grep -q '^cl-nascent [0-9]' "$work/out"
    expect "--help" 0 "" "$cln" --help
    for c in train eval render info export devices selftest tune; do
        check "--help names $c" grep -qw "$c" "$work/out"
    done
    for c in train eval render info export devices selftest tune; do
        expect "$c --help" 0 "" "$cln" $c --help
        check "$c --help goes to stdout alone" [ -s "$work/out" -a ! -s "$work/err" ]
    done
    expect "no command" 2 "" "$cln"
    expect "unknown command, with the nearest" 2 "trian train" "$cln" trian
    expect "unknown option, with the nearest" 2 "--stepz --steps" "$cln" train s -o r --stepz 5
    expect "value out of range" 2 "width 16" "$cln" train s -o r --width 3
    expect "value that is not a number" 2 "steps many" "$cln" train s -o r --steps many
    expect "word that is not a choice" 2 "loss l2" "$cln" train s -o r --loss l3
    expect "train without an output" 2 "~output|-o" "$cln" train s
    expect "eval without a run" 2 "RUN" "$cln" eval
    expect "export without a file" 2 "--octree" "$cln" export r
    expect "export in an unknown colour" 2 "colour level" "$cln" export r --octree f \
        --colour red
    expect "tune with a budget of 0" 2 "budget 1" "$cln" tune --budget 0
    expect "tune with an option of train" 2 "lr train" "$cln" tune --lr 1
    check "wrong usage leaves stdout empty" [ ! -s "$work/out" ]
}

section_devices() {
    expect "devices" 0 "" "$cln" devices
    check "devices prints a self-test" grep -qi 'self-test' "$work/out"
    expect "devices --json" 0 "" "$cln" devices --json
    check "devices --json is one document" [ "$(json schema)" = cl-nascent.devices/1 ]
    check "devices lists a device" [ -n "$(json devices.0.name)" ]
    check "the device's self-test passed" [ "$(json devices.0.verdict)" = ok ]
    check "the device's memory is a number" number_above "$(json devices.0.global_mem)" 1e6
    blender
    if grep -q '"gpu"' "$work/out"; then
        skip "-d gpu without a GPU" "there is one"
    else
        expect "-d gpu without a GPU" 4 "gpu" "$cln" train "$work/blender" -o "$work/gpu" -d gpu
        check "-d gpu wrote nothing" [ ! -e "$work/gpu" ]
    fi
    expect "-d nonsense" 4 "nonsense" "$cln" train "$work/blender" -o "$work/gpu" -d nonsense
    expect "a row number that does not exist" 4 "99" "$cln" selftest --quick -d 99
    expect "no OpenCL at all, with what to install" 4 "pocl-opencl-icd" \
        env OCL_ICD_VENDORS="$work/nowhere" "$cln" devices
    expect "selftest --quick" 0 "" "$cln" selftest --quick
    expect "selftest --quick --json" 0 "" "$cln" selftest --quick --json
    check "selftest --json is one document" json . >/dev/null
    mkdir -p "$work/kernels" && cp kernels/* include/device_abi.h "$work/kernels/"
    expect "--kernel-dir with the same kernels" 0 "" "$cln" selftest --quick \
        --kernel-dir "$work/kernels"
    sed -i 's/through = behind\[l\];/through *= 1.0f - alphas[l];/' "$work/kernels/composite.cl"
    expect "a bound that is missed at an extreme" 10 "~at.extremes:.composite:.opacity" \
        "$cln" selftest --extremes --quick --json --kernel-dir "$work/kernels"
    check "the missed bound is a row" eval '[ "$(json checks.1.name)" = "composite: opacity" ] &&
        [ "$(json checks.1.verdict)" = failed ]'
    check "beside bounds that hold" eval '[ "$(json failed)" -lt 20 ] &&
        number_above "$(json passed)" 40 && json checks.2.detail | grep -q "all finite"'
    cp kernels/composite.cl "$work/kernels/"
    echo 'this is no OpenCL;' >>"$work/kernels/mlp_forward.cl"
    expect "--kernel-dir with a broken kernel, with its log" 4 "mlp_forward.cl error" \
        "$cln" selftest --quick --kernel-dir "$work/kernels"
    expect "--kernel-dir that does not exist" 3 "$work/nowhere" \
        "$cln" selftest --quick --kernel-dir "$work/nowhere"
}

# Kernel parameters: the tuner's row, where parameters come from, and that wrong kernels are
# noticed.
# bad_scene NAME WORDS: $work/bad must be refused, by info and before train writes anything
bad_scene() {
    expect "$1" 3 "$2" "$cln" info "$work/bad"
    run "$cln" train "$work/bad" -o "$work/never" "${small[@]}" --steps 1
    check "$1: train writes nothing" [ $rc = 3 -a ! -e "$work/never" ]
    rm -rf "$work/bad" "$work/never"
    cp -r "$work/blender" "$work/bad"
}

section_scenes() {
    local train_json=$work/bad/transforms_train.json first
    blender
    scene again --size 48 --train 12 --test 3 --depth
    check "make-scene: same options, same bytes" same_tree "$work/blender" "$work/again"
    scene seed --size 48 --train 12 --test 3 --depth --seed 2
    check "make-scene: another seed, other pictures" \
        eval '! cmp -s "$work/blender/train/r_000.png" "$work/seed/train/r_000.png"'
    check "make-scene: depth beside each image" \
        [ "$(find "$work/blender" -name '*.depth.npy' | wc -l)" = 15 ]
    mkdir -p "$work/foreign" && echo keep >"$work/foreign/file"
    expect "make-scene: --from needs an object" 2 "object" \
        "$make_scene" "$work/x" --kind room --from cone
    "$make_scene" "$work/cone" --from cone --size 8 --train 6 --test 6 >/dev/null
    # cosines of the cameras' places with the cone's axis
    for split in train test; do
        for i in 0 1 2 3 4 5; do
            for row in 0 2; do
                "$query" frames.$i.transform_matrix.$row.3 <"$work/cone/transforms_$split.json"
            done | paste -s | awk '{ print (0.906 * $1 + 0.423 * $2) / 4.03 }'
        done | sort -g >"$work/cone.$split"
    done
    check "make-scene: training views in a cone of 40 degrees" \
        eval 'head -1 "$work/cone.train" | awk "{ exit !(\$1 > 0.766) }"'
    check "make-scene: test views beyond it" \
        eval 'head -1 "$work/cone.test" | awk "{ exit !(\$1 < 0.2) }"'
    expect "make-scene: a folder that is not its own" 7 "foreign" "$make_scene" "$work/foreign"
    check "make-scene: the foreign folder stays as it was" [ "$(ls "$work/foreign")" = file ]
    expect "make-scene: wrong usage" 2 "size" "$make_scene" "$work/x" --size 3

    expect "info of a Blender scene" 0 "" "$cln" info "$work/blender" --json
    check "info names the dialect blender" [ "$(json dialect)" = blender ]
    check "info leaves stderr to warnings" [ ! -s "$work/err" ]
    expect "info as text" 0 "" "$cln" info "$work/blender"
    check "info as text names the dialect" grep -q blender "$work/out"
    scene nerfstudio --format nerfstudio --distortion=-0.1,0.02,0.001,-0.001 --size 32 --train 6 \
        --val 1 --test 2
    expect "info of a distorted nerfstudio scene" 0 "" "$cln" info "$work/nerfstudio" --json
    check "info names the dialect nerfstudio" [ "$(json dialect)" = nerfstudio ]
    scene ngp --format ngp --kind room --size 32 --train 9 --test 0
    expect "info of an instant-ngp scene, by its file" 0 "" "$cln" info \
        "$work/ngp/transforms.json" --json
    check "info names the dialect instant-ngp" [ "$(json dialect)" = instant-ngp ]

    expect "missing scene" 3 "$work/nowhere" "$cln" info "$work/nowhere"
    expect "train on a missing scene" 3 "$work/nowhere" \
        "$cln" train "$work/nowhere" -o "$work/never" "${small[@]}" --steps 1
    check "train on a missing scene writes nothing" [ ! -e "$work/never" ]
    expect "options without effect" 0 "" "$cln" train "$work/blender" -o "$work/idle" \
        "${small[@]}" --steps 2 --skip --lr-final 1e-5 --lr-schedule step
    check "--skip without effect is said" grep -q -- \
        '--skip has no effect: .*--depth 6$' "$work/err"
    check "--lr-final without effect is said" grep -q -- '--lr-final has no effect: ' "$work/err"
    check "no other option without effect" [ "$(grep -c 'has no effect' "$work/err")" = 2 ]
    mkdir -p "$work/empty"
    expect "a folder without a scene" 3 "$work/empty" "$cln" info "$work/empty"

    rm -rf "$work/bad" && cp -r "$work/blender" "$work/bad"
    sed -i 's/"frames": \[/"frames": [,/' "$train_json"
    bad_scene "malformed JSON, with line and column" \
        "transforms_train.json ~line.[0-9]+ ~column.[0-9]+"
    head -c 300 "$work/blender/transforms_train.json" >"$train_json"
    bad_scene "truncated JSON" "transforms_train.json ~line.[0-9]+"
    first=$work/bad/train/r_003.png
    truncate -s 700 "$first"
    expect "truncated image" 3 "r_003.png" "$cln" train "$work/bad" -o "$work/never" "${small[@]}" \
        --steps 1 --missing fail
    check "truncated image: train writes nothing" [ ! -e "$work/never" ]
    rm "$work"/bad/train/r_00[345].png
    bad_scene "missing image" "r_003"
    : >"$first"
    expect "empty image" 3 "r_003.png" "$cln" info "$work/bad" --missing fail
    expect "one empty image of 15: left out" 0 "r_003 ~empty.file" "$cln" train "$work/bad" \
        -o "$work/never" "${small[@]}" --steps 1
    rm -rf "$work/bad" "$work/never"
    cp -r "$work/blender" "$work/bad"
    echo '{"camera_angle_x": 0.7, "frames": []}' >"$train_json"
    bad_scene "zero frames" "~training.view"
    echo '{"camera_angle_x": 0.7, "frames": [{"file_path": "./train/r_000", "transform_matrix":
        [[1,0,0,0],[0,1.2,0,0],[0,0,1,4],[0,0,0,1]]}]}' >"$train_json"
    bad_scene "non-rigid pose" "~r_000|frame ~rigid|rotation"
    echo '{"camera_angle_x": 0.7, "frames": [{"file_path": "./train/r_000", "transform_matrix":
        [[1,0,0,1e999],[0,1,0,0],[0,0,1,4],[0,0,0,1]]}]}' >"$train_json"
    bad_scene "pose that is not a number" "transforms_train.json"
    echo '{"camera_angle_x": 0.7, "frames": [{"file_path": "./train/r_000", "transform_matrix":
        [[1,0,0,0],[0,1,0,0],[0,0,1,-9],[0,0,0,1]]}]}' >"$train_json"
    bad_scene "no camera sees the cube" "camera"
    rm -rf "$work/bad"
}

# Names with characters that shells, grep -E, JSON, HTML and printf take for something else.
section_names() {
    local odd="a [b] (c)+*\"q' <i>&amp; ü%41#?;" view="r [0] (+)*\"'<b>&ü%d" s r name json_view \
        text words
    s="$work/scene $odd" r="$work/run $odd"
    scene tiny --size 32 --train 6 --test 2
    cp -r "$work/tiny" "$s"
    # two names that differ only behind a dot, which begins no extension
    mv "$s/test/r_000.png" "$s/test/$view.0001.png"
    mv "$s/test/r_001.png" "$s/test/$view.0002.png"
    json_view=${view//\"/\\\"}
    text=$(<"$s/transforms_test.json")
    printf '%s\n' "${text//"test/r_00"[01]/"test/$json_view.0001"}" |
        awk '/0001"/ && n++ { sub(/0001"/, "0002\"") } { print }' >"$s/transforms_test.json"
    name=$("$cln" devices --no-test --json | "$query" devices.0.name)
    expect "a scene, a run and images with odd names" 0 "" \
        "$cln" train "$s" -o "$r" "${small[@]}" --steps 3 --cull-from 1 -d "$name"
    check "the report's path is printed" grep -qF "$r/report.html" "$work/out"
    check "run.json keeps the scene's name" [ "$("$query" dataset.path <"$r/run.json")" = "$s" ]
    eval "words=($("$query" command <"$r/run.json"))"
    check "run.json's command can be typed again" [ "${words[2]}|${words[4]}|${words[-1]}" = \
        "$s|$r|$name" ]
    expect "part of a device's name selects it" 0 "" "$cln" train --resume "$r" --steps +1 \
        -d "${name:3}" \
        --skip-selftest --progress none
    expect "eval finds the scene" 0 "" "$cln" eval "$r" --json --progress none
    check "eval prints the images' names" [ "$(json images.0.name)|$(json images.1.name)" = \
        "test/$view.0001|test/$view.0002" ]
    check "each image has its own pictures" [ \
        "$(find "$r/eval/00000004-test" -name '*.truth.png' | wc -l)" = 2 ]
    check "pictures have the image's name" [ -s "$r/eval/00000004-test/test_$view.0002.error.png" ]
    check "the report has all images" \
        [ "$(grep -oE 'data:image/(png|jpeg)' "$r/report.html" | wc -l)" -ge 6 ]
    check "the report has the run's name, escaped" grep -qF \
        '<h1>run a [b] (c)+*&quot;q&#39; &lt;i&gt;&amp;amp; ü%41#?;<' "$r/report.html"
    check "the report has a view's name, escaped" grep -qF \
        '<b>test/r [0] (+)*&quot;&#39;&lt;b&gt;&amp;ü%d.0002</b>' "$r/report.html"
    check "the report has no name unescaped" eval '! grep -qF -e "<i>&" -e "<b>&" "$r/report.html"'
    expect "render" 0 "" "$cln" render "$r" --json --progress none
    check "render leaves frames of both views" [ -s "$r/render/test/test_$view.0001.depth.npy" -a \
        -s "$r/render/test/test_$view.0002.png" ]
    expect "info RUN" 0 "" "$cln" info "$r" --json
    check "info RUN --json keeps the run's name" [ "$(json run)" = "$r" ]
    expect "info SCENE" 0 "" "$cln" info "$s" --json
    check "info SCENE --json keeps the scene's name" [ "$(json folder)" = "$s" ]
    expect "export" 0 "" "$cln" export "$r" --octree "$work/$odd.ply"
    check "export leaves its file" [ -s "$work/$odd.ply" ]
    expect "a missing scene with an odd name" 3 "" "$cln" info "$s!"
    check "the missing scene is named in full" said "$s!"
    expect "a name that is not UTF-8" 2 "UTF-8" "$cln" train "$work/tiny" -o "$work/"$'l\xfc'
}

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
    local r=$work/stopped
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
    check "SIGINT: the training stopped early" is_another "$r"
    expect "resume" 0 "" "$cln" train --resume "$r" --skip-selftest --progress none
    check "interrupted and resumed = not interrupted" is_whole "$r"
    check "the resumed metrics have every step once" every_step_once "$r" $steps
    check "they tell the two processes apart" \
        [ "$(step_rows "$r" | "$query" -l from_step | sort -u | wc -l)" = 2 ]

    r=$work/terminated
    start "$cln" train "$work/blender" -o "$r" "${small[@]}" --steps $steps
    wait_for 60 rows_of "$r" 60
    kill -TERM "$child"
    finish
    check "SIGTERM: exit code 143" [ $rc = 143 ]
    expect "resume" 0 "" "$cln" train --resume "$r" --skip-selftest --progress none
    check "terminated and resumed = not interrupted" is_whole "$r"

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
    expect "resume with other moments" 8 "another --moments" \
        "$cln" train --resume "$work/longer" --skip-selftest --moments float32
}

section_results() {
    local frames leaves psnr
    baseline
    expect "eval" 0 "" "$cln" eval "$work/whole"
    check "eval prints a table with the names" grep -q 'r_002' "$work/out"
    expect "eval --json" 0 "" "$cln" eval "$work/whole" --json --progress none
    check "eval --json: schema" [ "$(json schema)" = cl-nascent.eval/1 ]
    check "eval --json: mean PSNR" number_above "$(json mean.psnr)" 14 # a constant: 10.3
    check "eval --json: mean SSIM" number_above "$(json mean.ssim)" 0.1
    check "eval --json: an object per image" [ "$(json images)" = "array 3" ]
    check "eval --json: names are kept" grep -q 'test/r_000' <<<"$(json images.0.name)"
    for key in psnr ssim mse seconds; do
        check "eval --json: images.2.$key" number_above "$(json "images.2.$key")" 0
    done
    check "eval --json: background" [ "$(json background)" = "array 3" ]
    check "eval --json: digest" [ "$(json model_digest)" = "${whole:-none}" ]
    # docs/formats.md: the file is the same document
    for key in schema tool model_digest step split color_space pixel_centre mean.psnr std.ssim \
        images.1.psnr_u8 mean.psnr_fitted; do
        check "eval --json and its file: $key" [ "$(json $key)" = \
            "$("$query" $key <"$work/whole/eval/00000300-test.json" || echo nothing)" ]
    done
    for f in .png .truth.png .error.png; do
        check "eval leaves NAME$f" [ -s "$work/whole/eval/00000300-test/test_r_001$f" ]
    done
    check "eval leaves pictures of the tree" \
        [ -s "$work/whole/eval/00000300-test/test_r_000.tree.png" ]
    check "tree.json says what the pictures show" [ \
        "$("$query" leaves <"$work/whole/eval/00000300-test/tree.json")" = \
        "$("$cln" info "$work/whole" --json | "$query" leaves)" ]
    check "the mean is the images' mean" awk -v m="$(json mean.psnr)" -v a="$(json images.0.psnr)" \
        -v b="$(json images.1.psnr)" -v c="$(json images.2.psnr)" \
        'BEGIN { d = m - (a + b + c) / 3; exit !(d < 1e-9 && d > -1e-9) }'
    expect "eval --split train --max-images 2" 0 "" "$cln" eval "$work/whole" --split train \
        --max-images 2 --json
    check "eval --max-images 2 has two images" [ "$(json images)" = "array 2" ]
    expect "eval --antialias 2" 0 "" "$cln" eval "$work/whole" --antialias 2 --json
    check "eval --antialias 2 names its rays" [ "$(json antialias)" = 2 ]
    check "--antialias 2 has its own file" [ -s "$work/whole/eval/00000300-test-antialias2.json" ]
    check "the plain evaluation's file has no antialias" \
        eval '! grep -q antialias "$work/whole/eval/00000300-test.json"'
    expect "eval --seams" 0 "" "$cln" eval "$work/whole" --seams --json -o "$work/seams"
    check "eval --seams has pairs" [ "$(json seams.across.pairs)" -gt 100 ]
    expect "eval --seams as a table" 0 "" "$cln" eval "$work/whole" --seams -o "$work/seams"
    check "the table of seams says where" grep -q "^from leaf to leaf" "$work/out"
    psnr=$("$query" mean.psnr <"$work/whole/eval/00000300-test.json")
    expect "eval --fast" 0 "" "$cln" eval "$work/whole" --fast --json
    check "eval --fast is marked as fast" [ "$(json fast)" = true ]
    check "eval --fast has its own file" [ -s "$work/whole/eval/00000300-test-fast.json" ]
    check "--fast: another picture, a little worse" eval '[ "$(json mean.psnr)" != "$psnr" ] &&
        number_above "$(json mean.psnr)" "$(awk -v p="$psnr" "BEGIN { print p - 0.5 }")"'
    expect "eval --min-psnr" 9 "psnr" "$cln" eval "$work/whole" --min-psnr 90
    expect "eval of a missing split" 3 "val" "$cln" eval "$work/whole" --split val
    mv "$work/blender" "$work/moved"
    expect "eval without the scene" 3 "blender --scene" "$cln" eval "$work/whole"
    expect "eval --scene" 0 "" "$cln" eval "$work/whole" --scene "$work/moved"
    mv "$work/moved" "$work/blender"

    expect "render" 0 "" "$cln" render "$work/whole" --json --progress none
    check "render rendered the split" [ "$(json rendered)" = 3 ]
    frames=$work/whole/render/test
    for f in .png .depth.npy .depth.png .opacity.png; do
        check "render leaves NAME$f" [ -s "$frames/test_r_001$f" ]
    done
    cp -r "$frames" "$work/frames"
    expect "render again" 0 "" "$cln" render "$work/whole" --json
    check "render again skips existing frames" [ "$(json rendered)$(json skipped)" = 03 ]
    rm "$frames/test_r_001.png"
    expect "render with a frame missing" 0 "" "$cln" render "$work/whole" --json
    check "only the missing frame is rendered" [ "$(json rendered)$(json skipped)" = 12 ]
    check "the frame has the same bits" same_tree "$frames" "$work/frames"
    expect "render --overwrite" 0 "" "$cln" render "$work/whole" --overwrite --json
    check "--overwrite renders all frames" [ "$(json rendered)$(json skipped)" = 30 ]
    check "all frames have the same bits" same_tree "$frames" "$work/frames"
    run "$cln" render "$work/whole" --max-images 1 -o "$work/edges"
    cp "$work/edges/test_r_000.png" "$work/one_ray.png"
    expect "--antialias 2 over existing frames" 0 "" "$cln" render "$work/whole" --max-images 1 \
        -o "$work/edges" --antialias 2 --json
    check "--antialias renders the frame again" [ "$(json rendered)" = 1 ]
    check "antialias: other pixels" eval '! cmp -s "$work/edges/test_r_000.png" "$work/one_ray.png"'
    run "$cln" render "$work/whole" --max-images 1 -o "$work/fast"
    cp "$work/fast/test_r_000.png" "$work/slow.png"
    expect "render --fast over existing frames" 0 "" "$cln" render "$work/whole" --max-images 1 \
        -o "$work/fast" --fast --json
    check "--fast renders the frame again" [ "$(json rendered)" = 1 ]
    check "fast: other pixels" eval '! cmp -s "$work/fast/test_r_000.png" "$work/slow.png"'
    cp "$work/edges/test_r_000.png" "$work/uncropped.png"
    expect "render --crop over existing frames" 0 "" "$cln" render "$work/whole" --max-images 1 \
        -o "$work/edges" --antialias 2 --crop -0.25,-9,-9,9,9,9 --json
    check "--crop renders the frame again" [ "$(json rendered)" = 1 ]
    check "crop: other pixels" eval '! cmp -s "$work/edges/test_r_000.png" "$work/uncropped.png"'
    check "render.json tells the box" [ "$("$query" crop.0 <"$work/edges/render.json")" = -0.25 ]
    expect "render --crop with five numbers" 2 "--crop six" "$cln" render "$work/whole" \
        --crop 0,0,0,1,1
    expect "render --crop with an empty box" 2 "--crop along y" "$cln" render "$work/whole" \
        --crop 0,2,0,1,1,1
    expect "render --stereo" 0 "" "$cln" render "$work/whole" --max-images 1 \
        -o "$work/stereo.y4m" --stereo 0.2 --json
    check "a film of pairs" [ "$(head -1 "$work/stereo.y4m" | cut -d' ' -f2,3)" = "W96 H48" ]
    expect "render --normals" 0 "" "$cln" render "$work/whole" --max-images 1 \
        -o "$work/edges" --normals
    check "render --normals leaves its files" [ -s "$work/edges/test_r_000.normal.png" -a \
        "$(stat -c %s "$work/edges/test_r_000.normal.npy")" = $((128 + 48 * 48 * 12)) ]
    expect "render --orbit" 0 "" "$cln" render "$work/whole" --orbit 2 --width 40 --height 30 \
        -o "$work/orbit" --json
    check "the orbit has two frames" [ "$(json rendered)" = 2 -a -s "$work/orbit/orbit_0001.png" ]
    expect "render as PFM and 16-bit PNG" 0 "" "$cln" render "$work/whole" --max-images 1 \
        --pfm --depth-unit 0.001 -o "$work/depths"
    d=$work/depths/test_r_000
    check "PFM has npy's numbers, from the bottom up" [ \
        "$(tail -c 192 "$d.depth.pfm" | cksum)" = \
        "$(tail -c +129 "$d.depth.npy" | head -c 192 | cksum)" ]
    check "the PNG has 16 bits of grey" [ \
        "$(od -An -tu1 -j24 -N2 "$d.depth16.png" | tr -s ' ')" = " 16 0" ]
    expect "render --spiral to a film" 0 "" "$cln" render "$work/whole" --spiral 2 --width 40 \
        --height 30 -o "$work/film.y4m" --fps 12 --json
    check "the film has that size and frame rate" \
        [ "$(head -1 "$work/film.y4m")" = "YUV4MPEG2 W40 H30 F12000:1000 Ip A1:1 C444" ]
    check "the film has two frames" [ "$(json rendered)$(grep -ac FRAME "$work/film.y4m")" = 22 ]
    expect "a film too slow for its format" 2 "fps 0.001" "$cln" render "$work/whole" --spiral 2 \
        -o "$work/slow.y4m" --fps 0.0003
    expect "both eyes larger than a picture may be" 2 "~stereo ~both.eyes width" "$cln" render \
        "$work/whole" --orbit 1 --width 16384 --height 8193 --stereo 0.1 -o "$work/wide.y4m"
    check "neither film is begun" [ ! -e "$work/slow.y4m" -a ! -e "$work/wide.y4m" ]
    expect "an existing film stays" 7 "film.y4m --overwrite" "$cln" render "$work/whole" \
        --spiral 2 -o "$work/film.y4m"
    expect "render --interpolate" 0 "" "$cln" render "$work/whole" --split train --max-images 2 \
        --interpolate 3 --width 40 -o "$work/path" --json
    check "the path has three frames" [ "$(json rendered)" = 3 -a -s "$work/path/path_0002.png" ]
    run "$cln" render "$work/whole" --split train --max-images 2 --width 40 -o "$work/ends"
    check "the path begins with the first pose" cmp -s "$work/path/path_0000.png" \
        "$work/ends/train_r_000.png"
    expect "eval of a folder that is not a run" 3 "blender" "$cln" eval "$work/blender"

    expect "export, without any device" 0 "" env OCL_ICD_VENDORS="$work/nowhere" \
        "$cln" export "$work/whole" --octree "$work/tree.ply" --json
    check "export --json is one document" [ "$(json schema)" = cl-nascent.export/1 ]
    leaves=$(json leaves)
    check "export has the run's leaves" [ "$leaves" = \
        "$("$cln" info "$work/whole" --json | "$query" leaves)" ]
    check "export counts nine levels" [ "$(json levels)" = "array 9" ]
    check "the file is PLY with eight vertices a leaf" \
        grep -aqx "element vertex $((8 * leaves))" "$work/tree.ply"
    check "the file is as long as it should be" [ "$(stat -c %s "$work/tree.ply")" = \
        $(($(sed '/^end_header$/q' "$work/tree.ply" | wc -c) + leaves * (8 * 20 + 6 * 17))) ]
    cp "$work/tree.ply" "$work/before.ply"
    expect "export to an existing file" 7 "tree.ply --overwrite" \
        "$cln" export "$work/whole" --octree "$work/tree.ply" --colour error
    check "the existing file stays as it was" cmp -s "$work/tree.ply" "$work/before.ply"
    expect "export --overwrite" 0 "" "$cln" export "$work/whole" --octree "$work/tree.ply" \
        --overwrite
    check "export says how many leaves" grep -q "leaves" "$work/out"
    check "same model, same bytes" cmp -s "$work/tree.ply" "$work/before.ply"
    expect "export by error" 0 "" \
        "$cln" export "$work/whole" --octree "$work/tree.ply" --colour error --overwrite
    check "the file names the colouring" grep -aq "coloured by error" "$work/tree.ply"
    expect "export of points" 0 "1,500 points ~.x.*.x.*.units,.in.the.scene's.frame.within.-" "$cln" export "$work/whole" --points - --count 1500
    check "the points are on standard output" grep -aqx "element vertex 1500" "$work/out"
    expect "export of the cameras, without any device" 0 "" env OCL_ICD_VENDORS="$work/nowhere" \
        "$cln" export "$work/whole" --cameras "$work/cameras" --json
    check "as many cameras as the scene has" [ "$(json cameras)" = \
        "$(grep -c '\.png$' "$work/cameras/images.txt")" ]
    expect "a volume is two files" 2 "--volume" "$cln" export "$work/whole" --volume -
    expect "export of a folder that is not a run" 3 "blender" "$cln" export "$work/blender" \
        --octree "$work/none.ply"
    expect "export of a missing run" 3 "nowhere" \
        "$cln" export "$work/nowhere" --octree "$work/none.ply"
    check "failed exports write nothing" [ ! -e "$work/none.ply" ]
    expect "info RUN" 0 "" "$cln" info "$work/whole"
    check "info RUN tells the digest" grep -q "${whole:-none}" "$work/out"
    check "the report holds pictures and refers to nothing outside" eval \
        'grep -qE "data:image/(png|jpeg)" "$work/whole/report.html" &&
         ! grep -qE "(src|href)=[\"'"'"']?https?:" "$work/whole/report.html"'
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

# read_only FOLDER COMMAND...: root may write anywhere but in a mount that nobody may write to
read_only() {
    [ "$(id -u)" = 0 ] || { chmod -R a-w "$1" && "${@:2}"; return; }
    unshare -m sh -c 'mount --bind "$0" "$0" && mount -o remount,ro,bind "$0" && exec "$@"' "$@"
}

section_output() {
    local before
    baseline
    mkdir -p "$work/foreign" && echo keep >"$work/foreign/file"
    expect "output to a foreign folder" 7 "foreign" \
        "$cln" train "$work/blender" -o "$work/foreign" "${small[@]}" --steps 1
    check "that folder stays" [ "$(ls "$work/foreign")$(cat "$work/foreign/file")" = filekeep ]
    before=$(cd "$work/whole" && find . -type f -exec md5sum {} + | sort)
    expect "an existing run, without --resume" 7 "--resume" \
        "$cln" train "$work/blender" -o "$work/whole" "${small[@]}" --steps 1
    check "the existing run stays as it was" [ \
        "$(cd "$work/whole" && find . -type f -exec md5sum {} + | sort)" = "$before" ]
    expect "output under a file" 7 "file" \
        "$cln" train "$work/blender" -o "$work/foreign/file/run" "${small[@]}" --steps 1
    expect "output under a device" 7 "/dev/full" \
        "$cln" train "$work/blender" -o /dev/full/run "${small[@]}" --steps 1
    mkdir "$work/readonly" && cp -r "$work/whole" "$work/readonly/run"
    if read_only "$work/readonly" true 2>/dev/null; then
        expect "output in a read-only folder" 7 "readonly" read_only "$work/readonly" \
            "$cln" train "$work/blender" -o "$work/readonly/new" "${small[@]}" --steps 1
        expect "a read-only run goes on" 7 "readonly/run" read_only "$work/readonly" \
            "$cln" train --resume "$work/readonly/run" --skip-selftest --steps +1
        expect "its figures, and what could not be written" 7 "eval -o" read_only \
            "$work/readonly" "$cln" eval "$work/readonly/run" --no-save-images --json
        check "the figures are there" number_above "$(json mean.psnr)" 1
        expect "its pictures go elsewhere" 0 "" read_only "$work/readonly" \
            "$cln" render "$work/readonly/run" -o "$work/readonly views" --max-images 1
    else
        skip "output in a read-only folder" "root may write there, and nothing can be mounted"
    fi
    # no file may grow beyond 4 MiB, a checkpoint of this network is larger
    start "$cln" train "$work/blender" -o "$work/full" "${small[@]}" --width 64 --view-width 64 \
        --start-level 2 --level-at "" --cull-from 1 --steps 100000
    wait_for 120 rows_of "$work/full" 5
    kill -INT "$child"
    finish
    before=$(digest "$work/full")
    expect "full disk" 7 "checkpoint" bash -c "trap '' XFSZ; ulimit -f 4096
        exec \"\$@\"" full "$cln" train --resume "$work/full" --skip-selftest --progress none \
        --steps 200
    check "the checkpoint before it is intact" [ "$(digest "$work/full")" = "${before:-none}" ]
    check "nothing half-written is left" [ -z "$(find "$work/full" -name '*.tmp*')" ]
    expect "with room again, the training resumes" 0 "" \
        "$cln" train --resume "$work/full" --skip-selftest --progress none --steps 200 --json
    check "it trains to its end" [ "$(json step)" = 200 ]
    expect "stdout that cannot be written" 7 "" bash -c 'exec "$@" >/dev/full' full "$cln" info \
        "$work/whole" --json
}

section_memory() {
    local r limit psnr whole_peak frames i
    blender
    expect "too little device memory: the plan is printed" 5 \
        "device-mem ~[0-9](\.[0-9])?.?(MiB|KiB|GiB)" \
        "$cln" train "$work/blender" -o "$work/never" --skip-selftest --steps 1 --device-mem 1M
    check "too little device memory: nothing is written" [ ! -e "$work/never" ]
    expect "too little host memory to read an image" 5 "--host-mem ~smaller.copies" \
        "$cln" train "$work/blender" -o "$work/never" --skip-selftest --steps 1 --host-mem 20K
    expect "too little host memory for the rest: the plan is printed" 5 "--host-mem ~images.[0-9]" \
        "$cln" train "$work/blender" -o "$work/never" --skip-selftest --steps 1 --host-mem 200M
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
    check "photos beyond the rest go to a file" grep -q "pixels go to a file" "$work/err"
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
    check "the peak is below the limit" number_above "$limit" "$(json device_peak)"
    run "$cln" train "$work/blender" -o "$work/few" "${small[@]}" --steps 1 --level-at ""
    limit=$(awk -v a="$("$query" plan.total <"$work/few/run.json")" \
        'BEGIN { printf "%.0f", a + 1e6 }')
    run "$cln" train "$work/blender" -o "$work/more" "${small[@]}" --steps 60 --level-at "" \
        --cull-from 1 --device-mem "$limit" --max-leaves 4000 --json
    check "the integer program trains on" [ "$(json state)" = "done" ]
    check "its peak is below the limit" number_above "$limit" "$(json device_peak)"
    check "its budget of leaves is smaller" eval \
        'decision_rows "$work/more" | "$query" -l budget | awk "\$1 >= 4000 { bad = 1 }
            END { exit bad || !NR }"'

    # batches cut by a small largest buffer: as good, and pictures the same
    train buffers --no-adaptive --leaf-samples 0 --json
    psnr=$(json psnr_test)
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

all="usage devices scenes names train structure regrow resume results damage output memory"
run_sections "$all" "$@"
