#!/bin/bash
# The command line from end to end, on tiny generated scenes: what it prints, what it leaves behind,
# its exit codes, and that nothing is overwritten. Runs on any OpenCL device (PoCL is enough).
# training.sh has what trainings do.
#   tests/cli/cli.sh [SECTION...]      sections: usage devices scenes own names results
#                                      output
#   BUILD=build/sanitize               the programs to test
# Every check is one line of the count in the last line; the output of a failed one is shown.
set -u
cd "$(dirname "$0")/../.." || exit 1

# every path of every check has characters that shells and patterns take for something else
work=$(mktemp -d "${TMPDIR:-/tmp}/cln cli [*] (+) XXXXXX")
. tests/support/checks.sh
. tests/support/baseline.sh
trap 'end_children; chmod -R u+w "$work"; rm -rf "$work"' EXIT

same_tree() {
    diff -r "$1" "$2" >"$work/out" 2>&1
}

section_usage() {
    local c
    expect "--version" 0 "" "$cln" --version
    check "--version names the program" grep -q '^cl-nascent [0-9]' "$work/out"
    expect "help of an option" 0 "" "$cln" help --orbit
    check "help of an option is of that alone" eval \
        'printed "--orbit, of render:" && ! printed "--circle "'
    expect "help of a command's option" 0 "" "$cln" help eval --output
    check "help of a command's option is of that command" eval \
        'printed "RUN/eval" && ! printed "of train"'
    expect "help of two options" 2 "~one.option" "$cln" help train --lr --rays
    expect "an option in place of a command" 2 "~help.--orbit..tells" "$cln" orbit
    expect "threads" 2 "taskset" "$cln" train s -o r --threads 2
    expect "the size of a picture" 2 "~mean.--width[?]" "$cln" render r --size 800
    expect "a film" 2 "~render.RUN.*FILE.mp4" "$cln" film r
    expect "a map as TIFF" 2 "gdal_translate" "$cln" render r --map -o map.tif
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
# fenced WORD FILE: the block of docs/formats.md, "Your own poses", that begins with WORD
fenced() {
    awk -v word="$1" '/^## /{ in_it = /Your own poses/ } !in_it { next }
        /^```/ {
            open = !open
            if (!open && index(text, word) == 1) print text
            text = ""
            next
        }
        open { text = text (text == "" ? "" : "\n") $0 }' docs/formats.md >"$2"
    [ -s "$2" ]
}

# The program of the manual makes of the trajectory there the example there.
section_own() {
    local own=$work/own stamp
    mkdir -p "$own/rgb"
    check "formats.md has a program" fenced "import json" "$own/convert.py"
    check "and a trajectory" fenced "# timestamp" "$own/trajectory.txt"
    check "and the file" fenced "{" "$own/example.json"
    if ! command -v python3 >/dev/null; then
        skip "the program of formats.md" "there is no python3"
        return
    fi
    # 8 x 8 pixels, grey of 16 bits
    for stamp in 1305031102.175304 1305031102.275326; do
        base64 -d >"$own/rgb/$stamp.png" <<'END'
iVBORw0KGgoAAAANSUhEUgAAAAgAAAAIEAAAAACx9D0UAAAAEElEQVR4nGPg3oEKGQZGAADenDDBQ8H//gAAAABJRU
5ErkJggg==
END
    done
    sed 's/"w": 640.*/"fl_x": 10,/' "$own/example.json" >"$own/depths.json"
    expect "depth images in place of photos" 0 "~2.of.2.images.*grey.of.16.bits" \
        "$cln" info "$own/depths.json"
    rm "$own"/rgb/*
    check "the program runs" eval '(cd "$own" && python3 convert.py)'
    check "it makes the file" python3 - "$own/transforms.json" "$own/example.json" <<'END'
import json, sys

def same(a, b):
    if isinstance(a, dict):
        return a.keys() == b.keys() and all(same(a[k], b[k]) for k in a)
    if isinstance(a, list):
        return len(a) == len(b) and all(map(same, a, b))
    return a == b if isinstance(a, str) else abs(a - b) < 1e-6

sys.exit(not same(*(json.load(open(f)) for f in sys.argv[1:])))
END
}

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
        '<h1>run a [b] (c)+*&quot;q&#39; &lt;i&gt;&amp;amp; ü%41#?; <' "$r/report.html"
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
    expect "eval into a run" 2 "~holds.a.run.*of.its.own" "$cln" eval "$work/whole" -o "$work/whole"
    mkdir "$work/framed" && echo "{}" >"$work/framed/render.json"
    expect "or into frames" 2 "~holds.rendered.frames" "$cln" eval "$work/whole" -o "$work/framed"
    expect "eval --seams" 0 "" "$cln" eval "$work/whole" --seams --json -o "$work/seams"
    check "eval --seams has pairs" [ "$(json seams.across.pairs)" -gt 100 ]
    expect "eval --seams as a table" 0 "" "$cln" eval "$work/whole" --seams -o "$work/seams"
    check "the table of seams says where" grep -q "^from leaf to leaf" "$work/out"
    # shellcheck disable=SC2034 # eval reads it
    psnr=$("$query" mean.psnr <"$work/whole/eval/00000300-test.json")
    expect "eval --fast" 0 "" "$cln" eval "$work/whole" --fast --json
    check "eval --fast is marked as fast" [ "$(json fast)" = true ]
    check "eval --fast has its own file" [ -s "$work/whole/eval/00000300-test-fast.json" ]
    check "--fast: another picture, a little worse" eval '[ "$(json mean.psnr)" != "$psnr" ] &&
        number_above "$(json mean.psnr)" "$(awk -v p="$psnr" "BEGIN { print p - 0.5 }")"'
    expect "eval --background" 0 "" "$cln" eval "$work/whole" --background 0,0,0.4 --json
    check "eval --background has its own file" \
        [ -s "$work/whole/eval/00000300-test-over000066.json" ]
    check "the background is in it" \
        [ "$(json background.0) $(json background.2 | cut -c 1-3)" = "0 0.4" ]
    check "over another background renders and photos change alike" eval \
        'number_above "$(json mean.psnr)" "$(awk -v p="$psnr" "BEGIN { print p - 3 }")"'
    check "the photos lie over it" eval '! cmp -s "$work/whole/eval/00000300-test/r_000.truth.png" \
        "$work/whole/eval/00000300-test-over000066/r_000.truth.png"'
    expect "eval --background of the run's own" 0 "" "$cln" eval "$work/whole" --background white
    check "has no file of its own" [ ! -e "$work/whole/eval/00000300-test-overffffff.json" ]
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
    expect "--antialias 2 over existing frames" 7 "~1.of.these.frames ~other.settings --overwrite" \
        "$cln" render "$work/whole" --max-images 1 -o "$work/edges" --antialias 2
    check "the frame stays" cmp "$work/edges/test_r_000.png" "$work/one_ray.png"
    expect "--antialias 2 --overwrite" 0 "" "$cln" render "$work/whole" --max-images 1 \
        -o "$work/edges" --antialias 2 --overwrite --json
    check "--antialias renders the frame again" [ "$(json rendered)" = 1 ]
    check "antialias: other pixels" eval '! cmp -s "$work/edges/test_r_000.png" "$work/one_ray.png"'
    run "$cln" render "$work/whole" --max-images 1 -o "$work/fast"
    cp "$work/fast/test_r_000.png" "$work/slow.png"
    expect "render --fast over existing frames" 0 "" "$cln" render "$work/whole" --max-images 1 \
        -o "$work/fast" --fast --overwrite --json
    check "--fast renders the frame again" [ "$(json rendered)" = 1 ]
    check "fast: other pixels" eval '! cmp -s "$work/fast/test_r_000.png" "$work/slow.png"'
    cp "$work/edges/test_r_000.png" "$work/uncropped.png"
    expect "render --crop over existing frames" 0 "" "$cln" render "$work/whole" --max-images 1 \
        -o "$work/edges" --antialias 2 --crop -0.25,-9,-9,9,9,9 --overwrite --json
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
    expect "a closed half" 0 "" "$cln" export "$work/whole" --mesh "$work/half.ply" --closed \
        --crop=0,-1.5,-1.5,1.5,1.5,1.5 --json
    # 0.16, by the run's own clouds; with the cut face 0.20
    check "its cut face is not made up" number_above 0.18 "$(json unseen_share)"
    check "other parts are" number_above "$(json unseen_share)" 0.05
    expect "render --seen" 0 "" "$cln" render "$work/whole" --orbit 4 --elevation -80 \
        -o "$work/seen" --seen
    check "from below it shows what nobody saw" grep -qE \
        "^[1-9][0-9.]* % of what they show is seen by no training view" "$work/out"
    check "frame by frame" [ "$("$query" seen.orbit_0003.0 <"$work/seen/render.json" |
        cut -c -2)$(find "$work/seen" -name '*.seen.png' | wc -l)" = 0.4 ]
    cp "$work/out" "$work/seen.told"
    expect "frames that are there" 0 "" "$cln" render "$work/whole" --orbit 4 --elevation -80 \
        -o "$work/seen" --seen
    check "are told of, too" cmp -s <(grep "of what they" "$work/out") \
        <(grep "of what they" "$work/seen.told")
    # as where it was stopped before it was written
    sed -i '/^  "seen": {/,/^  },/d' "$work/seen/render.json"
    expect "without their shares" 0 "" "$cln" render "$work/whole" --orbit 4 --elevation -80 \
        -o "$work/seen" --seen
    check "their pictures tell them" cmp -s <(grep "of what they" "$work/out") \
        <(grep "of what they" "$work/seen.told")
    expect "a surface is no mean" 2 "--seen --depth" "$cln" render "$work/whole" --orbit 4 \
        -o "$work/none" --seen --depth mean
    expect "render --map" 0 "~map:.11.x.12.pixels.of.0.25 ~from.height.12.25" "$cln" \
        render "$work/whole" --map --spacing 0.25 --crop=-1.25,-1.5,-1,1.5,1.5,1.25 --seen \
        --offset=10.25,20,11 --json
    check "one picture" [ "$(json rendered)$(json out)" = "1$work/whole/render/map" ]
    check "its world file" [ "$(tr '\n' ' ' <"$work/whole/render/map/map.pgw")" = \
        "0.25 0 0 -0.25 9.125 21.375 " ]
    check "its grid" [ "$(awk 'NR < 6 { h = h $2 " " } NR > 6 && NF == 11 { n++ }
        END { print h n }' "$work/whole/render/map/map.height.asc")" = "11 12 9 18.5 0.25 12" ]
    check "render.json tells" [ "$("$query" map.corner.2 <"$work/whole/render/map/render.json")" = \
        12.25 ]
    expect "the same again" 0 "" "$cln" render "$work/whole" --map --spacing 0.25 \
        --crop=-1.25,-1.5,-1,1.5,1.5,1.25 --seen --offset=10.25,20,11 --json
    check "it stays" [ "$(json skipped)" = 1 ]
    expect "a map elsewhere replaces none" 7 "map --overwrite" "$cln" render "$work/whole" --map \
        --spacing 0.25 --crop=-1.25,-1.5,-1,1.5,1.5,1.25 --seen
    expect "a map of too many pixels" 2 "--spacing --crop" "$cln" render "$work/whole" --map \
        --spacing 1e-5 -o "$work/none"
    expect "render --normals" 0 "" "$cln" render "$work/whole" --max-images 1 \
        -o "$work/edges" --normals --overwrite
    check "render --normals leaves its files" [ -s "$work/edges/test_r_000.normal.png" -a \
        "$(stat -c %s "$work/edges/test_r_000.normal.npy")" = $((128 + 48 * 48 * 12)) ]
    expect "render --frames" 0 "" "$cln" render "$work/whole" --orbit 9 --frames 7- --transparent \
        --width 20 -o "$work/some" --json
    check "the last two, with alpha" [ "$(json rendered)" = 2 -a -s "$work/some/orbit_0008.png" -a \
        "$(od -An -tu1 -j25 -N1 "$work/some/orbit_0008.png")" -eq 6 ]
    for range in 3-2 -1 x 5--7 1-2-3 "" 99999999999; do
        expect "render --frames '$range'" 2 "--frames" "$cln" render "$work/whole" --orbit 9 \
            "--frames=$range"
    done
    expect "render --transparent to a film without alpha" 2 "--transparent: none.y4m .mov .webm" \
        "$cln" render "$work/whole" --orbit 9 --transparent -o "$work/none.y4m"
    if command -v ffmpeg >/dev/null; then
        for film in some.mov some.webm; do
            expect "render --transparent to $film" 0 "" "$cln" render "$work/whole" --orbit 9 \
                --frames 7- --transparent --width 20 -o "$work/$film"
        done
        check "ProRes has alpha" [ "$(ffprobe -v error -show_entries stream=codec_name,pix_fmt \
            -of csv=p=0 "$work/some.mov" | sed 's/p1[02]le$//')" = prores,yuva444 ]
        check "VP9 has alpha" grep -qi alpha_mode=1 \
            <(ffprobe -v error -show_entries stream_tags "$work/some.webm")
        grey=(-vf "alphaextract,format=gray" -f rawvideo -y)
        ffmpeg -v error -i "$work/some.mov" "${grey[@]}" "$work/film.grey"
        ffmpeg -v error -start_number 7 -i "$work/some/orbit_%04d.png" "${grey[@]}" "$work/png.grey"
        paste <(od -An -v -tu1 -w1 "$work/film.grey") <(od -An -v -tu1 -w1 "$work/png.grey") \
            >"$work/alphas"
        check "its alpha is that of the pictures, to the rounding" awk \
            '{ d = $1 - $2; far += d * d > 4 } END { exit NR != 2 * 20 * 20 || far > 0 }' \
            "$work/alphas"
    else
        skip "films with alpha" "no ffmpeg"
    fi
    expect "render --background" 0 "" "$cln" render "$work/whole" --orbit 1 --width 8 \
        --background 0,0.5,1 -o "$work/behind"
    check "render.json tells the background" [ \
        "$("$query" background.1 <"$work/behind/render.json")" = 0.5 ]
    expect "a background of no colour" 2 "--background: blue white" "$cln" render "$work/whole" \
        --orbit 1 --background blue
    expect "render --orbit" 0 "" "$cln" render "$work/whole" --orbit 2 --width 40 --height 30 \
        -o "$work/orbit" --json
    check "the orbit has two frames" [ "$(json rendered)" = 2 -a -s "$work/orbit/orbit_0001.png" ]
    run "$cln" export "$work/whole" --mesh "$work/print.stl"
    check "what a slicer wants of a mesh is told" grep -q "the mesh is open.* --closed" "$work/err"
    expect "up by the cameras, which is z here" 0 "" "$cln" export "$work/whole" --up auto \
        --mesh "$work/upright.stl"
    check "turns nothing, behind the record" cmp -i 80 "$work/print.stl" "$work/upright.stl"
    expect "another up" 0 "" "$cln" export "$work/whole" --up x --mesh "$work/turned.stl"
    check "does" eval '! cmp -s -i 80 "$work/print.stl" "$work/turned.stl"'
    expect "an orbit's cameras are poses" 0 "" "$cln" render "$work/whole" \
        --poses "$work/orbit/transforms.json" -o "$work/orbit again"
    check "which show the same" cmp "$work/orbit/orbit_0001.png" "$work/orbit again/orbit_0001.png"
    expect "render as PFM and 16-bit PNG" 0 "" "$cln" render "$work/whole" --max-images 1 \
        --pfm --depth-unit 0.001 -o "$work/depths"
    d=$work/depths/test_r_000
    check "PFM has npy's numbers, from the bottom up" [ \
        "$(tail -c 192 "$d.depth.pfm" | cksum)" = \
        "$(tail -c +129 "$d.depth.npy" | head -c 192 | cksum)" ]
    check "the PNG has 16 bits of grey" [ \
        "$(od -An -tu1 -j24 -N2 "$d.metric.png" | tr -s ' ')" = " 16 0" ]
    for range in 1 0 2; do # any order; the folder has them all
        expect "render in ranges: $range" 0 "" "$cln" render "$work/whole" --frames $range-$range \
            --bits 16 --transparent -o "$work/ranges"
    done
    check "the folder's cameras are those of all its pictures, in order" [ "$(for i in 0 1 2; do
        "$query" frames.$i.file_path <"$work/ranges/transforms.json"
    done | tr '\n' ' ')" = "test_r_000.png test_r_001.png test_r_002.png " ]
    check "render.json has them as they were rendered" [ "$(sed -n \
        's/^ *"test_r_00\([0-9]\)":.*/\1/p' "$work/ranges/render.json" | tr -d '\n')" = 102 ]
    check "RGBA of 16 bits" [ \
        "$(od -An -tu1 -j24 -N2 "$work/ranges/test_r_001.png" | tr -s ' ')" = " 16 6" ]
    expect "the same poses again, in 8 bits" 0 "" "$cln" render "$work/whole" --transparent \
        --poses "$work/ranges/transforms.json" -o "$work/bits8"
    expect "frames of other bits" 7 "settings" "$cln" render "$work/whole" -o "$work/ranges" \
        --transparent
    expect "a film of 16 bits" 2 "--bits film" "$cln" render "$work/whole" --orbit --bits 16 \
        -o "$work/deep.mp4"
    expect "poses that are no JSON" 3 "JSON camera_path.json" "$cln" render "$work/whole" \
        --poses "$work/depths/test_r_000.png" -o "$work/nothing"
    expect "render --spiral to a film" 0 "" "$cln" render "$work/whole" --spiral 2 --width 40 \
        --height 30 -o "$work/film.y4m" --fps 12 --json
    check "the film has that size and frame rate" \
        [ "$(head -1 "$work/film.y4m")" = "YUV4MPEG2 W40 H30 F12:1 Ip A1:1 C444" ]
    check "the film has two frames" [ "$(json rendered)$(grep -ac FRAME "$work/film.y4m")" = 22 ]
    for rate in 29.97 30000/1001; do
        expect "a film at $rate" 0 "" "$cln" render "$work/whole" --spiral 1 --width 8 \
            -o "$work/tv.y4m" --fps $rate --overwrite
        check "it has that rate" grep -aq "F30000:1001" "$work/tv.y4m"
    done
    expect "a rate that is none" 2 "~--fps.30/0 30000/1001" "$cln" render "$work/whole" --spiral 2 \
        -o "$work/slow.y4m" --fps 30/0
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
    expect "frames of another background are not those" 7 "~of.other.settings --overwrite" "$cln" \
        render "$work/whole" --split train --max-images 2 --width 40 -o "$work/ends" \
        --background 1,0,0
    expect "a path of another field of view" 0 "" "$cln" render "$work/whole" --split train \
        --max-images 2 --interpolate 3 --width 40 --fov 53.13010235 -o "$work/wide path" --json
    check "has it" eval '[[ $("$query" frames.1.fl_x <"$work/wide path/transforms.json") == \
        @(40|40.000*|39.9999*) ]]'
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
    expect "export of points" 0 "1,500 points" "$cln" export "$work/whole" --points - --count 1500
    check "the points are on standard output" grep -aqx "element vertex 1500" "$work/out"
    expect "export of the cameras, without any device" 0 "" env OCL_ICD_VENDORS="$work/nowhere" \
        "$cln" export "$work/whole" --cameras "$work/cameras" --json
    check "as many cameras as the scene has" [ "$(json cameras)" = \
        "$(grep -c '\.png$' "$work/cameras/images.txt")" ]
    expect "export of a copy" 0 "" "$cln" export "$work/whole" --copy "$work/copy" --json
    check "the copy's size is that of its model" [ "$(json bytes)" = \
        "$(stat -c %s "$work"/copy/checkpoint/*.safetensors)" ]
    check "it has a model, the cameras and what is known of the run" \
        [ "$(cd "$work/copy" && find . -type f | sort | tr '\n' ' ')" = \
        "./cameras.json ./checkpoint/00000300.json ./checkpoint/00000300.safetensors \
./checkpoint/latest ./run.json " ]
    check "it is smaller" [ "$(json bytes)" -lt \
        $(($(stat -c %s "$work/whole/checkpoint/00000300.safetensors") * 3 / 4)) ]
    for f in whole copy; do
        expect "a picture of the $f" 0 "" env -C / "$cln" render "$work/$f" --orbit --frames 1 \
            --width 32 -o "$work/picture-$f"
        expect "an evaluation of the $f" 0 "" "$cln" eval "$work/$f" -o "$work/eval-$f"
    done
    check "pictures of a copy have the run's bits" cmp -s "$work/picture-whole/orbit_0001.png" \
        "$work/picture-copy/orbit_0001.png"
    check "figures, too" [ "$("$query" mean.psnr <"$work/eval-whole/00000300-test.json")" = \
        "$("$query" mean.psnr <"$work/eval-copy/00000300-test.json")" ]
    mv "$work/blender" "$work/away"
    expect "a copy where the scene is gone" 0 "" "$cln" export "$work/whole" --copy "$work/copy3"
    expect "is rendered" 0 "" "$cln" render "$work/copy3" --orbit --frames 1 \
        --width 32 -o "$work/picture-3"
    mv "$work/away" "$work/blender"
    expect "an evaluation, with the scene back" 0 "" "$cln" eval "$work/copy3"
    expect "a copy without room" 7 "" sh -c 'ulimit -f 64; exec "$@"' sh "$cln" export \
        "$work/whole" --copy "$work/copy4"
    check "leaves nothing" [ ! -e "$work/copy4" ]
    expect "a copy of the copy" 0 "" "$cln" export "$work/copy" --copy "$work/copy2"
    check "it is the same" eval 'cmp -s "$work"/copy/checkpoint/*.safetensors \
        "$work"/copy2/checkpoint/*.safetensors'
    expect "a copy is no training" 8 "~no.state.of.training" "$cln" train --resume "$work/copy" \
        --steps +1
    expect "a copy takes a new folder" 7 "~already.exists" "$cln" export "$work/whole" \
        --copy "$work/copy"
    expect "a copy replaces nothing" 2 "--overwrite" "$cln" export "$work/whole" \
        --copy "$work/copy" --overwrite
    expect "a copy is a folder" 2 "--copy folder" "$cln" export "$work/whole" --copy -
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
    # no file may grow beyond 4 MiB, a checkpoint of the grown tree is larger
    start "$cln" train "$work/blender" -o "$work/full" "${small[@]}" --width 64 --view-width 64 \
        --start-level 1 --level-at 2:0.5 --cull-from 1 --steps 100000
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

run_sections "usage devices scenes own names results output" "$@"
