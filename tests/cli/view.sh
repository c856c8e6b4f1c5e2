#!/bin/bash
# `cl-nascent view` from end to end, by requests: the page, pictures that equal render's, photos and
# points, films, refused clients and requests, slow, silent and vanishing clients, several viewers,
# a run that is trained meanwhile, and how it ends; and `train --view`: the same bits as without,
# orders, who may give them. On a tiny generated scene, on any OpenCL device.
# tests/browser/browser.sh tests the page in a browser.
#   tests/cli/view.sh [SECTION...]
#           sections: page pictures refused clients film token end newer silence training phone
#   BUILD=build/sanitize                the programs to test
set -u
cd "$(dirname "$0")/../.." || exit 1

work=$(mktemp -d "${TMPDIR:-/tmp}/cln view XXXXXX")
server=0 address="" slow=""
with=() # variables of the viewer's environment
run=$work/run
trap '[ $server = 0 ] || kill -9 $server; rm -rf "$work"' EXIT
. tests/support/checks.sh

small=("${tiny[@]}" --steps 60)

baseline() {
    [ -d "$work/run" ] && return
    "$make_scene" "$work/photos" --size 48 --train 6 --test 2 >/dev/null || bad "make-scene"
    expect "train" 0 "" "$cln" train "$work/photos" -o "$work/run" "${small[@]}"
    expect "render" 0 "" "$cln" render "$work/run" --split test -o "$work/rendered" \
        --progress none
}

# serve OPTIONS...: starts a viewer of $run with the signals of a fresh shell; $address: its own
serve() {
    local end=$((SECONDS + 60))
    : >"$work/address"
    env --default-signal=INT,TERM "${with[@]}" "$cln" view "$run" "$@" >"$work/address" \
        2>"$work/err" &
    server=$!
    until [ -s "$work/address" ]; do
        if [ $SECONDS -ge $end ] || ! kill -0 $server 2>/dev/null; then
            bad "view starts"
            break
        fi
        sleep 0.05
    done
    address=$(cat "$work/address")
    address=${address%/}
    address=${address%%/\?*}
}

# stop SIGNAL: ends the viewer; $rc is its exit code
stop() {
    kill -"$1" $server
    wait $server
    rc=$?
    server=0
}

# A viewer for several sections. From its start on, a slow client sends half a request.
viewer() {
    baseline
    [ $server != 0 ] && return
    serve
    exec {slow}<>"/dev/tcp/127.0.0.1/${address##*:}"
    printf 'GET / HTTP/1.1\r\nHost: local' >&"$slow"
}

# get PATH OPTIONS...: body in $work/out, headers in $work/headers, $code
get() {
    local path=$1
    shift
    code=$(curl -sg --path-as-is --max-time 60 -o "$work/out" -D "$work/headers" \
        -w '%{http_code}' "$@" "$address$path" 2>"$work/err")
}

# gets NAME CODE PATH OPTIONS...
gets() {
    local name=$1 want=$2
    shift 2
    get "$@"
    if [ "$code" = "$want" ]; then ok "$name"; else bad "$name" "$code, not $want"; fi
}

has_header() {
    grep -qi -- "$1" "$work/headers"
}

me=(-H "X-Viewer: me")

section_page() {
    local script
    viewer
    check "the address is of this machine" grep -qxE 'http://127\.0\.0\.1:[0-9]+/' "$work/address"
    gets "the page" 200 /
    check "the page is HTML" has_header '^content-type: text/html'
    check "the page may load only from here" \
        has_header "^content-security-policy: default-src 'none';"
    check "its addresses hold behind a path, too" sh -c '! grep -qE "(href|src)=\"/" "$1"' - \
        "$work/out"
    check "the page links nowhere else" sh -c '! grep -qE "https?://" "$1"' - "$work/out"
    check "the page is the source's" cmp -s "$work/out" host/view/page.html
    gets "the page's style" 200 /view.css
    check "the style is the source's" cmp -s "$work/out" host/view/page.css
    gets "the page's script" 200 /view.js
    check "the script is the source's" cmp -s "$work/out" host/view/page.js
    for script in path crop; do
        gets "its script $script" 200 /$script.js
        check "$script.js is the source's" cmp -s "$work/out" host/view/$script.js
    done
    gets "the page's head" 200 / -I
    check "it tells the page's length" \
        has_header "^content-length: $(wc -c <host/view/page.html)"
    gets "the head of nothing" 404 /nowhere -I
    gets "facts" 200 /facts
    check "the facts name the run" [ "$(json run)" = "$work/run" ]
    check "the facts name the step" [ "$(json step)" = 60 ]
    check "the facts have 8 cameras, tests last" [ "$(json cameras.7.split)" = test ]
    check "connections stay open" [ "$(curl -s "$address/" "$address/facts" -o /dev/null \
        -o /dev/null -w '%{num_connects}')" = 10 ]
}

# matrix ROW COLUMN: of the first test view's pose
matrix() {
    "$query" "frames.0.transform_matrix.$1.$2" <"$work/photos/transforms_test.json"
}

section_pictures() {
    local pose focal axis i
    viewer
    gets "a test view as PNG" 200 "/picture?view=6&format=png" "${me[@]}"
    check "render has the same picture" cmp -s "$work/out" "$work/rendered/test_r_000.png"
    gets "the other test view as PNG" 200 "/picture?view=7&format=png" "${me[@]}"
    check "render has the same other picture" cmp -s "$work/out" "$work/rendered/test_r_001.png"
    gets "opacity" 200 "/picture?view=6&format=png&show=opacity" "${me[@]}"
    check "render has the same opacity" cmp -s "$work/out" "$work/rendered/test_r_000.opacity.png"
    get /facts
    focal=$(json cameras.6.focal)
    pose=$(for i in 0 1 2 3 4 5 6 7 8 9 10 11; do json "cameras.6.pose.$i"; done | paste -sd,)
    gets "a free camera" 200 \
        "/picture?pose=$pose&focal=$focal&width=48&height=48&format=png" "${me[@]}"
    check "a free camera in that place sees the same" \
        cmp -s "$work/out" "$work/rendered/test_r_000.png"
    gets "edges as the model learnt them" 200 "/picture?view=6&format=png&edges=1" "${me[@]}"
    check "of one ray a pixel: the same picture" cmp -s "$work/out" "$work/rendered/test_r_000.png"
    gets "edges without a number" 400 "/picture?view=6&edges=2" "${me[@]}"
    gets "another size" 200 "/picture?view=6&width=96" "${me[@]}"
    check "the picture has the requested size" has_header '^x-picture: 96 96 '
    check "JPEG is the default" has_header '^content-type: image/jpeg'
    gets "a picture in no time" 200 "/picture?view=6&width=1000&ms=0.001" "${me[@]}"
    check "the picture is small" has_header '^x-picture: 24 24 '
    gets "depth" 200 "/picture?view=6&show=depth" "${me[@]}"
    check "a depth picture has its scale" \
        awk '/^[Xx]-[Pp]icture/ { exit !($5 > 0 && $6 >= $5) }' "$work/headers"
    gets "another background" 200 "/picture?view=6&background=0,0,1&format=png" "${me[@]}"
    check "another background, another picture" sh -c '! cmp -s "$1" "$2"' - "$work/out" \
        "$work/rendered/test_r_000.png"
    expect "render --crop" 0 "" "$cln" render "$work/run" --split test --max-images 1 \
        -o "$work/cropped" --crop -9,-9,-0.2,0.3,9,9 --progress none
    gets "a crop box" 200 "/picture?view=6&format=png&crop=-9,-9,-0.2,0.3,9,9" "${me[@]}"
    check "render --crop has the same picture" cmp -s "$work/out" "$work/cropped/test_r_000.png"
    expect "render --crop, turned" 0 "" "$cln" render "$work/run" --split test --max-images 1 \
        -o "$work/turned" --crop -9,-9,-0.2,0.3,9,9,0,0,-35 --progress none
    check "a turned crop, another picture" \
        sh -c '! cmp -s "$1" "$2"' - "$work/turned/test_r_000.png" \
        "$work/cropped/test_r_000.png"
    gets "a turned crop box" 200 \
        "/picture?view=6&format=png&crop=-9,-9,-0.2,0.3,9,9,0,0,-35" "${me[@]}"
    check "render has the same turned crop" cmp -s "$work/out" "$work/turned/test_r_000.png"
    gets "a crop box with seven numbers" 400 "/picture?view=6&crop=-9,-9,-0.2,0.3,9,9,0" "${me[@]}"
    gets "a picture without crop box" 200 "/picture?view=6&format=png" "${me[@]}"
    check "without crop box all is shown" cmp -s "$work/out" "$work/rendered/test_r_000.png"
    expect "eval with pictures" 0 "" "$cln" eval "$work/run" -o "$work/evaluated" --progress none
    gets "leaves by level" 200 "/picture?view=6&format=png&show=level" "${me[@]}"
    check "eval has the same picture of leaves" cmp -s "$work/out" \
        "$(find "$work/evaluated" -name 'test_r_000.tree.png')"
    gets "leaves by error" 200 "/picture?view=6&format=png&show=error" "${me[@]}"
    check "errors that nobody measured have no scale" has_header '^x-picture: .* 0 0.$'
    gets "a photo" 200 "/photo?view=6&side=24"
    check "the photo is a JPEG" has_header '^content-type: image/jpeg'
    gets "a point" 200 "/point?view=6&x=24&y=24" "${me[@]}"
    check "the point is opaque" number_above "$(json opacity)" 0.5
    check "the point is in front of the camera" number_above "$(json depth)" 0
    check "the point has the digits that a survey's coordinates need" \
        grep -qE '"point": \[[-.0-9e]{15,},' "$work/out"
    for axis in 0 1 2; do # a matrix's columns: right, up, back, place
        check "the point is at its depth along axis $axis" \
            awk -v p="$(json point.$axis)" -v t="$(json depth)" \
            -v back="$(matrix $axis 2)" -v place="$(matrix $axis 3)" \
            'BEGIN { off = p - (place - t * back); exit !(off * off < 0.01) }'
    done
}

section_refused() {
    viewer
    gets "another Host" 403 / -H "Host: evil.example"
    check "the answer tells how to open it" grep -q "http://localhost" "$work/out"
    gets "another Host with this port" 403 /facts -H "Host: evil.example:${address##*:}"
    gets "the Host through ssh -L" 200 / -H "Host: localhost:8080"
    gets "another Origin" 403 /facts -H "Origin: http://evil.example"
    gets "a page of another site" 403 /photo?view=0 -H "Sec-Fetch-Site: cross-site"
    gets "a link on another site" 200 / -H "Sec-Fetch-Site: cross-site" \
        -H "Sec-Fetch-Mode: navigate"
    gets "a picture without X-Viewer" 403 "/picture?view=6"
    gets "a preflight request of another site" 405 "/picture?view=6" -X OPTIONS
    gets "a picture's head without X-Viewer" 403 "/picture?view=6" -I
    gets "a film's beginning by HEAD" 405 "/film/begin?width=48&height=48&frames=2" -I "${me[@]}"
    gets "POST" 405 /picture -d x=1
    check "what would do is told" has_header "Allow: GET, HEAD"
    gets "an order, without a training" 405 /stop -X POST "${me[@]}"
    gets "the progress, without a training" 404 /training
    gets "a body" 413 /facts -X GET -d "$(printf '%01000d' 0)"
    gets "a chunked body" 413 /facts -X GET -H "Transfer-Encoding: chunked" -d x
    gets "a header twice" 400 /facts -H "X-Server: a" -H "X-Server: a"
    gets "a long address" 414 "/picture?view=$(printf '%040000d' 0)" "${me[@]}"
    gets "a long header" 431 / -H "X-Long: $(printf '%040000d' 0)"
    gets "a huge picture" 400 "/picture?view=6&width=8192" "${me[@]}"
    check "the answer says that it is too large" grep -q "too large" "$work/out"
    gets "no such camera" 400 "/picture?view=8" "${me[@]}"
    gets "no such photo" 400 "/photo?view=-1"
    gets "a file name for a photo" 400 "/photo?view=../photos/test/r_000.png"
    gets "a path on the disk" 404 "/../../../../../../etc/passwd"
    gets "an encoded path" 404 "/%2e%2e/%2e%2e/etc/passwd"
    gets "a file of the run" 404 "/run.json"
    mv "$work/photos/test/r_001.png" "$work/away.png"
    gets "a photo whose file is gone" 404 "/photo?view=7"
    mv "$work/away.png" "$work/photos/test/r_001.png"
    gets "a photo whose file is back" 200 "/photo?view=7"
    gets "a picture after all refusals" 200 "/picture?view=6&format=png" "${me[@]}"
    check "it is the same picture" cmp -s "$work/out" "$work/rendered/test_r_000.png"
}

# ask NAME VIEWER PATH: in the background; its code in $work/NAME
ask() {
    curl -s -o /dev/null -w '%{http_code}' -H "X-Viewer: $2" "$address$3" >"$work/$1" &
    asked+=($!)
}

# Behind a large picture, a later one of a viewer replaces its earlier ones, and nobody else's.
replaced() {
    local asked=() i film
    ask first long "/picture?view=6&width=2000"
    sleep 0.2
    ask earlier you "/picture?view=6&width=300"
    ask other they "/picture?view=6&width=64"
    for i in 0 1 2 3 4 5; do
        ask photo-$i you "/photo?view=$i&side=24"
    done
    sleep 0.2
    gets "a later picture of a viewer whose earlier one waits" 200 \
        "/picture?view=6&width=32&ms=50" -H "X-Viewer: you"
    gets "a later one of the viewer of the large one" 200 "/picture?view=6&width=32&ms=50" \
        -H "X-Viewer: long"
    wait "${asked[@]}"
    check "both earlier ones are replaced" [ "$(cat "$work/first") $(cat "$work/earlier")" = \
        "409 409" ]
    check "another viewer's is painted" [ "$(cat "$work/other")" = 200 ]
    check "photos do not replace each other" [ "$(cat "$work"/photo-?)" = 200200200200200200 ]
    posts "a film of a large frame" 200 "/film/begin?width=1000&height=1000&frames=2" "${me[@]}"
    film=$(json film)
    curl -s -o /dev/null -w '%{http_code}' -X POST "${me[@]}" \
        "$address/film/frame?film=$film&view=6&width=1000" >"$work/frame" &
    i=$!
    sleep 0.2
    gets "a photo meanwhile" 200 "/photo?view=1&side=24"
    wait $i
    check "it does not replace the frame" [ "$(cat "$work/frame")" = 200 ]
    posts "the film is dropped" 200 "/film/drop?film=$film" "${me[@]}"
}

section_clients() {
    local i large="/picture?view=6&width=2000"
    viewer
    for i in 1 2 3 4; do
        curl -s -m 0.1 -o /dev/null -H "X-Viewer: gone-$i" "$address$large"
    done
    curl -s -o "$work/old" -w '%{http_code}' -H "X-Viewer: you" "$address$large" >"$work/code" &
    i=$!
    gets "a small picture beside a slow, many vanished, and a large one" 200 \
        "/picture?view=6&width=32&ms=50" "${me[@]}"
    sleep 0.2
    gets "a later picture of the same viewer" 200 "/picture?view=6&width=32&ms=50" \
        -H "X-Viewer: you"
    wait $i
    check "it replaces the earlier picture" [ "$(cat "$work/code")" = 409 ]
    replaced
    curl -s -o "$work/one.png" -H "X-Viewer: one" "$address/picture?view=6&width=500&format=png" &
    i=$!
    while kill -0 $i 2>/dev/null; do
        get "/picture?view=1&width=32&ms=50" "${me[@]}"
    done
    wait $i
    check "a large one between small ones of another camera" [ "$code" = 200 ]
    gets "the large picture alone" 200 "/picture?view=6&width=500&format=png" "${me[@]}"
    check "the large picture is the same" cmp -s "$work/out" "$work/one.png"
    read -r -t 30 -u "$slow" i # the end of the stream, after 10 s; status above 128: none came
    check "the slow client is disconnected" [ $? -le 128 ]
    exec {slow}>&-
    gets "the viewer still answers" 200 /facts
}

# posts NAME CODE PATH OPTIONS...
posts() {
    gets "$@" -X POST
}

# begin_film NAME: of two frames; $film
begin_film() {
    posts "$1" 200 "/film/begin?width=48&height=48&fps=24&frames=2" "${me[@]}"
    film=$(json film)
}

no_films() {
    ! ls -d "$work"/tmp/cl-nascent-film-* >/dev/null 2>&1
}

section_film() {
    local film other
    [ $server = 0 ] || stop TERM
    baseline
    mkdir -p "$work/tmp"
    cp -rs /usr/bin "$work/bin"
    rm -f "$work/bin/ffmpeg"
    expect "render to a film" 0 "" "$cln" render "$work/run" --split test -o "$work/film.y4m" \
        --fps 24 --progress none
    with=(TMPDIR="$work/tmp" PATH="$work/bin")
    serve
    begin_film "a film"
    check "without ffmpeg it is y4m" [ "$(json file)" = film.y4m ]
    other=$film
    posts "a second film at the same time" 409 "/film/begin?width=48&height=48&frames=2" "${me[@]}"
    check "the answer has the film's progress" grep -q "0 of 2 frames" "$work/out"
    posts "a frame" 200 "/film/frame?film=$film&view=6" "${me[@]}"
    check "the frame is counted" [ "$(json "done")$(json frames)" = 12 ]
    gets "a picture between frames" 200 "/picture?view=1&width=32&ms=50" "${me[@]}"
    gets "the unfinished film" 409 "/film?film=$film"
    posts "a frame of another size" 400 "/film/frame?film=$film&view=7&width=40" "${me[@]}"
    posts "a frame of no film" 404 "/film/frame?film=${film//[0-9]/a}&view=7" "${me[@]}"
    posts "the second frame" 200 "/film/frame?film=$film&view=7" "${me[@]}"
    posts "a frame too many" 409 "/film/frame?film=$film&view=7" "${me[@]}"
    posts "the end of the film" 200 "/film/end?film=$film" "${me[@]}"
    check "the answer has the film's size" [ "$(json bytes)" = "$(stat -c %s "$work/film.y4m")" ]
    check "no file of the film has a name" no_films
    gets "the film" 200 "/film?film=$film"
    check "the film is an attachment" \
        has_header '^content-disposition: attachment; filename="film.y4m"'
    check "render has the same film" cmp -s "$work/out" "$work/film.y4m"
    gets "the film again" 200 "/film?film=$film"
    check "the film is as before" cmp -s "$work/out" "$work/film.y4m"
    begin_film "the next film"
    gets "the previous film is gone" 404 "/film?film=$other"
    posts "a film ended too early" 409 "/film/end?film=$film" "${me[@]}"
    posts "the film ended too early is gone" 404 "/film/drop?film=$film" "${me[@]}"
    begin_film "one more"
    posts "a frame of a film to drop" 200 "/film/frame?film=$film&view=6" "${me[@]}"
    posts "the film is dropped" 200 "/film/drop?film=$film" "${me[@]}"
    check "a dropped film leaves nothing" no_films
    posts "a film of large frames" 200 "/film/begin?width=2000&height=2000&frames=2" "${me[@]}"
    film=$(json film)
    curl -s -m 0.2 -o /dev/null -X POST "${me[@]}" \
        "$address/film/frame?film=$film&view=6&width=2000"
    gets "a picture after a frame's client has gone" 200 "/picture?view=6&width=32&ms=50" "${me[@]}"
    posts "the film of the client is dropped" 404 "/film/end?film=$film" "${me[@]}"
    check "the film of the client leaves nothing" no_films
    posts "a film without X-Viewer" 403 "/film/begin?width=48&height=48&frames=2"
    gets "a film by GET" 405 "/film/begin?width=48&height=48&frames=2" "${me[@]}"
    posts "a film from another site" 403 "/film/begin?width=48&height=48&frames=2" "${me[@]}" \
        -H "Sec-Fetch-Site: cross-site"
    posts "a film too large without ffmpeg" 409 "/film/begin?width=1920&height=1080&frames=2000" \
        "${me[@]}"
    check "the answer names ffmpeg" grep -q "install ffmpeg" "$work/out"
    gets "a path as the film's name" 400 "/film?film=../../../../etc/passwd"
    begin_film "a film when the viewer ends"
    posts "a frame when the viewer ends" 200 "/film/frame?film=$film&view=6" "${me[@]}"
    stop INT
    check "the viewer ends" [ $rc = 0 ]
    check "the viewer leaves no film" no_films
    if command -v ffmpeg >/dev/null; then
        with=()
        serve
        begin_film "a film with ffmpeg"
        check "the film is an MP4" [ "$(json file)" = film.mp4 ]
        posts "a frame of the MP4" 200 "/film/frame?film=$film&view=6&show=level" "${me[@]}"
        posts "another frame of the MP4" 200 "/film/frame?film=$film&view=7&show=depth" "${me[@]}"
        posts "the end of the MP4" 200 "/film/end?film=$film" "${me[@]}"
        gets "the MP4" 200 "/film?film=$film"
        check "the MP4 has its type" has_header '^content-type: video/mp4'
        check "the MP4 has its signature" grep -aq ftyp "$work/out"
        stop TERM
    else
        skip "a film with ffmpeg" "not installed"
    fi
    with=()
}

# What brings a path in nerfstudio's frame to the scene's; a damaged scene does not hinder viewing.
section_applied() {
    local s="$work/nerfstudio" run="$work/of nerfstudio"
    "$make_scene" "$s" --format nerfstudio --size 16 --train 4 --test 1 >/dev/null
    sed -i '1s/{/{"applied_transform": [[0,1,0,3],[1,0,0,0],[0,0,-1,0]], "applied_scale": 2,/' \
        "$s/transforms.json"
    expect "train" 0 "" "$cln" train "$s" -o "$run" "${tiny[@]}" --steps 2
    serve
    gets "facts of its viewer" 200 /facts
    check "what was done to the scene's poses" [ \
        "$(json applied.transform.0.1) $(json applied.transform.0.3) $(json applied.scale)" = \
        "1 3 2" -a "$(json applied.known)" = true ]
    stop TERM
    echo '{' >"$s/transforms.json"
    serve
    gets "facts without the scene" 200 /facts
    check "it is not known" [ "$(json applied.known) $(json applied.scale)" = "false 1" ]
    stop TERM
}

section_token() {
    local port cookie holder i slow silent=() own=0123456789abcdef0123456789abcdef \
        first
    viewer
    port=${address##*:}
    expect "a port that is taken" 2 "--port $port" "$cln" view "$work/run" --port "$port"
    stop TERM
    check "SIGTERM ends it without an error" [ $rc = 0 ]
    # 7007 is taken from now on, here or by another program
    perl -MIO::Socket::INET -e '$s = IO::Socket::INET->new(LocalAddr => "127.0.0.1:7007",
        Listen => 1, ReuseAddr => 1); $| = 1; print "\n"; sleep 300' >"$work/holds" &
    holder=$!
    until [ -s "$work/holds" ]; do sleep 0.05; done
    serve --up 0,0,-2
    port=${address##*:}
    check "another port is told" said "port 7007 is taken"
    check "with ssh's words for it" said "ssh -L $port:127.0.0.1:$port"
    gets "the facts" 200 /facts
    check "the up that was asked for" [ "$(json up.2)" = -1 ]
    stop TERM
    kill $holder
    expect "a name instead of an address" 2 "localhost ~not.an.IP.address 0.0.0.0" \
        "$cln" view "$work/run" --listen localhost
    mv "$work/photos" "$work/elsewhere"
    serve --listen 127.0.0.1
    check "without photos: it says so" said "~cameras:.those.that.*keeps,.without.photos"
    check "the address has a token" grep -qE '/\?token=[0-9a-f]{32}$' "$work/address"
    gets "the page without the token" 403 /
    gets "a picture without the token" 403 "/picture?view=0" "${me[@]}"
    gets "the page with a wrong token" 403 "/?token=00000000000000000000000000000000"
    get "/?token=$(sed 's/.*=//' "$work/address")" -c "$work/cookies"
    check "the token redirects to the page" [ "$code" = 303 ]
    cp "$work/headers" "$work/entered"
    check "the token sets a cookie for this site" \
        has_header '^set-cookie: .*; HttpOnly; SameSite=Lax'
    check "and for the folder that was opened alone" eval '! has_header "; path="'
    gets "the cookie opens the page" 200 / -b "$work/cookies"
    gets "facts" 200 /facts -b "$work/cookies"
    check "the facts have the cameras that the run keeps" [ -n "$(json cameras.0.name)" ]
    gets "a photo that is not here" 404 "/photo?view=0" "${me[@]}" -b "$work/cookies"
    mv "$work/elsewhere" "$work/photos"
    cookie=$(sed -n 's/^[Ss]et-[Cc]ookie: \([^;]*\).*/\1/p' "$work/entered")
    gets "a numeric Host" 200 / -b "$cookie" -H "Host: 192.0.2.1:7007"
    gets "a Host by a name of others" 200 / -b "$cookie" -H "Host: robot.local:8080"
    gets "a name that was made to lead here, which has no cookie" 403 / -H "Host: evil.example"
    gets "its wrong token" 403 "/?token=00000000000000000000000000000000" -H "Host: evil.example"
    gets "its facts" 403 /facts -H "Host: evil.example"
    gets "an Origin of others" 403 / -b "$work/cookies" -H "Origin: http://evil.example"
    gets "a probe without token" 200 /healthz
    check "it learns that the viewer is there" [ "$(cat "$work/out")" = ok ]
    gets "a probe without Host" 200 /healthz -0 -H "Host:"
    gets "a probe by HEAD" 200 /healthz -I
    gets "a path below the probe's" 403 /healthz/
    for i in {1..70}; do
        exec {slow}<>"/dev/tcp/127.0.0.1/${address##*:}"
        [ $((i % 2)) = 0 ] && i=/healthz || i=/
        printf 'GET %s HTTP/1.1\r\nHost: localhost\r\n\r\n' $i >&"$slow"
        silent+=("$slow")
    done
    gets "its owner, beside many who have no token and stay" 200 / -b "$work/cookies" -m 5
    for slow in "${silent[@]}"; do exec {slow}>&-; done
    check "one address is not told twice" eval '! said "is not known"'
    first=$server
    with=(CL_NASCENT_TOKEN="$own")
    serve --listen 127.0.0.2 --port "${address##*:}" # as of another container of this host
    with=()
    check "a token of the environment" grep -qF "/?token=$own" "$work/address"
    get "/?token=$own"
    cookie="$cookie; $(sed -n 's/^[Ss]et-[Cc]ookie: \([^;]*\).*/\1/p' "$work/headers")"
    gets "a browser with both viewers' cookies" 200 / -b "$cookie"
    stop INT
    with=(CL_NASCENT_TOKEN="$own")
    serve --listen 127.0.0.2 --port "${address##*:}"
    with=()
    gets "the next viewer with that token, by the cookie of the one before" 200 / -b "$cookie"
    stop INT
    server=$first
    address=${address/0.2:/0.1:}
    gets "and the other viewer" 200 / -b "$cookie"
    stop INT
    for i in short "${own%?}G" "$own$own"; do
        expect "a token that is none" 2 "CL_NASCENT_TOKEN ~openssl.rand" \
            env CL_NASCENT_TOKEN="$i" "$cln" view "$work/run" --listen 127.0.0.1
    done
    if ! hostname -I 2>/dev/null | grep -q '^[0-9]'; then
        skip "the machine's numbers" "it has no address but its own"
        return
    fi
    serve --listen 0.0.0.0
    address=$(grep -oE 'http://[0-9.]+:[0-9]+/[?]token=[0-9a-f]{32}' "$work/err" | head -1)
    check "all addresses: a numeric one is told, with the token" [ -n "$address" ]
    check "it is this machine's" [ "$(hostname -I | tr ' ' '\n' |
        grep -cxF "$(sed -E 's,http://([0-9.]+):.*,\1,' <<<"$address")")" = 1 ]
    check "and works" [ "$(curl -s -o /dev/null -w '%{http_code}' "$address")" = 303 ]
    stop INT
}

section_end() {
    viewer
    curl -s -o /dev/null -H "X-Viewer: long" "$address/picture?view=6&width=2000" &
    sleep 0.3
    stop INT
    check "SIGINT ends it without an error, in the middle of a picture" [ $rc = 0 ]
    check "the viewer says that it has ended" said "the viewer has ended"
    check "the viewer reports no error" eval '! said "cl-nascent:"'
    expect "not a run" 3 "~a.scene,.not.a.run" "$cln" view "$work/photos"
    serve
    gets "the viewer starts again" 200 /
    stop INT
    check "the viewer ends again" [ $rc = 0 ]
}

# until_newer TEXT: waits until /newest says so
until_newer() {
    local i
    for i in $(seq 100); do
        get /newest
        grep -qF "$1" "$work/out" && return
        sleep 0.1
    done
    return 1
}

section_newer() {
    local run=$work/grown digest
    [ $server = 0 ] || stop TERM
    baseline
    cp -r "$work/run" "$run"
    serve
    gets "the run's newest model" 200 /newest
    check "the newest model is the one that is shown" grep -qF '"newer": null' "$work/out"
    get "/picture?view=6&format=png" "${me[@]}"
    digest=$(cksum <"$work/out")
    expect "the run is trained on meanwhile" 0 "" "$cln" train --resume "$run" --steps 70 \
        --skip-selftest --progress none
    check "the viewer tells of the newer model" until_newer '"newer": 70'
    get "/picture?view=6&format=png" "${me[@]}"
    check "it goes on showing its own" [ "$(cksum <"$work/out")" = "$digest" ]
    rm -r "$run"
    check "the viewer tells that the run is gone" until_newer '"gone": true'
    expect "the run is trained anew meanwhile" 0 "" "$cln" train "$work/photos" -o "$run" \
        "${small[@]}"
    check "the viewer tells of a model of the same step" until_newer '"newer": 60'
    stop INT
}

# train RUN OPTIONS...: starts a training that is watched; $address as of a viewer
train() {
    local end=$((SECONDS + 60)) run=$1
    shift
    : >"$work/log"
    env --default-signal=INT,TERM "${with[@]}" "$cln" train "$work/photos" -o "$run" \
        "${long[@]}" --view --json "$@" >"$work/result" 2>"$work/log" &
    server=$!
    until grep -q "in a browser: " "$work/log"; do
        if [ $SECONDS -ge $end ] || ! kill -0 $server 2>/dev/null; then
            bad "a watched training starts"
            break
        fi
        sleep 0.05
    done
    address=$(sed -n 's|.*in a browser: \(http://[^/]*\)/.*|\1|p' "$work/log")
}

# orders NAME CODE PATH OPTIONS...
orders() {
    gets "$@" -X POST
}

# until_told MEMBER VALUE: waits until /training says so
until_told() {
    local i
    for i in $(seq 300); do
        get /training
        [ "$(json "$1")" = "$2" ] && return
        sleep 0.05
    done
    return 1
}

# recorded NAME NUMBER: the watched training's metrics.jsonl has a NAME within 0.01 of it
recorded() {
    grep -o "\"$1\":[0-9.]*" "$work/watched/metrics.jsonl" | cut -d: -f2 |
        awk -v told="$2" '(told - $1) ^ 2 < 1e-4 { found = 1 } END { exit !(told && found) }'
}

# between NAME NUMBER: not below the least NAME of metrics.jsonl by more than 1, nor above the most
between() {
    grep -o "\"$1\":[0-9.]*" "$work/watched/metrics.jsonl" | cut -d: -f2 | sort -n |
        awk -v told="$2" 'NR == 1 { least = $1 } { most = $1 }
            END { exit !(NR > 1 && told > least - 1 && told < most + 1) }'
}

# ended: waits for the training; $rc is its exit code, its result the last stdout
ended() {
    wait $server
    rc=$?
    server=0
    cp "$work/result" "$work/out"
}

# A film is dropped after two minutes of its client's silence; the painter's own time is none.
section_silence() {
    local long=("${tiny[@]}" --steps 1000000 --eval-every 0) film i=0 large
    if [ "$BUILD" != build ] || [ ! -e build/faults.so ]; then
        skip "a client's silence" "needs build/faults.so, and no sanitizer"
        return
    fi
    [ $server = 0 ] || stop TERM
    baseline
    with=(LD_PRELOAD="$PWD/build/faults.so" FAULT_SPEED=40) # two minutes are three seconds
    train "$work/silent"
    with=()
    begin_film "a film of a training"
    posts "its first frame" 200 "/film/frame?film=$film&view=6" "${me[@]}"
    kill -STOP $server # as an evaluation
    sleep 4
    kill -CONT $server
    posts "the film outlives minutes in which nothing is painted" 200 \
        "/film/frame?film=$film&view=7" "${me[@]}"
    posts "it is completed" 200 "/film/end?film=$film" "${me[@]}"
    begin_film "another film"
    curl -s -m 600 -o /dev/null -H "X-Viewer: large" "$address/picture?view=6&width=1200" &
    large=$!
    sleep 0.3
    posts "a frame that waits for minutes behind a large picture" 200 \
        "/film/frame?film=$film&view=6" "${me[@]}" -m 600
    wait $large
    posts "the film stays for a while" 409 "/film/begin?width=48&height=48&frames=2" "${me[@]}"
    until get "/film/begin?width=48&height=48&frames=2" -X POST "${me[@]}"
        [ "$code" = 200 ] || [ $((i += 1)) -gt 300 ]; do
        sleep 0.2
    done
    check "a film that nobody asks for is dropped" [ "$code" = 200 ]
    orders "stop" 202 /stop "${me[@]}"
    ended
}

section_training() {
    local digest id step pictures=0 large psnr curve
    local long=("${tiny[@]}" --level-at 2:0.5 --steps 1500 --eval-every 500 \
        --log-every 100)
    [ $server = 0 ] || stop TERM
    baseline
    expect "train, unwatched" 0 "" "$cln" train "$work/photos" -o "$work/plain" "${long[@]}" --json
    digest=$(json model_digest)

    train "$work/watched"
    exec {slow}<>"/dev/tcp/127.0.0.1/${address##*:}"
    printf 'GET / HTTP/1.1\r\nHost: local' >&"$slow"
    gets "an order by GET" 405 /pause "${me[@]}"
    orders "an order without X-Viewer" 403 /pause
    orders "an order from another Origin" 403 /pause "${me[@]}" -H "Origin: http://evil.example"
    orders "an order of another site" 403 /pause "${me[@]}" -H "Sec-Fetch-Site: cross-site"
    get /facts
    id=$(sed -n 's/^x-server: *\([0-9a-f]*\).*/\1/Ip' "$work/headers")
    check "the server has a name" [ ${#id} = 16 ]
    orders "an order of another viewer's page" 410 /stop "${me[@]}" -H "X-Server: ${id%?}x"
    gets "a photo of another viewer's page" 410 "/photo?view=1&side=64&server=${id%?}x"
    gets "a photo of its own page" 200 "/photo?view=1&side=64&server=$id"
    orders "pause" 202 /pause "${me[@]}" -H "X-Server: $id"
    check "the training pauses" until_told state paused
    step=$(json step)
    check "it pauses in the middle" [ "$step" -gt 0 -a "$step" -lt 1500 ]
    gets "a large picture while it pauses" 200 "/picture?view=6&width=300&format=png" "${me[@]}"
    check "the large picture is complete" has_header '^x-picture: 300 300 '
    orders "save" 202 /save "${me[@]}"
    check "it saves at that step" until_told saved_step "$step"
    check "that step has a checkpoint" \
        [ -s "$(printf '%s/checkpoint/%08d.json' "$work/watched" "$step")" ]
    sleep 1
    get /training
    check "the paused training does not move" [ "$(json step)" = "$step" ]
    gets "facts" 200 /facts
    check "the facts say that it is a training" [ "$(json training)" = true ]
    orders "continue" 202 /continue "${me[@]}"
    curl -s -m 0.2 -o /dev/null -H "X-Viewer: gone" "$address/picture?view=6&width=2000"
    while curl -sf -m 60 -H "X-Viewer: large" -o /dev/null "$address/picture?view=2&width=200"; do
        :
    done &
    large=$!
    while get "/picture?view=$((pictures % 8))&width=64&ms=20&crop=-9,-9,-9,9,0.2,9&show=error" \
        "${me[@]}" && [ "$code" = 200 ]; do
        pictures=$((pictures + 1))
        get /training && [ "$code" = 200 ] && cp "$work/out" "$work/told"
    done
    ended
    wait $large
    exec {slow}>&-
    check "the training ends well" [ $rc = 0 ]
    check "pictures came meanwhile" [ $pictures -ge 3 ]
    check "watched and unwatched, the same bits" [ "$(json model_digest)" = "$digest" ]
    check "a pause is not training time" number_above "$(json wall_seconds)" \
        "$(awk -v s="$(json seconds)" 'BEGIN { print s + 1 }')"
    cp "$work/told" "$work/out"
    psnr=$(json psnr_test)
    curve=$(json curve.1.1)
    check "the progress had the test PSNR" recorded psnr_test "$psnr"
    check "the progress had a curve of training PSNRs" between psnr_train "$curve"
    check "the progress had times of stages" number_above "$(json stages.viewing)" 0
    check "the share of viewing is right" awk -v share="$(json viewing)" \
        'BEGIN { exit !(share > 0 && share < 1) }'
    check "the log says how to view the run" grep -q "cl-nascent view" "$work/log"

    train "$work/stopped" --listen 127.0.0.1
    gets "an order without the token" 403 /stop -X POST "${me[@]}"
    get "/?token=$(sed -n 's/.*in a browser: .*token=//p' "$work/log")" -c "$work/cookies"
    orders "stop, with the token" 202 /stop "${me[@]}" -b "$work/cookies"
    ended
    check "the training stops with 130" [ $rc = 130 ]
    check "the log says who stopped it" grep -q "stopped from the browser" "$work/log"
    expect "the stopped training resumes" 0 "" \
        "$cln" train --resume "$work/stopped" --skip-selftest \
        --progress none --json
    check "it resumes to the same bits" [ "$(json model_digest)" = "$digest" ]
    expect "no --port without --view" 2 "--port --view" "$cln" train "$work/photos" \
        -o "$work/none" --port 7007
}

# A phone's photos: their pictures come as people see them, from the camera that the page is told.
section_phone() {
    local pose focal

    [ $server = 0 ] || stop TERM
    "$make_scene" "$work/phone" --format nerfstudio --size 48 --train 6 --test 2 --held 6 \
        >/dev/null || bad "make-scene"
    expect "train" 0 "" "$cln" train "$work/phone" -o "$work/phone run" "${small[@]}"
    run="$work/phone run"
    serve
    run=$work/run
    get /facts
    check "the first view stands" [ "$(json width) $(json height)" = "36 48" ]
    check "the photos stand" [ "$(json cameras.6.width) $(json cameras.6.height)" = "36 48" ]
    check "up is up" number_above "$(json up.2)" 0.99985
    focal=$(json cameras.6.focal)
    pose=$(for i in 0 1 2 3 4 5 6 7 8 9 10 11; do json "cameras.6.pose.$i"; done | paste -sd,)
    gets "a photo's view" 200 "/picture?view=6&format=png" "${me[@]}"
    check "it stands" has_header '^x-picture: 36 48 '
    mv "$work/out" "$work/seen.png"
    gets "a free camera there" 200 \
        "/picture?pose=$pose&focal=$focal&width=36&height=48&format=png" "${me[@]}"
    check "it sees the same" cmp -s "$work/out" "$work/seen.png"
    gets "a larger one" 200 "/picture?view=6&width=72" "${me[@]}"
    check "as wide as it is seen" has_header '^x-picture: 72 96 '
    gets "a point below" 200 "/point?view=6&x=20&y=40" "${me[@]}"
    gets "a point outside" 400 "/point?view=6&x=40&y=20" "${me[@]}"
    stop TERM
}

if "$cln" view . 2>&1 | grep -q libmicrohttpd-dev; then
    skip view "built without libmicrohttpd"
    count
    exit
fi
run_sections \
    "page pictures refused clients film applied token end newer silence training phone" "$@"
