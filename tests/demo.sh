#!/bin/sh
# The demo behind `make demo`: generated scene -> two minutes of training -> held-out views -> a
# short orbit, all under build/demo/. Replaces the run of an earlier demo.
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
