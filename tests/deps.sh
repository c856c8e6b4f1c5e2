#!/bin/sh
# Installs missing Debian packages for: build, test, fuzz, lint, peers, browser (any of them as
# arguments). Names them first; prints nothing if all are installed. "a|b": either will do, installs
# the first. On other systems it only names the required packages.
set -eu

build="ocl-icd-opencl-dev opencl-headers pocl-opencl-icd libexpat1-dev libjansson-dev
    liblcms2-dev libmeshoptimizer-dev libmicrohttpd-dev libstb-dev libutf8proc-dev zlib1g-dev
    pkg-config|pkgconf"
# the program is built without these, too
optional=" libexpat1-dev liblcms2-dev libmeshoptimizer-dev libmicrohttpd-dev libutf8proc-dev "
test="curl libcmocka-dev glpk-utils oclgrind openmpi-bin libopenmpi-dev"
fuzz="clang-14|clang libclang-rt-14-dev"
lint="clang-14|clang clang-format-14|clang-format"
peers="g++"
browser="chromium chromium-driver python3"

wanted=""
for what in "$@"; do
    case $what in
    build) wanted="$wanted gcc|clang $build" ;;
    test) wanted="$wanted $test" ;;
    lint) wanted="$wanted $lint" ;;
    peers) wanted="$wanted $peers" ;;
    fuzz) wanted="$wanted $fuzz" ;;
    browser) wanted="$wanted $browser" ;;
    *)
        echo "usage: tests/deps.sh [build] [test] [fuzz] [lint] [peers] [browser]" >&2
        exit 2
        ;;
    esac
done

if ! command -v dpkg-query >/dev/null; then
    echo "deps.sh: not a Debian system; please install the equivalents of:$wanted" >&2
    exit 0
fi

installed() {
    dpkg-query -W -f '${db:Status-Status}\n' "$1" 2>/dev/null | grep -qx installed
}

missing="" required=""
for one in $wanted; do
    found=no
    for name in $(echo "$one" | tr '|' ' '); do
        if installed "$name"; then
            found=yes
        fi
    done
    if [ $found = no ]; then
        missing="$missing ${one%%|*}"
        case $optional in *" $one "*) ;; *) required="$required ${one%%|*}" ;; esac
    fi
done
if [ -z "$missing" ]; then
    exit 0
fi

echo "missing Debian packages:$missing"
as_root=""
if [ "$(id -u)" != 0 ]; then
    if ! command -v sudo >/dev/null; then
        if [ -z "$required" ]; then
            echo "deps.sh: not root and no sudo: built without these, which are optional"
            exit 0
        fi
        echo "deps.sh: not root and no sudo; please run as root: apt-get install$missing" >&2
        exit 1
    fi
    as_root=sudo
fi
export DEBIAN_FRONTEND=noninteractive
# a first failure is usually due to an old or empty package list
# shellcheck disable=SC2086
if ! $as_root apt-get install -y --no-install-recommends $missing; then
    $as_root apt-get update
    $as_root apt-get install -y --no-install-recommends $missing
fi
