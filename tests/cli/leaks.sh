#!/bin/bash
# Every command of the program under AddressSanitizer and LeakSanitizer, on a tiny generated scene:
# with good input, and with input that it refuses. Each must end with its exit code and without a
# report of a sanitizer; tests/support/lsan.supp has what the driver keeps, with reasons. A command
# of `--help` or an export that is not run here fails. Other scripts test what the commands do.
#
#   tests/cli/leaks.sh [SECTION...]    sections: noticed words train results exports checks view
#                                      refused, and after these all
#   BUILD=build/sanitize               the programs to test
set -u
cd "$(dirname "$0")/../.." || exit 1

BUILD=${BUILD:-build/sanitize}
work=$(mktemp -d "${TMPDIR:-/tmp}/cln-leaks-XXXXXX")
server=0
trap '[ $server = 0 ] || kill -9 $server; rm -rf "$work"' EXIT
. tests/support/checks.sh
export ASAN_OPTIONS=allocator_may_return_null=1:detect_leaks=1
export UBSAN_OPTIONS=halt_on_error=1:print_stacktrace=1:suppressions=$PWD/tests/support/ubsan.supp
export LSAN_OPTIONS=suppressions=$PWD/tests/support/lsan.supp:print_suppressions=0

telling='Sanitizer|runtime error'
used=" " # commands and options that were run
blind=0  # number of them without a result

# clean CODE COMMAND [ARGUMENTS]...: it ends with this exit code, and a sanitizer is silent
clean() {
    local code=$1 word
    shift
    for word in "$@"; do
        case $word in --* | [a-z]*) used="$used$word " ;; esac
    done
    run "$cln" "$@"
    sound "$code" "cl-nascent ${*//"$work"\//}"
}

# sound CODE NAME: the same of the last command
sound() {
    if said "LeakSanitizer has encountered a fatal error"; then
        skip "$2" "LeakSanitizer failed, as a thread of the driver ended during its check"
        blind=$((blind + 1))
    elif grep -qE "$telling" "$work/out" "$work/err"; then
        grep -E "$telling|^ +#" "$work/err" | head -n 30
        bad "$2" "a sanitizer reports"
    elif [ $rc != "$1" ]; then
        bad "$2" "exit code $rc, not $1"
    else
        ok "$2"
    fi
}

scene() {
    [ -d "$work/scene" ] || "$make_scene" "$work/scene" --size 24 --train 6 --test 2 --depth \
        >/dev/null || bad "make-scene"
}

# A tree that grows, is culled and restructured, gains and poses that are learnt.
trained() {
    scene
    [ -d "$work/run" ] || clean 0 train "$work/scene" -o "$work/run" "${tiny[@]}" --steps 40 \
        --level-at 2:0.4 --cull-from 0.3 --cull-after 0 --structure-from 0.5 \
        --structure-every 0.2 --split-samples 0 --distil-steps 3 --max-leaves 60 \
        --eval-at 0.1s --save-every 1
}

# Leaks are looked for: that of a library loaded into the program is reported.
section_noticed() {
    echo '#include <stdlib.h>
        void *lost;
        __attribute__((constructor)) static void lose(void) { lost = malloc(77); lost = NULL; }' \
        >"$work/lose.c"
    ${CC:-gcc} -O0 -shared -fPIC "$work/lose.c" -o "$work/lose.so"
    ASAN_OPTIONS=$ASAN_OPTIONS:verify_asan_link_order=0 LD_PRELOAD=$work/lose.so run "$cln" version
    check "a leak is noticed" said "77 byte(s) leaked"
    check "a leak changes the exit code" [ $rc != 0 ]
}

section_words() {
    local name
    clean 0 --version -v
    clean 0 version
    clean 0 --help
    clean 0 help train
    clean 2
    clean 2 trian
    clean 2 train s -o r --stepz 5
    clean 2 train s -o r --width 3
    clean 2 render r --orbit --spiral
    for name in bash zsh fish; do
        clean 0 completion $name
    done
    clean 2 completion csh
}

section_train() {
    trained
    clean 0 train --resume "$work/run" --skip-selftest --progress none --steps 50
    clean 7 train "$work/scene" -o "$work/run" "${tiny[@]}" --steps 2
    clean 0 train "$work/scene" -o "$work/splat" "${tiny[@]}" --steps 10 --stage1 splat \
        --encoding grid --grid-cells 4 --edge 0.1 --sparsity 0.1
    clean 0 train "$work/scene" -o "$work/refined" "${tiny[@]}" --steps 10 --refine-poses \
        --exposure
    # interrupted, saved and resumed
    env --default-signal=INT "$cln" train "$work/scene" -o "$work/stopped" "${tiny[@]}" \
        --steps 1000000 --log-every 1 >"$work/out" 2>"$work/err" &
    server=$!
    until [ "$(wc -l 2>/dev/null <"$work/stopped/metrics.jsonl")" -ge 5 ] 2>/dev/null; do
        kill -0 $server 2>/dev/null || break
        sleep 0.1
    done
    kill -INT $server
    wait $server
    rc=$? server=0
    sound 130 "train, interrupted"
    "$make_scene" "$work/forward" --kind forward --format llff --size 24 --train 8 --test 2 \
        >/dev/null
    clean 0 train "$work/forward" -o "$work/llff" "${tiny[@]}" --steps 10 --space ndc
    clean 0 render "$work/llff" --spiral 2 --width 16 --progress none
}

section_results() {
    trained
    clean 0 eval "$work/run" --seams --antialias 2 --progress none
    clean 0 eval "$work/run" --views r_000.png,test/r_000 --no-save-images --progress none
    clean 2 render "$work/run" --views r_00 --progress none
    clean 9 eval "$work/run" --min-psnr 99 --no-save-images --fast --json --progress none
    clean 0 render "$work/run" --normals --seen --pfm --depth-unit 0.001 --z-depth --progress none
    clean 0 render "$work/run" --orbit 2 --circle --stereo 0.1 --width 16 --progress none
    clean 0 render "$work/run" --spiral 2 --width 16 --depth mean --progress none
    clean 0 render "$work/run" --interpolate 3 --width 16 -o "$work/film.y4m" --progress none
    clean 0 render "$work/run" --poses "$work/scene/transforms_test.json" -o "$work/posed" \
        --crop "-1,-1,-1,1,1,1" --max-images 1 --progress none
    clean 0 info "$work/scene" --like "$work/run"
    clean 0 info "$work/run" --json
    clean 0 bugreport "$work/run"
}

section_exports() {
    local kind
    trained
    clean 0 export "$work/run" --octree - --colour error
    clean 0 export "$work/run" --cameras "$work/cameras.json"
    clean 0 export "$work/run" --cameras "$work/cameras"
    clean 0 export "$work/run" --points "$work/points.ply" --count 500
    clean 0 export "$work/run" --volume "$work/volume.npy" --spacing 0.5
    clean 0 export "$work/run" --mesh "$work/mesh.ply" --spacing 0.2 --closed
    clean 0 export "$work/run" --mesh "$work/part.ply" --spacing 0.2 --crop=-0.1,-2,-2,2,2,2
    clean 2 export "$work/run" --mesh "$work/none.ply" --crop 90,90,90,91,91,91
    clean 0 export "$work/run" --mesh "$work/mesh.obj" --spacing 0.2 --triangles 50 --up x --scale 2
    clean 0 export "$work/run" --mesh "$work/one.ply" --spacing 0.2 --largest
    clean 0 export "$work/run" --mesh "$work/mesh.glb" --spacing 0.2
    clean 0 export "$work/run" --mesh "$work/mesh.stl" --spacing 0.2
    clean 7 export "$work/run" --points "$work/points.ply"
    for kind in $("$cln" export --help | grep -oE '^ +--[a-z]+ FILE' | grep -oE -- '--[a-z]+'); do
        case $kind in
        --tune | --tune-file) ;;
        *) check "$kind is exported here" grep -q -- " $kind " <<<"$used" ;;
        esac
    done
}

section_checks() {
    scene
    clean 0 devices
    clean 0 devices --no-test --json
    clean 0 selftest --quick
    clean 0 check "$work/scene" --probe 0 -o "$work/check.html"
    clean 0 check "$work/scene" --probe 1 "${tiny[@]:3}" --json
    clean 0 tune --preset fast --width 16 --depth 2 --view-width 16 --bands 2 --view-bands 1 \
        --budget 1 --progress none -o "$work/rows.txt"
    mkdir -p "$work/bin"
    cp tests/support/colmap "$work/bin/colmap"
    PATH="$work/bin:$PATH" clean 0 poses "$work/scene/train" -o "$work/found" --progress none
    PATH="$work/bin:$PATH" STAND_IN=nothing clean 1 poses "$work/scene/train" -o "$work/none"
    PATH="$work/bin:$PATH" clean 3 poses "$work/scene/train" -o "$work/placed" --gps
}

# asks CODE PATH OPTIONS...: the viewer's answer is in $work/body
asks() {
    local want=$1 path=$2 code
    shift 2
    code=$(curl -sg --max-time 60 -o "$work/body" -w '%{http_code}' -H "X-Viewer: me" "$@" \
        "${address%/}/$path")
    if [ "$code" != "$want" ]; then bad "view answers $path" "$code, not $want"; fi
}

# The viewer: a page, pictures, a film, requests that it refuses.
section_view() {
    local address="" end=$((SECONDS + 120)) film
    trained
    : >"$work/out"
    env --default-signal=INT "$cln" view "$work/run" >"$work/out" 2>"$work/err" &
    server=$!
    used="$used view "
    until [ -s "$work/out" ] || [ $SECONDS -ge $end ]; do
        sleep 0.1
    done
    address=$(head -n 1 "$work/out")
    asks 200 ""
    asks 200 facts
    asks 200 "picture?view=0&ms=1000"
    asks 200 "picture?view=1&show=opacity&format=png&crop=-1,-1,-1,1,1,1,0,0,30"
    asks 200 "photo?view=0"
    asks 200 "point?view=0&x=0.5&y=0.5"
    asks 400 "picture?pose=1"
    asks 404 nothing
    asks 200 "film/begin?width=24&height=24&frames=1" -X POST
    film=$("$query" film <"$work/body")
    asks 200 "film/frame?film=$film&view=0" -X POST
    asks 200 "film/end?film=$film" -X POST
    asks 200 "film?film=$film"
    asks 409 "film/frame?film=$film&view=0" -X POST
    kill -INT $server
    wait $server
    rc=$? server=0
    sound 0 "view, some requests, Ctrl-C"
}

# Ordinary mistakes, each on a way out of its own.
section_refused() {
    local run=$work/broken file
    trained
    clean 3 info "$work/nowhere"
    clean 3 train "$work/nowhere" -o "$work/never" "${tiny[@]}" --steps 1
    clean 3 eval "$work/nowhere"
    clean 3 train --resume "$work/scene"
    cp -r "$work/scene" "$work/bad"
    echo '{"frames": [{' >"$work/bad/transforms_train.json"
    clean 3 info "$work/bad"
    clean 3 check "$work/bad" --probe 0
    cp "$work/scene/transforms_train.json" "$work/bad/"
    file=$(find "$work/bad/train" -name '*.png' ! -name '*.*.*' | sort | head -n 1)
    head -c 100 "$file" >"$file.new" && mv "$file.new" "$file"
    clean 3 train "$work/bad" -o "$work/never" "${tiny[@]}" --steps 1
    clean 3 selftest --quick --tune-file "$work/nowhere"
    clean 4 selftest --quick --device "no such device"
    cp -r "$work/run" "$run"
    for file in "$run"/checkpoint/*.safetensors; do
        head -c 1000 "$file" >"$file.new" && mv "$file.new" "$file"
    done
    clean 8 eval "$run" --progress none
    clean 8 export "$run" --octree -
    echo '{' >"$run/run.json"
    clean 3 info "$run"
    clean 3 render "$work/run" --poses "$work/bad/train" --progress none
    clean 2 export "$work/run" --mesh "$work/mesh.fbx"
}

# Every command that the program names was run.
section_all() {
    local name
    for name in $("$cln" --help | sed -n '/^Commands:/,/^$/s/^  \([a-z]*\) .*/\1/p'); do
        check "$name was run" grep -q " $name " <<<"$used"
    done
    check "few commands were without a result" [ $blind -lt 4 ]
}

run_sections "noticed words train results exports checks view refused all" "$@"
