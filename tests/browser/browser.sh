#!/bin/bash
# The viewer's page in headless Chromium, through chromedriver: it loads, follows mouse, touch and
# keys, shows what `render` makes, saves paths, asks nobody else, and nothing in a hidden tab, keeps
# messages until they are read, and says nothing on the console; two viewers at once; by keys alone;
# on a phone, dark and light; of a training, it follows and steers it. The report and check's page
# fit a phone.
# On a small generated scene; screenshots to look at are left in build/browser/. Not part of `make
# test`: Chromium is a large download.
#   tests/browser/browser.sh [PAGE...]
#           pages: desktop dark phone two documents training
set -u
cd "$(dirname "$0")/../.." || exit 1

work=$(mktemp -d "${TMPDIR:-/tmp}/cln-browser-XXXXXX")
server=0
trap '[ $server = 0 ] || kill $server; rm -rf "$work"' EXIT
. tests/support/checks.sh

mkdir -p build/browser
"$make_scene" "$work/photos" --size 100 --train 20 --test 2 >/dev/null || bad "make-scene"
expect "train" 0 "" "$cln" train "$work/photos" -o "$work/run" --steps 500 --skip-selftest \
    --progress none
expect "render" 0 "" "$cln" render "$work/run" --split test -o "$work/rendered" --progress none

pages=${*:-desktop dark phone two documents training}
for page in $pages; do
    case $page in desktop | dark | phone | two | documents | training) ;; *)
        echo "$0: no page '$page'; pages: desktop dark phone two documents training" >&2
        exit 2
        ;;
    esac
done

# drive RENDERED [NEXT...]: the checks of browser.py at the server's address
drive() {
    local rc
    touch "$work/log"
    for _ in $(seq 300); do
        [ -s "$work/address" ] && break
        sed -n 's/.*in a browser: //p' "$work/log" >"$work/address"
        sleep 0.2
    done
    python3 tests/browser/browser.py "$(cat "$work/address")" "$1" build/browser "$pages" "${@:2}" \
        >"$work/checks" 2>"$work/err"
    rc=$?
    cat "$work/checks"
    passed=$((passed + $(grep -c '^ok' "$work/checks")))
    failed=$((failed + $(grep -c '^FAILED' "$work/checks")))
    check "the driver ran to its end" [ $rc = 0 ]
}

case " $pages " in
*" documents "*)
    cp "$work/run/report.html" "$work/report.html"
    expect "check with a page" 0 "" "$cln" check "$work/photos" --probe 0 -o "$work/check.html"
    echo "file://$work" >"$work/address"
    drive documents
    ;;
esac

if [[ " $pages " =~ " "(desktop|dark|phone|two)" " ]]; then
    "$cln" view "$work/run" >"$work/address" 2>"$work/log" &
    server=$!
    drive "$work/rendered/test_r_000.png"
    kill $server
fi
case " $pages " in
*" training "*) ;;
*)
    server=0
    count
    exit
    ;;
esac
: >"$work/address"
"$cln" train "$work/photos" -o "$work/watched" --time-limit 10m --skip-selftest --view \
    >"$work/out" 2>"$work/log" &
server=$!
drive training "$cln" view "$work/run"
wait $server
check "the training was stopped" [ $? = 130 ]
server=0
count
