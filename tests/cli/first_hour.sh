#!/bin/bash
# What a new user does in the first hour, and what they trip over: habits of other programs, odd
# terminals, second tries. On tiny scenes and short trainings; odd_places.sh has odd folders and
# names, cli.sh the rest.
#   tests/cli/first_hour.sh [SECTION...]      sections: words scenes training voxels results
#   BUILD=build/sanitize                   the programs to test
set -u
cd "$(dirname "$0")/../.." || exit 1

work=$(mktemp -d "${TMPDIR:-/tmp}/cln hour XXXXXX")
trap 'rm -rf "$work"' EXIT

. tests/support/checks.sh

plain=(--skip-selftest --progress line) # for a resumed run, which keeps its settings
small=("${grown[@]}" "${plain[@]}")

# ---- sections ----

# Command lines as people type them.
section_words() {
    local c
    expect "cl-nascent version" 0 "" "$cln" version
    check "version prints the version" grep -q '^cl-nascent [0-9]' "$work/out"
    expect "version -v" 0 "" "$cln" version -v
    check "version -v names the libraries" printed jansson
    check "version -v names the commit" grep -qx "commit $(cat "$BUILD/commit")" "$work/out"
    check "version -v names optional libraries" \
        grep -qE '^built with(out)? libmicrohttpd .*meshoptimizer' \
        "$work/out"
    expect "one of two processes, without MPI" 3 "~built.without.MPI ~make.MPI=1" \
        env OMPI_COMM_WORLD_SIZE=2 "$cln" info "$work/none"
    expect "version with an extra word" 2 "foo" "$cln" version foo
    expect "an abbreviation" 2 "--time-limit" "$cln" train s -o r --time 5
    expect "an abbreviation of several" 2 "~mean.--max-alloc,.--max-images[?]" \
        "$cln" eval r --max 2
    expect "layers, as other programs have them" 2 "~mean.--depth[?]" \
        "$cln" train s -o r --layers 3
    expect "a batch, as other programs have it" 2 "~mean.--rays[?]" \
        "$cln" train s -o r --batch 300
    expect "--no- of a flag that is off by default" 2 "--no-json ~off.unless" \
        "$cln" train s -o r --no-json
    expect "--no- of an option with a value" 2 "--no-steps ~give.it.a.value" \
        "$cln" train s -o r --no-steps
    expect "an off switch with a value" 2 "--no-adaptive ~takes.no.value" \
        "$cln" train s -o r --no-adaptive=true
    expect "a number of steps with an exponent" 3 "nowhere" \
        "$cln" train "$work/nowhere" -o "$work/r" --steps 2e4
    for c in "train s" "render r" "eval r" "check s"; do
        # shellcheck disable=SC2086 # two words
        expect "${c% *} to standard output" 2 "~-o.-: ~name.a.file.or.folder" "$cln" $c -o -
    done
    expect "one dash too few" 2 "--steps ~two.dashes" "$cln" train s -o r -steps 5
    expect "a wrong time in clock form" 2 "1:75 1:30" "$cln" train s -o r --time-limit 1:75
    for c in train render tune; do
        expect "$c --help" 0 "" "$cln" $c --help
        check "$c --help: -o has one meaning" eval \
            '! sed -n "/--output/,/^  [^ ]/p" "$work/out" | grep -qE "train:|tune:|render:"'
    done
    for c in eval export check; do
        expect "$c --help" 0 "" "$cln" $c --help
        check "$c --help: nothing about render" eval \
            '! grep -qE "(render: |render skips)" "$work/out"'
    done
    expect "completion without a shell: which there are" 2 "bash|zsh|fish" "$cln" completion
    expect "a command with dashes" 2 "~cl-nascent.train" "$cln" --train s -o r
    expect "a mistyped option, no command" 2 "~did.you.mean.--version" "$cln" --verion
    expect "another, with one dash" 2 "~did.you.mean.--help" "$cln" -hlep
    expect "a mistyped command with dashes" 2 "~cl-nascent.train" "$cln" --trian
    expect "an option before the command" 2 "~after.the.command" "$cln" --quiet train
    check "an option that is known has no suggestion" not_said "did you mean"
    expect "--o for -o" 2 "~did.you.mean.-o" "$cln" train s --o r
    expect "a name like no command" 2 "me" "$cln" me
    check "a name like no command has no suggestion" not_said "did you mean"
    (cd "$work" && touch -- -dash)
    expect "a name that begins with a dash" 2 "./-dash" \
        bash -c 'cd "$1" && exec "$2" info -dash' - "$work" "$cln"
    expect "a name that begins with a dash, in train" 2 "./-dash" \
        bash -c 'cd "$1" && exec "$2" train -dash -o r' - "$work" "$cln"
    expect "iterations, as other programs have it" 2 "--iterations --steps" \
        "$cln" train s -o r --iterations 5
    expect "auto-resume, as other programs have it" 2 "~mean.--resume-or-start[?]" \
        "$cln" train s -o r --auto-resume
    expect "a near plane" 2 "~mean.--near[?]" "$cln" train s -o r --near-plane 0.1
    expect "batch_size" 2 "--rays" "$cln" train s -o r --batch_size 5
    expect "the scene as an option" 2 "~SCENE.needs.none.*train.SCENE" "$cln" train --data s
    expect "--scene of a run that is resumed" 2 "~SCENE.needs.none.*train.--resume.RUN.SCENE" \
        "$cln" train --resume r --scene s
    expect "--scene of info" 2 "~SCENE.needs.none.*info.SCENE" "$cln" info --scene s
    expect "the run as an option" 2 "~RUN.needs.none.*eval.RUN" "$cln" eval --model_path r
    expect "the output as --model_path" 2 "--output" "$cln" train s --model_path r
    expect "an output without -o" 2 "-o" "$cln" train s r
    expect "an export without an option" 2 "~such.as.--mesh" "$cln" export r x.glb
    expect "a path of poses, as other programs call it" 2 "~mean.--interpolate[?]" \
        "$cln" render r --path 60
    expect "a folder in place of a command" 2 "~command.comes.first train" "$cln" "$work"
    expect "--help" 0 "" "$cln" --help
    check "commands and purposes are apart" eval '! grep -qE "^  [a-z]+[A-Z]" "$work/out"'
    expect "an empty name of a scene" 2 "~SCENE.*is.empty" "$cln" info ""
    expect "--help before the command" 0 "" "$cln" --help train
    check "it is the command's help" printed "cl-nascent train SCENE"
    expect "help about help" 0 "" "$cln" help help
    expect "help about the version" 0 "" "$cln" help version
    expect "options after and before, with = and space" 2 "o2" \
        "$cln" render --split=test r --width 3 -oout o2
    expect "a number of frames that is not whole" 2 "~--orbit:.*2.5.*whole" \
        "$cln" render r --orbit 2.5
    mkdir -p "$work/2024-11-25"
    expect "a run named like a number, behind --orbit" 3 "2024-11-25" \
        bash -c 'cd "$1" && exec "$2" render --orbit 2024-11-25' - "$work" "$cln"
    expect "errors without colour off a terminal" 2 "" "$cln" trian
    check "no colour off a terminal" not_said $'\033'
    expect "--color always" 2 "" "$cln" train --color always
    check "the program's name is in colour" said $'\033[1;31mcl-nascent:'
    on_terminal 80 "$cln" train
    check "colour on a terminal" grep -qF $'\033[1;31m' "$work/out"
    on_terminal 80 env NO_COLOR=1 "$cln" train
    check "no colour with NO_COLOR" eval '! grep -qF $'"'\\033'"' "$work/out"'
    on_terminal 80 env TERM=dumb "$cln" train
    check "no colour with TERM=dumb" eval '! grep -qF $'"'\\033'"' "$work/out"'
    expect "bugreport" 0 "sent" env CL_NASCENT_TOKEN=secret CL_NASCENT_PROGRESS=none \
        "$cln" bugreport --no-test
    check "bugreport has the variables" printed "CL_NASCENT_PROGRESS=none"
    check "but not the viewer's token" eval '! printed secret'
    check "bugreport has the devices" grep -qE "^ 0  " "$work/out"
    check "bugreport has the version" printed "cl-nascent $("$cln" version | cut -d' ' -f2)"
    check "bugreport names the compiler" grep -qiE "compiled by .*(gcc|clang)" "$work/out"
    "$cln" bugreport --no-test >"$work/both" 2>&1
    check "bugreport into one file: the advice is last" eval \
        '[ "$(grep -n "^Nothing was sent" "$work/both" | cut -d: -f1)" -gt "$(grep -n "^OpenCL" \
        "$work/both" | cut -d: -f1)" ] && ! sed "1,/^Nothing was sent/d" "$work/both" |
        grep -q "^ 0 "'
    expect "a run is missing: how to give it" 2 "~missing:.*cl-nascent.eval.RUN" "$cln" eval
    expect "bugreport of a missing run" 0 "" env OCL_ICD_VENDORS="$work/none" "$cln" bugreport \
        "$work/none"
    check "it says that the run is missing" printed "no such folder"
    check "it says that there is no device" printed pocl-opencl-icd
}

# What lies at a path, and settings beside a scene.
section_scenes() {
    local s=$work/scene conf=$work/scene/cl-nascent.conf c
    local tree=(--preset fast --width 16 --depth 2 --view-width 16 --start-level 1 --level-at 2:0.4
        --max-leaves 80)
    "$make_scene" "$s" --size 32 --train 6 --test 3 >/dev/null
    printf '%s\n' '# settings of this scene' 'eval-images = 2' '  --rays=512  # few' no-skip \
        'background "black"' >"$conf"
    expect "info with cl-nascent.conf beside the scene" 0 "$conf ~background.black" "$cln" info "$s"
    check "info says what a training would read" said "rays 512"
    echo 'steps 7' >>"$conf"
    expect "info with steps in the conf" 0 "~steps.7" "$cln" info "$s" --json
    check "info has the conf's steps" [ "$(json training.steps)" = 7 ]
    sed -i '$s/.*/time-limit 90s/' "$conf"
    expect "info with a time limit in the conf" 0 "~time-limit.90" "$cln" info "$s"
    check "info has the conf's time limit" grep -qE "^  training_seconds +about 01:30$" "$work/out"
    sed -i '$d' "$conf"
    expect "--no-conf" 0 "" "$cln" info "$s" --no-conf
    check "--no-conf reads nothing" eval '! grep -qv "photos around" "$work/err"'
    echo 'rayz 3' >>"$conf"
    expect "an unknown name, with file and line" 3 "cl-nascent.conf ~line.6 rayz rays" \
        "$cln" info "$s"
    printf 'no\033[31mname 3\n' >"$conf"
    expect "garbage" 3 "~line.1 ~no.such.setting" "$cln" info "$s"
    check "no suggestion for garbage" not_said "did you mean"
    check "control characters are not repeated" not_said $'\033'
    printf '%s\n' 'width 64' 'preset fast' >"$conf"
    expect "a preset in the conf, behind a setting" 0 "~preset.fast,.width.64" \
        "$cln" info "$s" --json
    check "a training would have it" [ "$(json training.preset)" = fast ]
    expect "--preset goes before it" 0 "~conf:.width.64$" "$cln" info "$s" --preset paper --json
    check "a training would have that" [ "$(json training.preset)" = paper ]
    expect "train with it, and a width of its own" 0 "~preset.fast" "$cln" train "$s" \
        -o "$work/chosen" --skip-selftest "${tree[@]:2}" --steps 1
    check "run.json names the conf's preset" \
        [ "$("$query" preset <"$work/chosen/run.json")" = fast ]
    check "its own width counts" [ "$("$query" config.width <"$work/chosen/run.json")" = 16 ]
    expect "the conf's preset on --resume: the run keeps its own" 0 "" "$cln" train \
        --resume "$work/chosen" --skip-selftest --steps +1
    echo 'preset quick' >"$conf"
    expect "a wrong preset" 3 "~line.1 quick voxel|fast" "$cln" info "$s"
    echo 'preset' >"$conf"
    expect "a preset without a name" 3 "~line.1 ~has.no.value voxel|fast" "$cln" info "$s"
    echo 'rays many' >"$conf"
    expect "a wrong value" 3 "~line.1 rays many" \
        "$cln" train "$s/transforms_train.json" -o "$work/r"
    echo 'background "#fff"' >"$conf"
    expect "a wrong text: its file is named" 2 "--background $conf" "$cln" info "$s"
    echo 'output x' >"$conf"
    expect "an option that is not a setting" 3 "~line.1 output ~command.line" "$cln" info "$s"
    echo 'no-bbox' >"$conf"
    expect "no- before a setting that is no switch" 3 "~line.1 no-bbox ~bbox.is.not.a.switch" \
        "$cln" info "$s"
    printf '# caf\351\ntree-from caf\351\n' >"$conf"
    expect "a text that is not UTF-8" 3 "~line.2 ~not.UTF-8 ~save.the.file" "$cln" info "$s"
    printf '\357\273\277background: black # caf\351\n' >"$conf"
    expect "a byte order mark, and a colon" 0 "$conf ~background.black" "$cln" info "$s"
    rm "$conf"
    mkdir "$conf"
    expect "a folder of that name" 3 "cl-nascent.conf --no-conf" "$cln" info "$s"
    expect "that folder with --no-conf" 0 "" "$cln" info "$s" --no-conf
    rmdir "$conf"
    echo '{"epochs": 1}' >"$s/run.json"
    expect "a scene with another program's run.json" 0 "" "$cln" info "$s" --json
    check "it is described as a scene" [ "$(json splits.train)" = 6 ]
    echo '{"schema": "cl-nascent.run/9"}' >"$s/run.json"
    expect "a run of another version stays one" 3 "cl-nascent.run/9" "$cln" info "$s"
    rm "$s/run.json"

    expect "check says how far it is" 0 "~timing.2/2" \
        "$cln" check "$s" --probe 0.1 --progress line "${tree[@]}"
    check "on stderr alone" eval '! grep -qE "(compared|timing) [0-9]+/" "$work/out"'
    expect "check --json with it" 0 "~compared.9/9" \
        "$cln" check "$s" --probe 0 --progress line --json
    check "standard output is a document" [ "$(json schema)" = cl-nascent.check/1 ]
    for c in "-q" "--progress none"; do
        # shellcheck disable=SC2086 # two words
        expect "check $c" 0 "" "$cln" check "$s" --probe 0 $c
        check "check $c: no progress" [ ! -s "$work/err" ]
    done
    # steps that are long enough to be interrupted
    env --default-signal=INT "$cln" check "$s" --probe 600 --progress bar --preset paper \
        >"$work/out" 2>"$work/err" &
    while kill -0 $! && ! said timing; do sleep 0.1; done
    kill -INT $!
    wait $!
    check "check that is interrupted: exit code 130" [ $? = 130 ]
    check "it prints no figures" [ ! -s "$work/out" ]

    cp -r "$s" "$work/round"
    sed -i 's/"frames"/"camera_model": "spherical", &/' "$work/round"/transforms_*.json
    expect "a panorama by another name" 3 "~is.EQUIRECTANGULAR" "$cln" info "$work/round"
    sed -i 's/"spherical"/"EQUIRECTANGULAR"/' "$work/round"/transforms_*.json
    expect "check of panoramas" 0 "" "$cln" check "$work/round" --probe 0
    check "their field of view is not spoken of" eval \
        'printed "inside the cube" && ! printed "nan" && ! printed "field of view"'

    # what other programs write otherwise: the model in lower case, null for what they do not know
    "$make_scene" "$work/others" --format nerfstudio --size 32 --train 6 --test 3 >/dev/null
    sed -i -e '1,/"fl_x"/ s/"fl_x"/"camera_model": "opencv", "aabb_scale": null, &/' \
        -e '1,/"fl_x"/ s/"fl_x"/"offset": null, &/' \
        -e '0,/"file_path"/ s/"file_path"/"mask_path": null, &/' "$work/others/transforms.json"
    check "the scene is as others write it" grep -q '"opencv", "aabb_scale": null' \
        "$work/others/transforms.json"
    expect "a camera model in lower case, and null" 0 "" "$cln" info "$work/others"

    # lists of splits whose names have other folders or endings than the frames
    "$make_scene" "$work/listed" --format nerfstudio --size 32 --train 6 --test 3 >/dev/null
    cp "$work/listed/transforms.json" "$work/frames.saved"
    sed -i '/"file_path"/! s|"images/|"|' "$work/listed/transforms.json"
    expect "lists without folders" 0 "~frame_00001.png.*taken.for.*images/frame_00001.png" \
        "$cln" info "$work/listed" --json
    check "their frames are found" [ "$(json splits.train)$(json splits.test)" = 63 ]
    sed 's|"images/\(.*\)\.png"|"IMAGES/\1"|' "$work/frames.saved" |
        sed '/"file_path"/ s|IMAGES|images|' >"$work/listed/transforms.json"
    expect "neither has endings, and case differs" 0 "~taken.for" \
        "$cln" info "$work/listed" --json
    check "their frames are found, too" [ "$(json splits.train)$(json splits.test)" = 63 ]
    sed '/"file_path"/! s|"images/frame_00002.png"|"frame_2"|' "$work/frames.saved" \
        >"$work/listed/transforms.json"
    expect "a name that no frame has" 3 "~'frame_2'.*first.frame.is.'images/frame_00001.png'" \
        "$cln" info "$work/listed"
    mkdir "$work/listed/more"
    cp "$work/listed/images/frame_00003.png" "$work/listed/more/frame_00002.png"
    sed -e '/"file_path"/ s|images/frame_00003|more/frame_00002|' \
        -e '/"file_path"/! s|"images/frame_0000[23].png"|"frame_00002"|' "$work/frames.saved" \
        >"$work/listed/transforms.json"
    expect "a name that two frames may have" 3 \
        "~'frame_00002'.*'images/frame_00002.png'.or.'more/frame_00002.png'" \
        "$cln" info "$work/listed"

    # a pose in one list; what pinholes are called
    expect "a nerfstudio scene" 0 "" "$cln" info "$work/others"
    check "a pinhole is called so, without parameters" \
        grep -qE "^  views 9, .* lens PINHOLE$" "$work/out"
    "$cln" info "$work/others" --json | "$query" digest >"$work/rows"
    cp "$work/others/transforms.json" "$work/rows.json"
    tr -d '\n' <"$work/rows.json" |
        sed -E 's/\],\s*\[/,/g; s/\[\s*\[/[/g; s/\]\s*\]/]/g' >"$work/others/transforms.json"
    check "its poses are lists of 16 numbers" \
        grep -qE '"transform_matrix": \[([^][,]*,){15}[^][,]*\]' "$work/others/transforms.json"
    expect "poses in lists of 16 numbers" 0 "" "$cln" info "$work/others" --json
    check "they are the same poses" [ "$(json digest)" = "$(cat "$work/rows")" ]
    sed -E 's/("transform_matrix": \[)[^,]*,/\1/' "$work/others/transforms.json" >"$work/short.json"
    cp "$work/short.json" "$work/others/transforms.json"
    expect "a list of 15 numbers" 3 "~12.or.16.numbers" "$cln" info "$work/others"
    cp "$work/rows.json" "$work/others/transforms.json"

    # photos that are elsewhere, called otherwise, or there twice
    cp -r "$work/others" "$work/astray"
    ln -sf "$work/nowhere.png" "$work/astray/images/frame_00003.png"
    expect "a link to a photo that is gone" 3 \
        "~1.of.9.images.is.not.there.*frame_00003.*restore.it" \
        "$cln" info "$work/astray"
    check "it is not offered in its own place" not_said "is there"
    mv "$work/others/images/frame_00003.png" "$work/astray/images/frame_00003.jpg"
    rm "$work/astray/images/frame_00003.png"
    expect "a photo with another ending: where it is" 3 \
        "~images/frame_00003.jpg.is.there,.with.another.ending" "$cln" info "$work/astray"
    mv "$work/astray/images/frame_00003.jpg" "$work/others/images/frame_00003.png"
    cp "$work/others/images/frame_00003.png" "$work/astray/images"
    sed -i '/_filenames/,/\]/d' "$work/astray/transforms.json"
    sed -i '0,/frame_00002/s//frame_00001/' "$work/astray/transforms.json"
    expect "a frame twice, of which one would be held out" 3 "~frame_00001.png.*twice" \
        "$cln" info "$work/astray"
    sed '0,/"fl_x"/s//"a\\u001b[31mb": 1, &/' "$work/rows.json" >"$work/others/transforms.json"
    expect "a scene with control characters in its keys" 0 "" "$cln" info "$work/others"
    check "they are listed" grep -qF 'a?[31mb' "$work/out"
    check "but a terminal would not obey them" eval '! grep -qF $'"'\033'"' "$work/out"'
    cp "$work/rows.json" "$work/others/transforms.json"
    cp -r "$s" "$work/same"
    cp "$s/transforms_train.json" "$work/same/transforms_test.json"
    for c in info check; do
        expect "$c: test photos that are trained on" 0 "" "$cln" $c "$work/same" --color never
        check "$c says so" eval 'grep -qE "6 of 6 test photos are trained on" "$work/err" \
            "$work/out"'
    done

    "$make_scene" "$work/windows" --format colmap --size 32 --train 6 --test 0 >/dev/null
    sed -i 's/$/\r/; 1s/^/\xef\xbb\xbf/; s/ frame_/ sub\\frame_/' "$work"/windows/sparse/0/*.txt
    mkdir "$work/windows/images/sub"
    mv "$work"/windows/images/*.png "$work/windows/images/sub"
    expect "COLMAP's text from Windows: byte order mark, line ends, separators" 0 "" \
        "$cln" info "$work/windows" --json
    check "all photos are read" [ "$(json splits.train)$(json splits.test)" = 51 ]

    "$make_scene" "$work/cafe" --format colmap --size 32 --train 6 --test 0 >/dev/null
    mv "$work/cafe/images" "$work/cafe/caf"$'\xe9'
    expect "photos in a folder whose name is not UTF-8" 0 "" "$cln" info "$work/cafe" --json
    check "its name in the reason" grep -q "images are from caf[?]" "$work/out"

    mkdir -p "$work/odd/empty" "$work/odd/photos" "$work/odd/polycam/keyframes/images" \
        "$work/odd/record3d/EXR_RGBD" "$work/odd/zip" "$work/odd/video" "$work/odd/mesh"
    cp "$s"/train/r_00[012].png "$work/odd/photos"
    touch "$work/odd/zip/scene.zip" "$work/odd/video/clip.MOV" "$work/odd/mesh/scan.ply" \
        "$work/odd/notes.txt" "$work/odd/capture.r3d" "$work/odd/polycam/mesh_info.json"
    expect "an empty folder" 3 "~is.empty" "$cln" info "$work/odd/empty"
    expect "photos alone" 3 "~3.images poses COLMAP" "$cln" info "$work/odd/photos"
    expect "a folder with an archive" 3 "scene.zip unpack" "$cln" info "$work/odd/zip"
    expect "an archive" 3 "unpack" "$cln" info "$work/odd/zip/scene.zip"
    expect "a video" 3 "clip.MOV ~takes.pictures" "$cln" info "$work/odd/video"
    expect "a mesh" 3 "scan.ply photos" "$cln" info "$work/odd/mesh"
    expect "a file of another kind" 3 "~another.kind folder" "$cln" info "$work/odd/notes.txt"
    expect "a Polycam capture" 3 "Polycam ~Developer.mode" "$cln" info "$work/odd/polycam"
    expect "a Record3D capture" 3 "Record3D ~EXR...JPG" "$cln" info "$work/odd/record3d"
    mkdir -p "$work/odd/metashape" "$work/odd/reality"
    printf '<?xml version="1.0"?>\n<document version="2.0.0">\n  <chunk label="1">\n' \
        > "$work/odd/metashape/Cameras.XML"
    cp "$s/train/r_000.png" "$work/odd/metashape/a.png"
    printf '#name,x,y,alt,heading,pitch,roll\na.png,0,0,0,0,0,0\n' > "$work/odd/reality/r.csv"
    local cut="~export.the.cameras.again"
    "$cln" version -v | grep -q "with expat" || cut="~built.without.expat"
    expect "cameras of Metashape, cut off" 3 "Cameras.XML $cut" "$cln" info "$work/odd/metashape"
    expect "their file" 3 "Cameras.XML $cut" \
        "$cln" info "$work/odd/metashape/Cameras.XML"
    expect "cameras of RealityCapture" 3 "~cameras.of.RealityCapture r.csv COLMAP" \
        "$cln" info "$work/odd/reality"
    expect "the file of a Record3D capture" 3 "unpack" "$cln" info "$work/odd/capture.r3d"

    cp -r "$s" "$work/nan"
    sed -i '0,/"file_path": ".*r_002"/b; 0,/[0-9]\.[0-9][0-9]*/s//NaN/' \
        "$work/nan/transforms_train.json"
    expect "a pose that is not a number: its frame" 3 "r_002 ~row.1.column.1" \
        "$cln" info "$work/nan"
    printf 'RIFF....WEBPVP8 ' >"$work/nan/train/r_000.png"
    cp "$s/transforms_train.json" "$work/nan"
    expect "a WebP: what to do" 3 "WebP ~convert" "$cln" info "$work/nan"
    : >"$work/nan/train/r_000.png"
    expect "an empty image" 3 "~empty --missing" "$cln" info "$work/nan"

    printf '\211PNG\r\n\032\n' >"$work/nan/train/r_001.png"
    head -c 500 "$s/train/r_003.png" >"$work/nan/train/r_003.png"
    expect "several broken images: all are named at once" 3 \
        "r_000.png ~empty ~3.of.9 train/r_001 train/r_003" "$cln" info "$work/nan"
    check "check takes them for a fault" \
        eval '"$cln" check "$work/nan" --probe 0 2>&1 | grep -q "FAULT  missing: 3 of 9"'
    cp "$s/train/r_000.png" "$s/train/r_001.png" "$work/nan/train"
    expect "a truncated image, found by reading" 3 "r_003.png ~too.early" \
        "$cln" check "$work/nan" --probe 0 --missing fail
    check "only the truncated image is named" not_said "cannot be read"

    cp -r "$s" "$work/mixed"
    { # a pixel without alpha
        printf '%s' iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAIAAACQd1PeAAAADElEQVR4
        printf '%s' nGP4//8/AAX+Av4N70a4AAAAAElFTkSuQmCC
    } | base64 -d >"$work/mixed/train/r_001.png"
    expect "one image without alpha among others" 0 "~1.of.9.images r_001 opaque" \
        "$cln" info "$work/mixed"
    sed -i 's/"file_path"/"depth_file_path": "d.png", "near": 1, "file_path"/' \
        "$s/transforms_train.json"
    expect "info" 0 "" "$cln" info "$s"
    check "info names unused keys" grep -qE '^ignored_keys +.*depth_file_path, near' \
        "$work/out"
    expect "info --json" 0 "" "$cln" info "$s" --json
    check "info --json names its schema" [ "$(json schema)" = cl-nascent.scene/1 ]
    check "its reals have all digits" [ "$(grep -cE '[0-9]\.[0-9]{16}' "$work/out")" -gt 0 ]
    expect "info" 0 "" "$cln" info "$s"
    check "info has intrinsics" grep -qE 'views 9, width 32, .* fx [0-9.]+' "$work/out"
    check "info has a training's memory" grep -qE '^  device_memory +[0-9.]+ [KMG]iB' "$work/out"
    check "and its disk" grep -qE '^  disk +[0-9.]+ [KMG]iB' "$work/out"
    check "info has a training's steps" grep -qE '^  steps +[0-9]+' "$work/out"
    check "info says how to get its time" printed "--like RUN"
    expect "info with an option without effect" 0 "~--holdout.has.no.effect:.*names.the.splits" \
        "$cln" info "$s" --holdout 5
    printf '%s\n' 'width 64' 'depth-loss 0.1' >"$conf" # which points there are, photos tell
    expect "info with a setting without effect in the conf" 0 "~--width.has.no.effect:.voxels" \
        "$cln" info "$s"
    check "it is the only one" [ "$(grep -c "has no effect" "$work/err")" = 1 ]
    rm "$conf"
    expect "check of such options" 0 "~--lr-final.has.no ~--bands.has.no ~--holdout.has.no" \
        "$cln" check "$s" --probe 0 --lr-schedule step --lr-final 1e-4 --bands 3 --holdout 5
    check "of these alone" [ "$(grep -c "has no effect" "$work/err")" = 3 ]
    expect "info without a device" 0 "" env OCL_ICD_VENDORS="$work/none" "$cln" info "$s" --json
    check "info says why memory is unknown" [ -n "$(json training.no_device)" ]
    expect "PoCL without devices" 0 "" env POCL_DEVICES=none "$cln" info "$s" --json
    check "names what took them" eval '[ -z "$(json training.no_device)" ] ||
        json training.no_device | grep -q POCL_DEVICES'
    expect "train" 0 "keys depth_file_path" \
        "$cln" train "$s" -o "$work/keys" "${small[@]}" --steps 2
}

# Until the training of this run, process $step, has a row of metrics, or has ended.
first_row() { # first_row RUN
    while [ ! -s "$1/metrics.jsonl" ] && kill -0 $step; do sleep 0.1; done
}

# A first training and what it prints.
section_training() {
    local s=$work/my\ scene r="$work/run's 1" step signal
    "$make_scene" "$s" --size 32 --train 6 --test 3 >/dev/null
    printf '%s\n' 'eval-images 2' 'rays 128' >"$s/cl-nascent.conf"
    expect "train" 0 "" "$cln" train "$s" -o "$r" "${small[@]}" --time-limit 2
    check "a training begins with few lines" \
        [ "$(sed '/^train /q' "$work/err" | grep -vcE '^train |photos around')" -le 6 ]
    check "one line names -v" said "-v)"
    check "the conf's settings are named unless overridden" \
        said "from $s/cl-nascent.conf: eval-images 2"
    check "none is longer than two lines of a terminal" eval \
        '! sed "/^train /q" "$work/err" | grep -v "^train " | grep -qE "^.{200}"'
    check "no figure is missing in the progress" not_said nan
    check "no speed is 0" not_said " 0 rays/s"
    check "training time and wall time" grep -qE \
        '^time +[0-9:]+ of training; [0-9:]+ in all' "$work/out"
    check "and that of processors" grep -qE '^processors +[0-9:]+ for that' "$work/out"
    check "the test PSNR is of some views: how to have all, quoted" printed \
        "(over 2 of 3 test views; of all: \`cl-nascent eval '$work/run'\''s 1'\`)"
    check "run.json has what the conf file set" \
        [ "$("$query" config.eval_images <"$r/run.json")" = 2 ]
    expect "resumed, though its budget is used up" 0 "~used.up --time-limit" \
        "$cln" train --resume "$r" "${plain[@]}"
    check "the conf is not read on --resume: what it has otherwise, and nothing else" said \
        "$s/cl-nascent.conf is not read on --resume: the run keeps rays 256 (there 128)"
    check "the suggested command is quoted" said "--resume '$work/run'\''s 1' --time-limit +2s"
    check "the run's figures are printed" grep -qE "^PSNR +[0-9]" "$work/out"
    expect "a new run in its folder: refused at once" 7 "--resume" \
        "$cln" train "$s" -o "$r" --steps 3
    check "it is refused before a device is opened" not_said "checking the kernels"
    expect "--steps +N where there was no budget in steps" 0 "" \
        "$cln" train --resume "$r" "${plain[@]}" --steps +7 --json
    check "the evaluation to come has a time" grep -qE \
        '^train .* left \| evaluation ~[0-9:]+ more \|' "$work/err"
    check "the conf is named on every --resume" said "cl-nascent.conf is not read"
    sed -i 's/rays .*/rays 256/' "$s/cl-nascent.conf"
    expect "--resume with a conf that says the same" 0 "" \
        "$cln" train --resume "$r" "${plain[@]}" --json
    check "nothing about it" not_said "cl-nascent.conf"
    echo 'rayz 3' >>"$s/cl-nascent.conf"
    expect "--resume with a conf that cannot be read" 0 "" \
        "$cln" train --resume "$r" "${plain[@]}" --json
    sed -i -e '$d' -e 's/rays .*/rays 128/' "$s/cl-nascent.conf"
    expect "--resume --no-conf" 0 "" \
        "$cln" train --resume "$r" "${plain[@]}" --no-conf --json
    check "nothing about the conf" not_said "cl-nascent.conf"
    check "it trains 7 more steps" [ "$(json step)" = "$("$query" config.steps <"$r/run.json")" ]
    check "the budget in time is dropped" \
        [ "$("$query" config.time_limit <"$r/run.json")" = 0 ]
    check "the report has evaluations outside the table" grep -q \
        'Not in the table: .*evaluation' "$r/report.html"
    check "run.json has the wall time" \
        number_above "$("$query" result.wall_seconds <"$r/run.json")" 0
    expect "info of the scene, like the run" 0 "" "$cln" info "$s" --no-conf --preset fast \
        --like "$r" --json
    check "it is of that preset" [ "$(json training.preset)" = fast ]
    check "networks' epochs are the preset's" [ "$(json training.epochs)" = 30 ]
    check "its time is steps times seconds per step" awk -v a="$(json training.training_seconds)" \
        -v n="$(json training.steps)" -v s="$("$query" result.seconds <"$r/run.json")" \
        -v k="$("$query" result.step <"$r/run.json")" \
        'BEGIN { d = a - n * s / k; exit !(a > 0 && d * d < 1e-6 * a * a) }'
    check "its start is the run's, its evaluation that of 3 views for 2" awk \
        -v a="$(json training.start_seconds)" -v b="$(json training.evaluation_seconds)" \
        -v c="$("$query" result.start_seconds <"$r/run.json")" \
        -v d="$("$query" result.eval_seconds <"$r/run.json")" \
        'BEGIN { c = a - c; d = b - 1.5 * d; exit !(a > 0 && b > 0 && c * c + d * d < 1e-12) }'
    check "settings that differ are named" grep -q \
        'with another width, depth, view-width, bands.*, n1, .*, rays, batch-samples' "$work/out"
    expect "info of the scene" 0 "" "$cln" info "$s" --no-conf --json
    check "voxels of few pixels get steps to split in" [ "$(json training.steps)" -ge 1500 ]
    run "$cln" check "$s" --no-conf --probe 0 --epochs 30 --json
    check "epochs that are asked for stay" \
        [ "$(json training.epochs)" = 30 -a "$(json training.steps)" -lt 1500 ]
    expect "--like for a run" 2 "--like SCENE" "$cln" info "$r" --like "$r"
    expect "--like a folder that is not a run" 3 "~not.a.run" "$cln" info "$s" --like "$s"
    expect "bugreport of the run" 0 "" env HOME="$work" "$cln" bugreport --no-test "$r"
    check "bugreport has what differs from the preset" grep -qE "^ +rays 256" "$work/out"
    check "no home folder is named" eval '! printed "$work"'
    expect "a budget below what was trained" 0 "~used.up" "$cln" train --resume "$r" \
        "${plain[@]}" --steps 3 --json
    step=$(json step)
    run "$cln" train "$s" --no-conf "${plain[@]}" --steps 4 -o "$work/four steps" -q
    expect "a budget below its steps: a warning" 0 "~warning.*used.up" "$cln" train \
        --resume "$work/four steps" --steps 2 -q
    check "and the run keeps its own" \
        [ "$("$query" config.steps <"$work/four steps/run.json")" = 4 ]
    run "$cln" train "$s" --no-conf "${plain[@]}" --time-limit 1 -o "$work/a second" -q
    expect "less time than it had: a warning" 0 "~warning.*used.up" "$cln" train \
        --resume "$work/a second" --time-limit 0.1 -q
    check "and the run keeps its second" \
        number_above "$("$query" config.time_limit <"$work/a second/run.json")" 0.99
    expect "resumed from another folder" 0 "" \
        bash -c 'cd / && exec "$@"' - "$cln" train --resume "$r" "${plain[@]}" --steps +1 -q
    step=$((step + 1))
    expect "a budget below what was trained, without --skip-selftest" 0 "~used.up" \
        "$cln" train --resume "$r" --progress none --steps 3
    check "kernels are not checked for it" not_said "checking the kernels"
    expect "a budget below what was trained, again" 0 "~used.up" "$cln" train --resume "$r" \
        "${plain[@]}" --steps 3 --json
    expect "the command that it suggests" 0 "" "$cln" train --resume "$r" "${plain[@]}" \
        --steps "$(sed -n 's/.*--steps \(+[0-9]*\)`.*/\1/p' "$work/err")" --json
    check "the suggested command trains on" [ "$(json step)" = $((step + 3)) ]
    sed -i 's/eval-images.*/time-limit 20s/' "$s/cl-nascent.conf"
    expect "info --like with a time limit alone" 0 "" \
        "$cln" info "$s" --like "$r" --json
    check "it says how many steps fit" number_above "$(json training.steps_in_time_limit)" 20
    expect "--like a folder that does not exist" 3 "nowhere" \
        "$cln" info "$s" --like "$work/nowhere"
    sed -i 's/time-limit.*//' "$s/cl-nascent.conf"
    cp -r "$r" "$work/other"
    mv "$s/train" "$s/away" # these errors are found before photos are read
    for step in "--width 32" "--holdout 4" "--no-view-dependence"; do
        # shellcheck disable=SC2086 # two words
        expect "a resumed run cannot change $step" 8 "${step% *} ~cannot.change" \
            "$cln" train --resume "$work/other" $step
    done
    for step in train eval render export view; do
        case $step in
        train) set -- --resume "$work/other" ;;
        render) set -- "$work/other" --orbit 2 ;;
        export) set -- "$work/other" --mesh "$work/mesh.ply" ;;
        *) set -- "$work/other" ;;
        esac
        expect "$step: a kernel folder that does not exist" 3 "--kernel-dir $work/nowhere" \
            "$cln" $step "$@" --kernel-dir "$work/nowhere"
        expect "$step: a vector width that cannot be" 2 "VW=3 ~1,.2,.4,.8.or.16" \
            "$cln" $step "$@" --tune VW=3
        expect "$step: a device that does not exist" 4 "~--device.77" "$cln" $step "$@" --device 77
    done
    mv "$s/away" "$s/train"
    expect "resumed with smaller photos, on black: warnings" 0 "~divided.by.2.now --background" \
        "$cln" train --resume "$work/other" "${plain[@]}" --steps +1 --downscale 2 \
        --background black
    expect "resumed again with the same" 0 "" \
        "$cln" train --resume "$work/other" "${plain[@]}" --steps +1
    check "no warning the second time" eval '! said "do not compare"'
    expect "a --tune value that the network does not allow" 0 "~NV=8.*is.used" \
        "$cln" train --resume "$work/other" "${plain[@]}" --steps +1 --tune NV=8
    run timeout --foreground --preserve-status -s INT 0.3 "$cln" train "$s" -o "$work/early"
    check "Ctrl-C before the first step: it ends" [ $rc = 130 ]
    check "it says that nothing was written" said "nothing was written"
    check "nothing was written" [ ! -e "$work/early" ]
    rm -rf "$work/other"
    env --default-signal=INT "$cln" train "$s" -o "$work/other" "${small[@]}" --steps 1000000 \
        --log-every 1000000 >"$work/out" 2>"$work/err" &
    step=$!
    while ! said "~^train [0-9]" && kill -0 $step; do sleep 0.1; done
    kill -INT $step
    wait $step
    check "Ctrl-C before the first row of metrics: it ends" [ $? = 130 ]
    check "its PSNR is of the steps so far" grep -qE "^PSNR +[0-9.]+ train" "$work/out"
    rm -rf "$work/other"
    # the tests may themselves run under nohup
    env --default-signal=HUP bash -c 'exec "$@" 2>&-' - "$cln" train "$s" -o "$work/other" \
        "${small[@]}" --steps 1000000 >"$work/out" &
    step=$!
    first_row "$work/other"
    check "standard error that is closed is no other file" \
        [ "$(readlink /proc/$step/fd/2)" = /dev/null ]
    kill -HUP $step
    wait $step
    check "its terminal is closed: training ends" [ $? = 143 ]
    check "it leaves a checkpoint" [ -s "$work/other/checkpoint/latest" ]
    rm -rf "$work/other"
    for signal in XCPU USR2 QUIT; do
        # a shell has SIGQUIT ignored behind &
        (ulimit -c 0 && exec env --default-signal=QUIT "$cln" train "$s" -o "$work/other" \
            "${small[@]}" --steps 1000000 >"$work/out" 2>"$work/err") &
        step=$!
        first_row "$work/other"
        kill -$signal $step
        wait $step 2>/dev/null
        rc=$?
        case $signal in
        XCPU)
            check "processor time is used up: training ends" [ $rc = 143 ]
            check "and says so" said "out of processor time: stopping"
            ;;
        USR2) check "SIGUSR2, a warning of Grid Engine: training ends" [ $rc = 143 ] ;;
        QUIT)
            check "SIGQUIT: it ends at once" [ $rc = 131 ]
            check "without a checkpoint" [ ! -e "$work/other/checkpoint/latest" ]
            ;;
        esac
        [ $signal = QUIT ] || check "with a checkpoint, too" [ -s "$work/other/checkpoint/latest" ]
        rm -rf "$work/other"
    done
    nohup "$cln" train "$s" -o "$work/other" "${small[@]}" --time-limit 3 >"$work/out" \
        2>"$work/err" &
    step=$!
    first_row "$work/other"
    kill -HUP $step
    wait $step
    check "with nohup training goes on" [ $? = 0 ]
    on_terminal 80 "$cln" train --resume "$r" --skip-selftest --steps +40
    check "80 columns: no field is cut" eval '! tr "\r" "\n" <"$work/out" |
        grep -aE "^train" | sed "s/\x1b\[K//" |
        grep -vqE "(train|test|left|more|trained|[0-9]|/s)$"'
    check "80 columns: PSNR and time are shown" grep -aqE 'PSNR [0-9.]+ train.*left' "$work/out"
    on_terminal 60 "$cln" train --resume "$r" --skip-selftest --steps +40
    check "60 columns: the time left is shown" grep -aqE '\| [0-9:-]+ left' "$work/out"
    on_terminal 80 env CI=true "$cln" train --resume "$r" --skip-selftest --steps +40
    check "no line is redrawn where CI is set" eval '! grep -qF $'"'\033[K'"' "$work/out"'
}

# What is said where leaves are voxels, as they are by default; and in little memory.
section_voxels() {
    local s=$work/voxels r=$work/of\ voxels batch
    local little=(--skip-selftest --progress none --grid-cells 4 --n1 4 --start-level 1
        --level-at 2:0.3 --max-level 2)
    "$make_scene" "$s" --size 32 --train 6 --test 2 >/dev/null
    expect "train, by default" 0 "" "$cln" train "$s" -o "$r" "${little[@]}" --steps 30 -v
    check "the plan has weights of leaves" said "memory plan: leaf weights"
    check "networks are named as what is left out" \
        grep -qF '"networks (leaves are voxels)"' "$r/run.json"
    check "their parts are not" eval \
        '! grep -qE "\"(skip connection|random slopes)" "$r/run.json"'
    check "batches that grow a little are not worth a line" eval \
        'grep "^buffer for sample colours" "$work/err" | awk "{ n = \$5 + 0
            if (n > last && n < 1.5 * last) exit 1; last = n }"'
    check "metrics.jsonl has the stages' names" grep -qF '"networks forward":' "$r/metrics.jsonl"
    check "the report calls them voxels" eval 'grep -qF "voxels forward" "$r/report.html" &&
        ! grep -qF "networks forward" "$r/report.html"'
    check "settings of networks are not listed, but named" eval \
        '! grep -qF "<th scope=row>view-width<td" "$r/report.html" &&
        grep -qE "Not listed, .*: .*view-width, " "$r/report.html"'
    expect "render -v" 0 "~seconds.of.the.device:.*voxels.forward" "$cln" render "$r" --orbit 1 \
        --width 8 -v
    check "the report has leaves with a model" \
        grep -qE ">[0-9,]+ lea(f|ves) with a model at step 30" "$r/report.html"
    check "it speaks of no leaves with networks" eval \
        '! grep -qE "lea(f|ves) with a network|>Leaf networks|network weights" "$r/report.html"'
    expect "devices" 0 "" "$cln" devices --no-test
    check "voxels, the default, come first" eval \
        '[ "$(grep -E "from .*, for (voxels|networks) of" "$work/out" | sed 1q |
            grep -cE "for voxels of X")" = 1 ]'
    "$cln" devices >"$work/out" 2>"$work/err" &
    until grep -q "^    driver" "$work/out" || ! kill -0 $! 2>/dev/null; do sleep 0.01; done
    check "a device is printed before its test" eval \
        'kill -0 $! 2>/dev/null && ! printed "self-test"'
    wait $!
    check "and its verdict after it" eval 'printed "    self-test  ok" && said "kernels 2/2 100%"'
    expect "tune, for voxels" 0 "~of.X4x16" "$cln" tune --grid-cells 4 --rays 256 \
        --batch-samples 4096 --budget 1 --progress none -o "$work/voxels.txt"
    check "it speaks of voxels alone" eval 'grep -qE "^voxels +X4x16; a step" "$work/out" &&
        printed "for such voxels" && ! grep -q networks "$work/out" "$work/err"'
    expect "check of one network" 0 "" "$cln" check "$s" --preset nerf --probe 0
    check "one leaf is one" printed "tree of 1 leaf,"

    expect "too little device memory for a batch: a smaller one, by itself" 0 \
        "~a.step.has.[0-9]+.samples,.not.524288.\\(--batch-samples\\)" \
        "$cln" train "$s" -o "$work/little" "${little[@]}" --steps 2 --device-mem 64M
    batch=$("$query" config.batch_samples <"$work/little/run.json")
    check "it is recorded" [ "${batch:-524288}" -lt 524288 ]
    expect "check tells it, too" 0 "" "$cln" check "$s" "${little[@]:3}" --probe 0 --device-mem 64M
    check "in its own line" eval 'tr -s " \n" " " <"$work/out" | grep -q "has $batch samples, not"'
    expect "a resumed run keeps it" 0 "" "$cln" train --resume "$work/little" --skip-selftest \
        --steps +1 --device-mem 8G
    check "without a word" not_said "batch-samples"
    check "and records it" eval '[ "$("$query" config.batch_samples <"$work/little/run.json")" = \
        "$batch" ]'
    expect "one that is given is kept, or refused with one that fits" 5 \
        "~give.--batch-samples.[0-9]+,.which.fits --device-mem" \
        "$cln" train "$s" -o "$work/never" "${little[@]}" --steps 2 --device-mem 64M \
        --batch-samples 524288
    expect "too little device memory for pictures" 5 "~raise.--device-mem" \
        "$cln" eval "$r" --device-mem 1M
    check "no option is named that eval has not" not_said "batch-samples"
    expect "too little host memory: a batch that fits is named" 5 \
        "~give.--batch-samples.[0-9]+,.which.fits --host-mem" \
        "$cln" train "$s" -o "$work/never" "${little[@]}" --steps 2 --host-mem 400M -d cpu \
        --batch-samples 524288
    batch=$(sed -n 's/.*give --batch-samples \([0-9]*\), .*/\1/p' "$work/err")
    expect "it fits" 0 "" "$cln" train "$s" -o "$work/tight" "${little[@]}" --steps 2 \
        --host-mem 400M --batch-samples "${batch:-0}" -d cpu
    expect "and a smaller one is taken by itself" 0 "~samples,.not.524288" "$cln" train "$s" \
        -o "$work/tight too" "${little[@]}" --steps 2 --host-mem 400M -d cpu
}

# Runs side by side: a run, and copies of it that say something else.
check_runs() { # check_runs RUN
    local r=$1 twin=$work/twin other=$work/other\ scene
    cp -r "$r" "$twin"
    sed -i -e 's/"rays": 256,/"rays": 512,/' -e 's/"psnr_train": [0-9.]*/"psnr_train": 77.25/' \
        -e 's/"device_mem": [0-9.]*/"device_mem": 2147483648/' \
        -e 's/"eval_at": ""/"eval_at": "30"/' \
        -e 's/\("name": "[^"]*\)"/\1, of another make with a name that is long"/' \
        "$twin/run.json"
    cp -r "$twin" "$other"
    sed -i -E 's/"(test_)?digest": "[0-9a-f]*"/"\1digest": "0123456789abcdef"/' "$other/run.json"
    expect "two runs" 0 "" "$cln" info "$r" "$twin"
    check "the names of the folders are above the columns" \
        grep -qE "^ +run's 1 +twin$" "$work/out"
    check "the setting that differs" grep -qE '^  rays +256 +512$' "$work/out"
    check "no setting that does not" eval '! printed view-width'
    check "bytes have their unit" grep -qE '^  device-mem +0 +2.0 GiB$' "$work/out"
    check "an empty text is told" grep -qE '^  eval-at +none +30$' "$work/out"
    check "the best is marked" grep -qE '^  PSNR train, of rays +[0-9.]+ +77.25 \*$' "$work/out"
    check "a long name has a line of its own" \
        grep -qE '^    twin +[^ ]' "$work/out"
    check "devices differ: times do not compare" printed "times do not compare"
    check "80 columns" [ -z "$(awk 'length > 80' "$work/out")" ]
    on_terminal 50 "$cln" info "$r" "$twin"
    check "50 columns" [ -z "$(tr -d '\r' <"$work/out" | awk 'length > 50')" ]
    expect "three runs, one there twice, one of another scene" 0 "" \
        "$cln" info "$r" "$twin" "$r/" "$other" --json
    check "they have a document" [ "$(json schema)" = cl-nascent.runs/1 ]
    check "with a value for each run" [ "$(json settings.rays.3)" = 512 ]
    check "it has no best" [ "$(json comparable)" = false -a -z "$(json best.psnr_train.0)" ]
    check "the same run is named" eval 'printed "are the same run"'
    expect "a scene among the runs" 3 "~not.a.run ~info.SCENE" "$cln" info "$r" "$work/my scene"
    expect "a run that does not exist" 3 "$work/none" "$cln" info "$r" "$work/none"
    expect "--like with two runs" 2 "--like ~2.names" "$cln" info "$r" "$twin" --like "$r"
    sed -i 's/"state": "done"/"state": "interrupted"/' "$twin/run.json"
    expect "a run that was interrupted" 0 "" "$cln" info "$r" "$twin"
    check "it says so" printed "twin: interrupted at step"
    sed -i 's/"rays": 512,/"rays": 512, "novel": 1,/' "$twin/run.json"
    expect "a run with settings of another version" 0 "" "$cln" info "$r" "$twin"
    check "it is named" printed "twin: its settings are another version's"
    check "whether settings differ is not known" eval '! printed "No setting differs"'
    expect "such a run beside two others" 0 "" "$cln" info "$r" "$twin" "$other"
    check "its settings are not known" grep -qE '^  rays +256 +[?] +512$' "$work/out"
    check "nothing is said of their effect" eval '! printed "without effect"'
    rm -rf "$twin" "$other"
}

# Pictures and files of a run.
section_results() {
    local r="$work/run's 1" c
    [ -d "$r" ] || section_training
    on_terminal 60 "$cln" info "$r"
    check "info breaks its lines at the terminal's width" [ -z "$(tr -d '\r' <"$work/out" |
        awk 'length > 60 && NF > 2')" ]
    check "and goes on under the value" grep -qE '^ {12,}[a-z]' "$work/out"
    expect "info into a pipe" 0 "" "$cln" info "$r"
    check "its lines are whole there" [ -n "$(awk 'length > 60 && NF > 2' "$work/out")" ]
    check_runs "$r"
    expect "info of a run's file" 3 "~run.json:.*give.the.run.s.folder" "$cln" info "$r/run.json"
    expect "a file of a run instead of the run" 3 "~give.*run's.1$" "$cln" eval "$r/report.html"
    expect "export with run and file exchanged" 2 "~export.'.*run.*--mesh.a.glb" \
        "$cln" export --mesh "$r" a.glb
    expect "export into a missing folder: refused at once" 7 "$work/none ~no.folder" \
        "$cln" export "$r" --mesh "$work/none/a.ply"
    expect "export where nothing can be made: before the work" 7 "/proc/a.ply ~created.in./proc" \
        "$cln" export "$r" --mesh /proc/a.ply
    check "no export was begun" not_said "depths"
    expect "a page where nothing can be made" 7 "/proc/a.html" \
        "$cln" check "$work/my scene" -o /proc/a.html
    expect "an evaluation there" 7 "/proc/a" "$cln" eval "$r" -o /proc/a
    check "no device was opened" not_said "device:"
    expect "a film there" 7 "/proc/a.y4m" "$cln" render "$r" --orbit 2 -o /proc/a.y4m
    expect "a tuning row there" 7 "/proc/a" "$cln" tune -o /proc/a
    check "no search was begun" not_said "device:"
    expect "a film larger than the disk: refused at once" 7 "~big.y4m: ~too.little.room" \
        timeout 60 "$cln" render "$r" --orbit 20000 --width 8000 -o "$work/big.y4m" --progress none
    check "no film is left" eval '! ls "$work"/big* 2>/dev/null'
    check "no device was opened for it" not_said "device:"
    expect "a film that may need ffmpeg" 0 "" "$cln" render "$r" --orbit 1 --width 16 \
        -o "$work/a.mp4" --progress none
    check "the line names the written file" [ -s "$(sed 's/: 1 rendered.*//' "$work/out")" ]
    printf '%s' '{"render_width": 24, "render_height": 20, "camera_path": [{"fov": 50,' \
        '"camera_to_world": [1,0,0,0, 0,0,-1,-4, 0,1,0,0, 0,0,0,1]}], "crop": ' >"$work/free.json"
    cp "$work/free.json" "$work/boxed.json"
    echo 'null}' >>"$work/free.json"
    printf '%s' '{"crop_center": [0, 0, 0.25], "crop_scale": [1, 1, 0.5], "crop_bg_color": ' \
        '{"r": 255, "g": 255, "b": 255}}}' >>"$work/boxed.json"
    expect "a camera path with a crop box" 0 "boxed.json ~crop.box" "$cln" render "$r" \
        --poses "$work/boxed.json" -o "$work/boxed"
    expect "the same box by --crop" 0 "" "$cln" render "$r" --poses "$work/free.json" \
        -o "$work/freed" --crop=-0.5,-0.5,0,0.5,0.5,0.5
    cp "$work/free.json" "$work/test.json"
    expect "poses of a file with a split's name" 0 "" "$cln" render "$r" --poses "$work/test.json"
    check "they have a folder of their own" [ -s "$r/render/poses-test/path_0000.png" -a \
        ! -e "$r/render/test/path_0000.png" ]
    check "both boxes give the same picture" \
        cmp "$work/boxed/path_0000.png" "$work/freed/path_0000.png"
    sed 's/0,0,-1,-4, 0,1,0,0/0,0,1,-4, 0,-1,0,0/' "$work/free.json" >"$work/away.json"
    expect "a camera path that looks away: a warning" 0 "~away.json: ~none.of.its.poses.\\(1\\)" \
        "$cln" render "$r" --poses "$work/away.json" -o "$work/away"
    expect "the camera path without a box" 0 "" \
        "$cln" render "$r" --poses "$work/free.json" -o "$work/whole"
    check "it gives another picture" \
        eval '! cmp -s "$work/boxed/path_0000.png" "$work/whole/path_0000.png"'
    for c in mesh.ply points.ply volume.npy; do
        expect "${c%.*} with a spacing larger than the scene" 2 "~--spacing.1000: ~side.of ~less" \
            "$cln" export "$r" --${c%.*} "$work/far.${c#*.}" --spacing 1000
    done
    "$make_scene" "$work/model" --format colmap --size 32 --train 6 --test 0 >/dev/null
    "$cln" train "$work/model" -o "$work/model run" "${small[@]}" --steps 3 >/dev/null 2>&1
    expect "cameras of a COLMAP scene, beside it" 0 "" \
        "$cln" export "$work/model run" --cameras "$work/model/cameras.json"
    check "nothing about another place" not_said "put the file there"
    expect "they are a scene there" 0 "" "$cln" info "$work/model/cameras.json" --json
    check "with all photos" [ "$(json splits.train)$(json splits.test)" = 51 ]
    expect "cameras elsewhere: where they are a scene" 0 "~put.the.file.there $work/model" \
        "$cln" export "$work/model run" --cameras "$work/cameras.json"
    expect "COLMAP's files elsewhere" 0 "~put.the.folder.there $work/model" \
        "$cln" export "$work/model run" --cameras "$work/cameras"
    mv "$work/cameras" "$work/model"
    expect "they are a scene in its folder" 0 "" "$cln" info "$work/model/cameras" --json
    check "with all photos, too" [ "$(json splits.train)$(json splits.test)" = 51 ]
    expect "read from within its folder" 0 "" \
        bash -c 'cd "$1" && exec "$2" info cameras' - "$work/model" "$cln"
    check "its folder of images is named without ways back" eval \
        'grep -q "images are from .*model" "$work/out" && ! grep -qF "/.." "$work/out"'
    "$make_scene" "$work/cut out" --format nerfstudio --masks --size 40 --train 6 --test 2 \
        >/dev/null
    sed -i 's/"mask_path"/"alpha_path"/' "$work/cut out/transforms.json"
    expect "masks as alpha" 0 "" "$cln" info "$work/cut out" --json
    check "the scene has alpha" [ "$(json alpha)" = true ]
    "$cln" train "$work/cut out" -o "$work/cut run" "${small[@]}" --steps 3 --downscale 3 \
        >/dev/null 2>&1
    expect "cameras of a scene with alpha masks: what they lack is said" 0 \
        "~cube.and.sparse.points.are.left.out.*--bbox=" \
        "$cln" export "$work/cut run" --cameras "$work/cut out/cameras.json"
    check "JSON lacks no masks" not_said masks
    set -- "$(sed -n 's/.*\(--bbox=[-+.e0-9,]*\).*/\1/p' "$work/err")"
    expect "they are a scene" 0 "" "$cln" info "$work/cut out/cameras.json" --json "$1"
    check "with alpha" [ "$(json alpha)" = true ]
    "$cln" info "$work/cut out" --json >"$work/whole.json"
    for c in fx fy cx cy width height; do
        check "with the same $c, also of a run on photos divided by 3" eval \
            '[ "$(json intrinsics.0.$c | cut -c 1-9)" = \
            "$("$query" intrinsics.0.$c <"$work/whole.json" | cut -c 1-9)" ]'
    done
    check "in the same cube" eval '[ "$(json half | cut -c 1-7)" = \
        "$("$query" half <"$work/whole.json" | cut -c 1-7)" ]'
    # a shell, which COLMAP scenes without alpha get, and a cube far from the origin
    "$make_scene" "$work/terrain" --kind terrain --format colmap --size 32 --train 12 --test 0 \
        --offset 500000,4500000,200 >/dev/null
    "$cln" train "$work/terrain" -o "$work/terrain run" "${small[@]}" --steps 3 >/dev/null 2>&1
    expect "cameras of a scene with a shell, as a survey has it" 0 "~--bbox=.*--space.shell" \
        "$cln" export "$work/terrain run" --cameras "$work/terrain/cameras.json"
    set -- "$(sed -n 's/.*\(--bbox=[-+.e0-9,]*\).*/\1/p' "$work/err")"
    expect "a survey for a slicer: floats begin elsewhere" 0 "~taken.off.*STL.*\.ply" \
        "$cln" export "$work/terrain run" --mesh "$work/terrain/slicer.stl" --closed --json
    check "at whole numbers" eval '[[ $(json taken_off.0) =~ ^49[0-9]{4}(\.0)?$ ]]'
    check "its corners are near 0" eval 'od -An -tf4 -j96 -N12 "$work/terrain/slicer.stl" |
        awk "{ exit !(\$1 * \$1 < 1e6 && \$2 * \$2 < 1e6 && \$3 * \$3 < 1e6) }"'
    check "what no view sees is told" number_above "$(json unseen_share)" 0.001
    check "and what the mesh encloses" number_above "$(json volume)" 0
    expect "its size, and where it is" 0 "" "$cln" export "$work/terrain run" \
        --mesh "$work/terrain/web.glb" --scale 0.001 --json
    check "as crop boxes are given" [ "$(json box.0 | cut -c 1-2)" = 49 ]
    check "in kilometres" eval '[ "$(json size.0 | cut -c 1-2)" = 0. ]'
    run "$cln" export "$work/terrain run" --mesh "$work/terrain/web.glb" --overwrite --scale 0.001
    check "the last line has them, too" grep -q "in the file .*, in the scene's frame within 49" \
        "$work/out"
    run "$cln" export "$work/terrain run" --mesh "$work/t.obj" --closed --up=-y --scale 2 \
        --offset 1,2,3
    check "its record" grep -Eq "0,-1,0 up [+] 1,2,3; model [0-9a-f]{16}, closed$" "$work/t.obj"
    check "and what a cell is worth" printed "; a surface off by one cell, "
    "$cln" info "$work/terrain" --json >"$work/whole.json"
    expect "they are a scene with a shell" 0 "" "$cln" info "$work/terrain/cameras.json" --json \
        "$1" --space shell
    for c in space half centre.0 centre.1 centre.2; do
        check "$c is the same" eval '[ "$(json $c | cut -c 1-9)" = \
            "$("$query" $c <"$work/whole.json" | cut -c 1-9)" ]'
    done
    expect "COLMAP's files: masks are missing" 0 "~masks.*FILE.json" \
        "$cln" export "$work/cut run" --cameras "$work/cut cameras"
    run sh -c 'ulimit -f 1; exec "$@"' sh "$cln" export "$r" --octree "$work/large.ply"
    check "a file beyond its limit is an error, and leaves nothing" eval \
        '[ "$rc" = 7 ] && ! ls "$work"/large.ply* 2>/dev/null'
    for kind in avi webp; do expect "a film of a kind that is not written" 2 "~a.$kind .mp4" \
        "$cln" render "$r" -o "$work/a.$kind"; done
    expect "--fps without a film" 2 "fps" "$cln" render "$r" --fps 30 -o "$work/fps"
    expect "depths of a film" 2 "pfm" "$cln" render "$r" --pfm -o "$work/a.gif"
    expect "their kind" 2 "z-depth" "$cln" render "$r" --orbit 2 --z-depth -o "$work/a.gif"
    expect "a mesh whose name does not tell its format" 2 "~end.the.name .ply" \
        "$cln" export "$r" --mesh "$work/a"
    expect "a mesh for the web: which name" 2 "a.gltf ~\.glb:.end" \
        "$cln" export "$r" --mesh "$work/a.gltf"
    expect "a mesh for a phone" 2 "a.usdz .glb" "$cln" export "$r" --mesh "$work/a.usdz"
    expect "points for a slicer" 2 "~points.writes.\.ply" "$cln" export "$r" --points "$work/a.stl"
    run "$cln" render "$r" --orbit 3 --width 16 -o "$work/circle" --progress none
    expect "a shorter path in the folder of a longer one: what stays is told" 0 \
        "~2.other.frames.*stay" "$cln" render "$r" --orbit 1 --width 16 -o "$work/circle"
    check "and recorded" [ "$("$query" earlier_frames <"$work/circle/render.json")" = 2 ]
    rm "$work/circle/orbit_0002.png"
    expect "a frame that was removed" 0 "~1.other.frame.*stays" \
        "$cln" render "$r" --orbit 1 --elevation 5 --width 16 -o "$work/circle" --overwrite
    check "is not named any more" eval '! grep -q orbit_0002 "$work/circle/render.json"'
    # two paths in a folder: each one's depth pictures are on the scale that render.json tells
    run "$cln" render "$r" --orbit 2 --width 16 -o "$work/two paths" --progress none
    cp -r "$work/two paths" "$work/one path"
    run "$cln" render "$r" --spiral 2 --width 16 -o "$work/two paths" --progress none
    expect "the first path again" 0 "~2.other.frames.*stay" \
        "$cln" render "$r" --orbit 2 --width 16 -o "$work/two paths"
    check "the scale is its own again" \
        [ "$("$query" depth_picture.near <"$work/two paths/render.json")" = \
            "$("$query" depth_picture.near <"$work/one path/render.json")" ]
    check "and so are its pictures" cmp "$work/one path/orbit_0001.depth.png" \
        "$work/two paths/orbit_0001.depth.png"
    rm "$work/two paths/spiral_"*
    run "$cln" render "$r" --orbit 2 --width 16 -o "$work/two paths" --progress none
    check "alone in it, render.json is as if nothing had been" cmp "$work/one path/render.json" \
        "$work/two paths/render.json"
    run "$cln" render "$r" --orbit 4 --width 16 -o "$work/four" --progress none
    cp -r "$work/four" "$work/four more"
    expect "one of its frames again" 0 "" "$cln" render "$r" --orbit 4 --width 16 --frames 2 \
        --overwrite -o "$work/four more"
    check "its picture of depth is on the scale of the others" cmp \
        "$work/four/orbit_0002.depth.png" "$work/four more/orbit_0002.depth.png"
    run "$cln" render "$r" --orbit 4 --width 16 -o "$work/four" --frames 2-3 --overwrite \
        --background black
    expect "some frames that would be others: they are named" 7 \
        "~2.of.these.4.frames.*.orbit_0002,.orbit_0003. ~remove.their..png" "$cln" render "$r" \
        --orbit 4 --width 16 -o "$work/four"
    rm "$work/four/orbit_0002.png" "$work/four/orbit_0003.png"
    run "$cln" render "$r" --orbit 4 --width 16 -o "$work/four"
    check "without them, they alone are rendered" grep -q "2 rendered .*, 2 left" "$work/out"
    echo '{' >"$work/four/render.json"
    expect "what an earlier render left is damaged: a way out" 3 \
        "~four/render.json ~another.folder.with.-o" "$cln" render "$r" --orbit 1 -o "$work/four"
    # two renders at once would mix their frames
    env --default-signal=INT "$cln" render "$r" --orbit 5000 --width 64 -o "$work/held" -q \
        >/dev/null 2>&1 &
    c=$!
    for _ in $(seq 100); do
        [ ! -e "$work/held/render.json" ] || break
        sleep 0.1
    done
    expect "a folder that another process renders into" 7 \
        "~held:.process.$c.on.*renders.into ~-o" "$cln" render "$r" --orbit 1 -o "$work/held"
    kill -INT $c
    wait $c
    check "is free when that ends" [ ! -e "$work/held/lock" ]
    "$make_scene" "$work/cut" --size 16 --train 2 --test 1 >/dev/null
    echo broken >"$work/cut/test/r_000.png"
    expect "poses whose photo is broken" 3 "r_000.png" "$cln" render "$r" \
        --poses "$work/cut/transforms_test.json" -o "$work/cut-views"
    check "no picture is rendered" [ ! -e "$work/cut-views" ]
    expect "a crop box that is elsewhere: a warning" 0 "~crop: ~nothing ~cube" \
        "$cln" render "$r" --orbit 1 --width 8 -o "$work/cropped" --crop 1000,0,0,1001,1,1
    expect "an export of it: refused" 2 "~crop: ~nothing ~cube" \
        "$cln" export "$r" --mesh "$work/x.ply" --crop 1000,0,0,1001,1,1
    expect "colours of boxes, for points" 2 "--colour ~no.effect.on.--points octree" \
        "$cln" export "$r" --points "$work/x.ply" --colour error
    expect "--tree-from a missing run: refused early" 3 "$work/none --tree-from" \
        "$cln" train "$work/my scene" -o "$work/on" --tree-from "$work/none"
    check "no kernel was checked" not_said "checking the kernels"
    expect "export to a name of another format" 2 ".obj .ply" \
        "$cln" export "$r" --octree "$work/x.obj"
    check "no export of another format is written" [ ! -e "$work/x.obj" ]
    expect "export to standard output" 0 "leaves" "$cln" export "$r" --octree -
    check "the step is the model's, not the export's" said ", of the model at step"
    check "standard output has the file" [ "$(head -c 3 "$work/out")" = ply -a ! -e ./- ]
    cp "$work/out" "$work/piped"
    expect "export to a file" 0 "" "$cln" export "$r" --octree "$work/x.PLY"
    check "the file has the same bytes" cmp "$work/piped" "$work/x.PLY"
    check "the line tells how many" grep -qE ", [0-9.]+ ([KM]i)?B, of the model" "$work/out"
    expect "so does the document" 0 "" \
        "$cln" export "$r" --octree "$work/x.PLY" --overwrite --json
    check "to the byte" [ "$(json bytes)" = "$(stat -c %s "$work/x.PLY")" ]
    expect "standard output for export and --json" 2 "--json" "$cln" export "$r" --octree - --json
    expect "standard output that is full" 7 "" bash -c 'exec "$@" >/dev/full' full "$cln" export \
        "$r" --octree -
    on_terminal 80 "$cln" export "$r" --octree -
    check "standard output that is a terminal" grep -q "is a terminal" "$work/out"
    "$cln" render "$r" --orbit 1 --width 8 -q >/dev/null 2>&1
    expect "existing frames" 0 "" "$cln" render "$r" --orbit 1 --width 8
    check "the line names --overwrite" printed "1 left as it is (--overwrite renders all again)"
    expect "a kernel folder without kernels" 3 "~no.kernel.file kernels/" \
        "$cln" render "$r" --orbit 2 --kernel-dir "$work"
    expect "render of a split, smaller" 0 "" "$cln" render "$r" --width 16 --max-images 1 -q
    check "the smaller render has that size" \
        [ "$(od -An -tu1 -j18 -N6 "$r/render/test/test_r_000.png" |
        tr -s ' ')" = " 16 0 0 0 16" -o \
        "$(od -An -tu1 -j16 -N8 "$r/render/test/test_r_000.png" | tr -s ' ')" = \
        " 0 0 0 16 0 0 0 16" ]
}

run_sections "words scenes training voxels results" "$@"
