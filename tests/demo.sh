#!/bin/sh
# The demo behind `make demo`: generated scene -> two minutes of training -> held-out views -> a
# short orbit, all under build/demo/. Replaces the run of an earlier demo. DEMO_TIME_LIMIT=10m make
# demo trains longer, as a slow machine needs.
set -eu

demo=build/demo
limit=${DEMO_TIME_LIMIT:-2m}

step() {
    printf '\n== %s\n' "$*"
}

rm -rf "$demo/run"
mkdir -p "$demo"
step "a toy steam engine, 60 views to train on and 8 to test with"
build/make-scene "$demo/scene"
step "training for $limit"
build/cl-nascent train "$demo/scene" -o "$demo/run" --time-limit "$limit"
step "held-out views: PSNR and SSIM"
build/cl-nascent eval "$demo/run"
step "an orbit of 12 frames"
build/cl-nascent render "$demo/run" --orbit 12

step "done; look at"
echo "pictures   $demo/run/render/orbit/    colour, .depth.png, .opacity.png"
echo "           $demo/run/eval/            held-out views: render, .truth.png, .error.png"
echo "report     $demo/run/report.html      open it in a browser"
echo "model      $demo/run/checkpoint/$(cat "$demo/run/checkpoint/latest").safetensors"
steps=$(sed 's/^0*//' "$demo/run/checkpoint/latest")
if [ "${steps:-0}" -lt 1500 ]; then
    echo
    echo "This machine made ${steps:-0} steps in $limit, README's picture is of 3,000; for more:"
    echo "DEMO_TIME_LIMIT=20m make demo"
fi
