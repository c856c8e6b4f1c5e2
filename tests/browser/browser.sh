#!/bin/bash
# The viewer's page in headless Chromium, through chromedriver: it loads, follows mouse, touch and
# keys, shows what `render` makes, saves paths, asks nobody else, and says nothing on the console.
# On a small generated scene; screenshots to look at are left in build/browser/. Not part of `make
# test`: Chromium is a large download.
#   tests/browser/browser.sh
set -u
cd "$(dirname "$0")/../.." || exit 1

cln=$PWD/build/cl-nascent
make_scene=$PWD/build/make-scene
work=$(mktemp -d "${TMPDIR:-/tmp}/cln-browser-XXXXXX")
server=0
trap '[ $server = 0 ] || kill $server; rm -rf "$work"' EXIT
. tests/support/checks.sh

mkdir -p build/browser
"$make_scene" "$work/photos" --size 100 --train 20 --test 2 >/dev/null || bad "make-scene"
expect "train" 0 "" "$cln" train "$work/photos" -o "$work/run" --time-limit 15s --skip-selftest \
    --progress none
expect "render" 0 "" "$cln" render "$work/run" --split test -o "$work/rendered" --progress none
"$cln" view "$work/run" >"$work/address" 2>"$work/err" &
server=$!
for _ in $(seq 200); do
    [ -s "$work/address" ] && break
    sleep 0.2
done
python3 tests/browser/browser.py "$(cat "$work/address")" "$work/rendered/test_r_000.png" \
    build/browser >"$work/checks" 2>"$work/err"
rc=$?
cat "$work/checks"
passed=$((passed + $(grep -c '^ok' "$work/checks")))
failed=$((failed + $(grep -c '^FAILED' "$work/checks")))
check "the driver ran to its end" [ $rc = 0 ]
count
