#!/bin/bash
# Scenes that are wrong, or look it: what `info` and `train` doubt, and what `check` finds. On tiny
# generated scenes, with faults planted.
#   tests/cli/check.sh [SECTION...]       sections: doubts nadir check parts plain shown
#   BUILD=build/sanitize                   the programs to test
set -u
cd "$(dirname "$0")/../.." || exit 1

work=$(mktemp -d "${TMPDIR:-/tmp}/cln check XXXXXX")
trap 'rm -rf "$work"' EXIT
. tests/support/checks.sh

small=("${tiny[@]}" --steps 20)

# turn SCENE FACTORS [rows]: every pose's four columns (or rows) times these, in its transforms
turn() {
    local file
    for file in "$1"/transforms*.json; do
        awk -v factors="$2" -v rows="${3:-}" 'BEGIN { split(factors, by, " ") }
            /"transform_matrix"/ { k = 0; inside = 1 }
            inside && /^ *-?[0-9][0-9.e+-]*,?$/ {
                comma = /,$/ ? "," : ""
                sub(/,$/, "")
                factor = by[(rows ? int(k / 4) : k % 4) + 1]
                $0 = sprintf("%.17g%s", $0 * (k < 12 ? factor : 1), comma)
                inside = ++k < 16
            }
            { print }' "$file" >"$work/turned" && mv "$work/turned" "$file"
    done
}

section_doubts() {
    "$make_scene" "$work/axes" --format nerfstudio --size 16 --train 20 >/dev/null
    expect "info of cameras around an object" 0 "" "$cln" info "$work/axes"
    check "cameras around an object: nothing is doubted" [ ! -s "$work/err" ]
    "$make_scene" "$work/nearly" --format nerfstudio --size 24 --train 20 --test 3 >/dev/null
    perl -i -pe 's/("[wh]": )24,/${1}23,/' "$work/nearly/transforms.json"
    expect "photos of nearly their cameras' size" 0 \
        "~cameras.are.scaled.*so.small.a.difference.*undistorted" "$cln" info "$work/nearly"
    run "$cln" check "$work/nearly" --probe 0
    check "check makes a remark of it" grep -q "remark size: 23 of 23 images have nearly" \
        "$work/out"
    perl -i -pe 's/("[wh]": )23,/${1}48,/' "$work/nearly/transforms.json"
    expect "half of it is a smaller copy" 0 "~cameras.are.scaled" "$cln" info "$work/nearly"
    check "and no small difference" eval '! said "so small a difference"'
    turn "$work/axes" "1 -1 -1 1"
    expect "with OpenCV's axes: the likely cause" 0 "~look.apart likely ~negate.the.second" \
        "$cln" info "$work/axes"
    expect "train says so, too" 0 "~look.apart" \
        "$cln" train "$work/axes" -o "$work/apart" "${small[@]}" --steps 1
    "$make_scene" "$work/units" --format ngp --size 16 --train 20 >/dev/null
    expect "info of a scene with a cube of its own" 0 "" "$cln" info "$work/units"
    check "a cube of its own: nothing is doubted" [ ! -s "$work/err" ]
    cp -r "$work/units" "$work/halves"
    sed -i -E '/"[wh]": /d; s/"(fl_x|fl_y|cx|cy)": ([0-9.]+)/"\1": 1\2/' \
        "$work/halves"/transforms.json
    expect "a camera of larger photos, without their size: train says so" 0 \
        "~principal.point.is.outside ~another.image.size" \
        "$cln" train "$work/halves" -o "$work/half" "${small[@]}" --steps 1
    cp -r "$work/units" "$work/small"
    turn "$work/units" "1 1 1 8"
    expect "translations too large: the likely cause" 0 "~training.rays.meet ~likely.the.scale" \
        "$cln" info "$work/units"
    turn "$work/small" "1 1 1 .001"
    expect "translations too small" 0 "~too.near ~likely.the.scale" "$cln" info "$work/small"
    turn "$work/small" "1 1 1 0"
    expect "no translations" 0 "~one.place" "$cln" info "$work/small"
    expect "check prints finite numbers only" 0 "" "$cln" check "$work/small" --probe 0
    check "nothing is nan" eval '! grep -q nan "$work/out"'
    "$make_scene" "$work/room" --kind room --size 16 --train 20 >/dev/null
    expect "info of a room from inside" 0 "" "$cln" info "$work/room"
    check "a room from inside: nothing is doubted, but that it shows no transparency" \
        [ "$(grep -vc 'opaque everywhere and count as none' "$work/err")" = 0 ]
}

# A village by photos straight down alone, in a survey's coordinates and in a file without points:
# nothing tells how far it is.
section_nadir() {
    local air=$work/nadir half box
    "$make_scene" "$air" --kind terrain --size 96 --train 24 --test 0 --format nerfstudio \
        --offset 500000,4600000,90 >/dev/null
    rm "$air"/images/frame_000{13..24}.png # the oblique ones
    expect "info of a place far from the origin" 0 "" "$cln" info "$air" --missing skip
    check "tells it to a thousandth of the cube" \
        grep -qE '^centre +(499999|500000)\.[0-9]{2,}, (4599999|4600000)\.[0-9]+,' "$work/out"
    expect "cameras that look in parallel: the cube is a guess, and what to do" 0 \
        "~guess.*in.parallel ~cl-nascent.check.*--bbox" "$cln" info "$air" --missing skip --json
    half=$(json half)
    expect "check takes a box and a shell, as train does" 0 "~look.in.parallel ~--space.shell" \
        "$cln" check "$air" --missing skip --probe 0 --json
    box=$(grep -o -- '--bbox=[-+.,0-9e]*' "$work/err")
    check "around the village and not much more: $box, where the guess has half a side of $half" \
        awk -v box="${box#--bbox=}" -v half="$half" 'BEGIN {
            n = split(box, b, ",")
            for (a = 1; a <= 3; a++) if (b[a + 3] - b[a] > half) exit 1
            for (a = 1; a <= 6; a++) b[a] -= a % 3 == 1 ? 500000 : a % 3 == 2 ? 4600000 : 90
            exit !(n == 6 && b[1] < -0.8 && b[2] < -0.8 && b[3] < -0.15 && b[4] > 0.8 &&
                b[5] > 0.3 && b[6] < 1)
        }'
    expect "which is taken" 0 "" "$cln" info "$air" --missing skip "$box" --json
    check "without a guess" eval '! said guess'
}

# planted FAULT WHAT GRADE OPTIONS...: make-scene with this fault; check finds WHAT (a word, spaces
# are _) as a likely fault (true) or a remark (false)
planted() {
    local fault=$1 what=${2//_/ } grade=$3 i=0 found=no
    shift 3
    rm -rf "$work/planted"
    "$make_scene" "$work/planted" "$@" --fault "$fault" >/dev/null || bad "make-scene $fault"
    run "$cln" check "$work/planted" --probe 0 --json
    while [ -n "$(json "findings.$i.what")" ]; do
        [ "$(json "findings.$i.what") $(json "findings.$i.likely_fault")" = "$what $grade" ] &&
            found=yes
        i=$((i + 1))
    done
    check "planted: $fault, found: $what" [ $rc$found = 0yes ]
}

# Points that the page draws from three sides, and those that it counts as not in the picture.
drawn() {
    perl -0ne '$n += () = /M[-.0-9]+ [-.0-9]+h0/g; $n += $_ for /, ([0-9]+) points/g; print $n' \
        "$work/page.html"
}

section_check() {
    local points i
    local front="--kind forward --size 64 --train 12 --test 2"
    local air="--kind terrain --size 64 --train 24 --test 0 --format nerfstudio"
    local all="--size 64 --train 28 --test 1"

    # shellcheck disable=SC2086
    "$make_scene" "$work/sound" $front >/dev/null
    expect "check of a sound scene" 0 "" "$cln" check "$work/sound" --probe 0
    check "check finds nothing in a sound scene" grep -q '^0 likely faults, 0 remarks$' "$work/out"
    check "check says the memory of a sound scene" grep -q '^memory .* on the device' "$work/out"
    expect "with a probe" 0 "" "$cln" check "$work/sound" --probe 0.1 --json \
        --preset fast --width 16 --depth 2
    check "check --probe times a step" number_above "$(json training.time.step_seconds)" 0
    check "check --probe: a step takes less than a minute" \
        number_above 60 "$(json training.time.step_seconds)"
    check "a step's time lies between those of the first and the largest tree" \
        awk -v s="$(json training.time.step_seconds)" \
        -v a="$(json training.time.step_seconds_first)" \
        -v b="$(json training.time.step_seconds_last)" \
        'BEGIN { exit !(a > 0 && b > 0 && (s - a) * (s - b) <= 0) }'
    check "the budget's time is that of its steps" \
        awk -v t="$(json training.time.seconds)" -v n="$(json training.steps)" \
        -v s="$(json training.time.step_seconds)" \
        'BEGIN { exit !(n > 0 && t > 0.999 * n * s && t < 1.001 * n * s) }'
    expect "with a probe, one network" 0 "" "$cln" check "$work/sound" --probe 0.1 --json \
        --preset nerf --width 16 --depth 2 --no-skip
    check "whose tree stays as it is" [ "$(json training.time.step_seconds_first)" = \
        "$(json training.time.step_seconds_last)" ]
    check "check --probe times a picture" number_above "$(json training.time.picture_seconds)" 0
    check "check --probe: a picture takes less than ten seconds" \
        number_above 10 "$(json training.time.picture_seconds)"
    check "no likely fault as JSON, too" [ -z "$(json findings.0.what)" ]
    check "photos agree with poses" number_above "$(json measures.agreeing_share)" 0.8
    expect "in words, for a budget in seconds" 0 "" "$cln" check "$work/sound" --probe 0.1 \
        --preset fast --width 16 --depth 2 --time-limit 10
    check "steps, a step and a picture" eval 'tr "\n" " " <"$work/out" | tr -s " " | grep -qE \
        "about [0-9]+ steps within --time-limit, [0-9.]+ ms a step .* ms a picture"'
    expect "check with a page" 0 "" "$cln" check "$work/sound" --probe 0 -o "$work/page.html"
    check "it shows 14 photos" [ "$(grep -c 'base64,' "$work/page.html")" = 14 ]
    "$make_scene" "$work/many" --size 16 --train 260 --test 0 >/dev/null || bad "make-scene"
    for photo in "$work/many/train/"r_*.png; do
        [ "$photo" -ef "$work/many/train/r_000.png" ] ||
            cp "$work/many/train/r_000.png" "$photo"
    done
    run "$cln" check "$work/many" --probe 0 -o "$work/many.html"
    check "of 260 that findings name it shows 200, and one in 5 of the others" \
        [ "$(grep -c 'base64,' "$work/many.html")" = 212 ]
    check "and says so" grep -q "And 60 more that findings name" "$work/many.html"
    check "photos say by which finding" grep -q "; named by the [a-z]* [a-z ]*</span>" \
        "$work/many.html"
    check "a sentence that names few says how to see all" grep -q "that are meant: -v)" "$work/out"
    run "$cln" check "$work/many" --probe 0 -v
    check "which lists them" \
        eval '[ "$(grep -o "r_[0-9]*" "$work/out" | sort -u | wc -l)" -ge 260 ]'
    check "without that word" eval '! grep -q "are meant: -v" "$work/out"'
    check "and every camera from three sides" \
        [ "$(grep -c '</title><line' "$work/page.html")" = 42 ]
    check "the cube from three sides" \
        [ "$(grep -c "<rect x=.*stroke='#1d2329'" "$work/page.html")" = 3 ]
    run "$cln" check "$work/sound" --probe 0 --json
    points=$(json points)
    check "and every point, or the number of those beyond the picture" [ "$(drawn)" = \
        $((3 * ${points#array })) ]
    check "which are some" [ "${points#array }" -gt 10 ]
    check "it refers to nothing elsewhere" \
        eval '! grep -qE "(src|href)=.?(http|/)" "$work/page.html"'
    expect "a page that is there" 7 "page.html --overwrite" \
        "$cln" check "$work/sound" --probe 0 -o "$work/page.html"
    expect "a page of another kind" 2 "html" "$cln" check "$work/sound" -o "$work/page.pdf"
    expect "options of train are known" 2 "steps" "$cln" check "$work/sound" --steps x
    "$make_scene" "$work/blurred" --size 16 --train 3 --test 0 >/dev/null
    expect "photos too small to have anything in common" 0 "" "$cln" check "$work/blurred" \
        --probe 0 --json
    check "nothing is said of their exposures" [ "$(grep -c '"exposure": null' "$work/out")" = 3 ]

    "$make_scene" "$work/pair" --kind forward --size 64 --train 2 --test 0 >/dev/null
    expect "train on two photos: they are too few" 0 "~only.2.training.photos:" \
        "$cln" train "$work/pair" -o "$work/pair run" "${small[@]}" --steps 1
    expect "two photos" 0 "" "$cln" check "$work/pair" --probe 0 --json
    check "check takes two photos for a fault" [ "$(json findings.0.what)" = photos ]
    sed -n 's/^ *"exposure_jump": \([-.0-9e]*\),*$/\1/p' "$work/out" >"$work/jumps"
    check "and nothing around them differs" \
        [ "$(grep -c '"exposure_around": 0.0' "$work/out")" = 2 ]
    check "one is as much darker as the other is brighter" awk '{ sum += $1; most = $1 }
        END { exit !(NR == 2 && sum == 0 && most != 0) }' "$work/jumps"

    # shellcheck disable=SC2086
    {
        planted axes axes true $front
        planted inverse axes true $front
        check "inverted OpenGL matrices are to be inverted" grep -q "with OpenGL's axes" "$work/out"
        turn "$work/planted" "1 -1 -1 1" rows # as COLMAP has them
        expect "COLMAP's own matrices are to be turned, too" 0 "" \
            "$cln" check "$work/planted" --probe 0 --json
        check "it is said" grep -q "with OpenCV's axes .*then negate" "$work/out"
        for i in far:far_camera pose:pose swap:swapped copy:duplicates exposure:exposure; do
            planted ${i/:/ } true $front
        done
        # one has half of the light, a stop less; the others are alike
        sed -n 's/^ *"exposure": \([-.0-9e]*\),$/\1/p' "$work/out" >"$work/exposures"
        check "planted: exposure, by how much" awk '$1 < -0.8 && $1 > -1.2 { dark++ }
            $1 > -0.2 && $1 < 0.2 { alike++ }
            END { exit !(dark == 1 && dark + alike == NR && NR == 14) }' "$work/exposures"
        # an alike photo beside it differs from it, but not its others
        sed -n 's/^ *"exposure_around": \([.0-9e]*\),$/\1/p' "$work/out" >"$work/around"
        check "planted: exposure, how much others differ" \
            awk '$1 < 0.5 { n++ } END { exit !(n == NR && NR == 14) }' "$work/around"
        planted blur blur false $front
        planted focal focal_length true $air
        planted upright orientation true $air --held 1113
        planted upright orientation true $air --held 1113 --format colmap
        planted none orientation false $air --held 1113 --format colmap
        planted mask masks true $all --format nerfstudio --masks
        planted scale scale true $all --format ngp
    }
    check "the box of what the photos show is named" grep -q -- "--bbox=" "$work/out"

    run "$make_scene" "$work/r" --kind room --size 160 --train 30 --test 4 --format nerfstudio
    expect "a room from places far apart" 0 "" "$cln" check "$work/r" --probe 0
    check "no right pose is a fault" grep -q "^0 likely faults" "$work/out"
    # about half of what photos from far apart share fits, but exactly; with the neighbours' poses
    # it fits about
    "$make_scene" "$work/next" --size 96 --train 24 --test 2 >/dev/null
    expect "few photos of an object" 0 "" "$cln" check "$work/next" --probe 0
    check "their poses are no fault" grep -q "^0 likely faults" "$work/out"
    mv "$work/next/train/r_000.png" "$work/next/first.png"
    for i in $(seq 23); do
        mv "$work/next/train/r_$(printf %03d "$i").png" \
            "$work/next/train/r_$(printf %03d $((i - 1))).png"
    done
    mv "$work/next/first.png" "$work/next/train/r_023.png"
    expect "each has the pose of the one before it" 0 "" "$cln" check "$work/next" --probe 0
    check "check says whose they are" eval 'tr "\n" " " <"$work/out" | tr -s " " | grep -q \
        "FAULT order: the photos do not fit .* if each has the pose that the one after it"'
    check "and says nothing of overlap" eval '! grep -q "remark overlap" "$work/out"'

    # so far apart that most marks of two photos are false: true ones fit exactly, by right poses
    "$make_scene" "$work/sparse" --size 200 --train 6 --test 0 --format nerfstudio >/dev/null
    expect "six photos all around an object" 0 "" "$cln" check "$work/sparse" --probe 0
    check "their poses are no fault" grep -q "^0 likely faults" "$work/out"
    check "but little overlaps" grep -q "remark overlap: the photos stand so far apart" "$work/out"
    mv "$work/sparse/images/frame_00001.png" "$work/sparse/first.png"
    for i in 1 2 3 4 5; do
        mv "$work/sparse/images/frame_0000$((i + 1)).png" "$work/sparse/images/frame_0000$i.png"
    done
    mv "$work/sparse/first.png" "$work/sparse/images/frame_00006.png"
    expect "each with the pose of the next" 0 "" "$cln" check "$work/sparse" --probe 0
    check "is a fault" grep -qE "FAULT  (poses|order): the photos do not fit" "$work/out"
}

# Every second photo is given the focal length of a camera that it was not taken with.
section_parts() {
    "$make_scene" "$work/two" --kind terrain --size 128 --train 40 --test 4 --format nerfstudio \
        >/dev/null
    perl -i -pe 's/("file_path": )/"fl_x": 200, "fl_y": 200, $1/ if /"file_path"/ && $n++ % 2' \
        "$work/two/transforms.json"
    expect "every second photo has another camera's focal length" 0 "" \
        "$cln" check "$work/two" --probe 0 --json
    check "that is the fault" [ "$(json findings.0.what)" = "focal length" ]
    check "of these photos: $(json findings.0.views)" [ "$(json findings.0.views)" = "array 22" ]
    check "by that factor, 2.12" grep -qE "every second photo .* 2\.1[0-4] times" "$work/out"

    "$make_scene" "$work/order" --kind room --size 128 --train 40 --test 0 --format nerfstudio \
        >/dev/null
    for i in $(seq 20); do # the opposite order
        mv "$work/order/images/frame_$(printf %05d "$i").png" "$work/first.png"
        mv "$work/order/images/frame_$(printf %05d $((41 - i))).png" \
            "$work/order/images/frame_$(printf %05d "$i").png"
        mv "$work/first.png" "$work/order/images/frame_$(printf %05d $((41 - i))).png"
    done
    expect "names in the opposite order of poses" 0 "" "$cln" check "$work/order" --probe 0 --json
    check "that is the fault, too" [ "$(json findings.0.what)" = order ]
    check "with what would be right" grep -q "if the poses are put .* the opposite order" \
        "$work/out"
}

# untold NAME SCENE: check finds no likely fault, but says that there is too little to tell
untold() {
    expect "$1" 0 "" "$cln" check "$2" --probe 0
    check "no fault is found in so little" grep -q "^0 likely faults" "$work/out"
    check "it is said" grep -q "remark poses: too little to tell" "$work/out"
}

# Surfaces of one colour: photos have few marks, whose places tell little of poses.
section_plain() {
    local i

    "$make_scene" "$work/blocks" --plain --size 32 --train 60 --test 0 --seed 2 >/dev/null
    untold "a plain object, exact poses" "$work/blocks"
    check "and how little" eval 'tr "\n" " " <"$work/out" | tr -s " " | \
        grep -q "a photo has 7 marks (of.*shares 1.8; of 284 marks that two photos share, 61% lie"'
    "$make_scene" "$work/plain" --plain --kind room --size 64 --train 40 --test 0 --seed 2 \
        --format nerfstudio >/dev/null
    expect "a plain room" 0 "" "$cln" check "$work/plain" --probe 0 --json
    check "it shows as little: $(json measures.marks) marks" \
        number_above 20 "$(json measures.marks)"
    check "nothing is a fault" eval '! grep -q "\"likely_fault\": true" "$work/out"'
    mv "$work/plain/images/frame_00001.png" "$work/first.png"
    for i in $(seq 39); do
        mv "$work/plain/images/frame_$(printf %05d $((i + 1))).png" \
            "$work/plain/images/frame_$(printf %05d "$i").png"
    done
    mv "$work/first.png" "$work/plain/images/frame_00040.png"
    expect "each photo with the pose of the one before it" 0 "" "$cln" check "$work/plain" --probe 0
    check "is a fault: hardly any mark fits" \
        grep -qE "FAULT  (poses|order): the photos do not fit" "$work/out"
    expect "no mask of nothing" 3 "~nothing.was.found.that.stands.still" \
        "$cln" check "$work/plain" --probe 0 --write-mask "$work/new/all.png"
    check "and no file" [ ! -e "$work/new" ]
    expect "a mask is a PNG" 2 "~end.the.name.with..png" "$cln" check "$work/plain" --probe 0 \
        --write-mask "$work/all.jpg"
    "$make_scene" "$work/square" --plain --kind street --size 48 --train 24 --test 0 --seed 3 \
        --format nerfstudio >/dev/null
    untold "a plain street, a share that is under the bound by chance" "$work/square"
    "$make_scene" "$work/other" --plain --size 56 --train 24 --test 0 --seed 2 >/dev/null
    expect "a plain object whose few marks fit another focal length, too" 0 "" \
        "$cln" check "$work/other" --probe 0
    check "no focal length is a fault by so little" grep -q "^0 likely faults" "$work/out"
}

# Photos that show nothing are refused, as masks that leave nothing are; where nothing was learnt,
# a high PSNR is no quality.
section_shown() {
    local s=$work/failed i
    local clear=iVBORw0KGgoAAAANSUhEUgAAABAAAAAQCAYAAAAf8/9hAAAAE
    local speck=${clear%E}FUlEQVR42mNgGAWjgAjwH4xGwTAHAMtyAf+SwrCbAAAAAElFTkSuQmCC
    clear+=klEQVR42mNgGAWjYBSMAggAAAQQAAGvRYgsAAAAAElFTkSuQmCC
    "$make_scene" "$s" --size 16 --train 8 --test 2 >/dev/null
    for i in "$s"/t*/*.png; do
        base64 -d <<<"$clear" >"$i"
    done
    expect "alpha is 0 everywhere" 3 "alpha is 0 everywhere ~make.their.masks" \
        "$cln" train "$s" -o "$work/no run" "${small[@]}"
    check "no run is begun" [ ! -e "$work/no run/run.json" ]
    base64 -d <<<"$speck" >"$s/train/r_000.png" # one pixel is opaque
    expect "alpha is 0 in most photos" 0 "~alpha.shows.nothing" \
        "$cln" train "$s" -o "$work/run" "${small[@]}" --steps 60
    expect "eval says that nothing was learnt" 0 "" "$cln" eval "$work/run"
    check "in its last lines" grep -q "the renders show nothing" "$work/out"
    expect "its high PSNR is not enough" 9 "~renders.show.nothing" \
        "$cln" eval "$work/run" --min-psnr 10 --json
    check "and each image has it" [ "$(json images.0.empty) $(json images.1.empty)" = "true true" ]
    check "photos of one colour are not fitted" grep -q '"psnr_fitted": null' "$work/out"
}

run_sections "doubts nadir check parts plain shown" "$@"
