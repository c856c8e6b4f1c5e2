#!/bin/bash
# make lint: static checks. Each check prints its findings and one line; the last line is "N passed,
# N failed[, N skipped]". Run from the repository's root.
#   warnings    every C file compiles with gcc's warnings as errors
#   bench-sort  so does the one program in C++, with clang's
#   kernels     every kernels/*.cl compiles with clang as OpenCL C 1.2, with no device involved
#   floats      kernels keep no integers in the bits of floats, which a device may flush to zero
#   rooms       host/ folders include only themselves and lower folders (ORDER)
#   circles     no file of host/ includes itself through others (a.c and a.h count as one)
#   CL/cl.h     only through include/cl.h, and that only from device/ and pipeline/
#   options     every option of host/base/config_rows.h is in the man page, and the words to choose
#               from, there and in host/cli/option_table.c, where it describes the option
#   method      every section of docs/method.md that a comment or document cites is a heading there
#   documents   links, paths, headings, options and findings that documents name are there
#               (tests/documents.sh)
#   format      clang-format has nothing to change
#   length      no file over 1000 lines, no line over 100 columns except lines with an address
#   scripts     shellcheck, if it is installed
set -u
cd "$(dirname "$0")/.." || exit 1

ORDER="cli api export train view render check pipeline report model scene device ranks io \
    reference base"
passed=0 failed=0 skipped=0
c_files=$(ls host/*/*.c examples/*.c data/*.c tests/*/*.c bench/common/*.c bench/growth/*.c \
    bench/kernels/*.c bench/peers/peer_gemm.c bench/peers/timing.c \
    bench/scale/*.c bench/scenes/*.c 2>/dev/null)
all_files=$(ls host/*/*.[ch] include/*.h examples/*.c data/*.[ch] tests/*/*.[ch] tests/*.sh \
    tests/*/*.sh bench/*/*.[ch] kernels/* 2>/dev/null)
# of which only citations and lengths are checked here
other_files=$(ls ./*.md bench/*/*.cpp tests/*/*.py bench/*/*.sh packaging/* host/view/page.* \
    host/view/*.js Makefile)
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

first_of() {
    for tool in "$@"; do
        if command -v "$tool" >/dev/null; then
            echo "$tool"
            return
        fi
    done
}

# check NAME FUNCTION: passes if the function prints nothing
check() {
    local found
    found=$("$2" 2>&1)
    if [ -z "$found" ]; then
        echo "ok      $1"
        passed=$((passed + 1))
    else
        echo "$found"
        echo "FAILED  $1"
        failed=$((failed + 1))
    fi
}

skip() {
    echo "skipped $1: $2"
    skipped=$((skipped + 1))
}

warnings() {
    local flags
    flags="-std=c11 -D_GNU_SOURCE -O2 -Wall -Wextra -Wshadow -Wstrict-prototypes
           -Wmissing-prototypes -Werror -Iinclude -Ihost -Ibench -Itests/support
           -isystem /usr/include/stb $(pkg-config --cflags OpenCL jansson zlib)
           $(pkg-config --exists libmicrohttpd && echo -DCLN_WITH_MICROHTTPD)
           $([ -e /usr/include/meshoptimizer.h ] && echo -DCLN_WITH_MESHOPTIMIZER)
           $(pkg-config --exists lcms2 && echo -DCLN_WITH_LCMS2)
           $(pkg-config --exists libutf8proc && echo -DCLN_WITH_UTF8PROC)
           $(pkg-config --exists expat && echo -DCLN_WITH_EXPAT)
           $(pkg-config --exists ompi-c && echo -DCLN_WITH_MPI "$(pkg-config \
               --cflags-only-I ompi-c)")"
    # shellcheck disable=SC2086
    printf '%s\n' $c_files | xargs -P 2 -n 4 ${CC:-gcc} $flags -fsyntax-only
}

# The one program in C++, which the build does not make. Debian's clang brings its C++ headers.
sort_bench() {
    # shellcheck disable=SC2046
    "$clang" -x c++ -std=c++17 -D_GNU_SOURCE -Wall -Wextra -Werror -Iinclude -Ihost \
        $(pkg-config --cflags OpenCL jansson zlib) -fsyntax-only bench/peers/peer_sort.cpp
}

# Two warnings are off: a kernel need not use all of the prelude's helpers, and its argument list is
# the same for every build.
kernel() {
    "$clang" -x cl -cl-std=CL1.2 -Xclang -finclude-default-header -fsyntax-only -Wall -Wextra \
        -Wpedantic -Werror -Wno-unused-function -Wno-unused-parameter "$@"
}

# Headers of a kernel file, in order: those that its first line names ("needs: leaves network"),
# each after its own (as in host/device/program.c).
needs() {
    local header
    for header in $(sed -n '1s|^/\* needs: \([a-z_0-9 ]*\).*|\1|p' "$1"); do
        needs "kernels/$header.h"
        echo "kernels/$header.h"
    done
}

kernels() {
    local cl more header headers
    for cl in kernels/*.cl; do
        headers=(-include include/device_abi.h -include kernels/lanes.h)
        for header in $(needs "$cl" | awk '!met[$0]++'); do
            headers+=(-include "$header")
        done
        for more in "" -DLENSES=0 -DVW=1 -DLEAF=0 -DPARTS=4 -DTRAIN=0 -DENCODING=1 -DNDC=1 \
            -DCROP=1 -DSHELL=1 -DBEGINS=1 -DSMOOTH=0; do
            kernel "${headers[@]}" ${more:+"$more"} "$cl"
        done
    done
    grep -n '#include' kernels/* | sed \
        's/$/: kernels include nothing; the build puts the prelude before them/'
}

# Small integers are denormal floats. bfloat16's and the sort key's bits are those of floats.
floats() {
    grep -n 'as_float\|AS_FLOAT' kernels/* | grep -v '^kernels/\(bfloat16.h\|splat.cl\|lanes.h\):'
}

rooms() {
    local room other allowed
    for room in $ORDER; do
        allowed=" $room ${ORDER#*"$room"} "
        # the float64 twin reads the parameters' layout
        [ "$room" = reference ] && allowed="$allowed model "
        for other in $ORDER; do
            case $allowed in
            *" $other "*) ;;
            *) grep -n "#include \"$other/" host/"$room"/*.[ch] 2>/dev/null ;;
            esac
        done
    done | sed 's/$/: a room above or beside it/'
    for room in host/*/; do
        room=$(basename "$room")
        case " $ORDER " in
        *" $room "*) ;;
        *) echo "host/$room: not one of the rooms ($ORDER)" ;;
        esac
    done
}

# One line "from to" for each include; tsort names the files of a circle.
circles() {
    grep -H '^#include "[a-z_]*/' host/*/*.[ch] |
        sed 's/^host\/\([^.]*\)\.[ch]:#include "\([^.]*\)\.h".*/\1 \2/' |
        awk '$1 != $2' | sort -u | tsort 2>&1 >/dev/null |
        sed -e 's/^tsort: -: input contains a loop:/files of host that include each other:/' \
            -e 's/^tsort:/   /'
}

opencl_header() {
    grep -n '#include *[<"]CL/' $all_files | grep -v '^include/cl\.h:'
    grep -n '#include *"cl\.h"' host/*/*.[ch] | grep -v '^host/\(device\|pipeline\)/'
}

options() {
    local page
    page=$(sed 's/\\f.//g; s/\\//g' docs/cl-nascent.1)
    sed -n 's/^ *\(INT\|REAL\|BOOL\|ENUM\|TEXT\)([a-z0-9_]*, "\([a-z0-9-]*\)".*/\2/p' \
        host/base/config_rows.h |
        while read -r option; do
            case $page in
            *"--$option"*) ;;
            *) echo "docs/cl-nascent.1: --$option of host/base/config_rows.h is not in it" ;;
            esac
        done
    cat host/base/config_rows.h host/cli/option_table.c | tr '\n\\' '  ' |
        grep -oE '(ENUM|WORD)\([A-Za-z0-9_ |]*, *"[a-z0-9-]+",[^"]*"[a-z0-9-]+(\|[a-z0-9-]+)+"' |
        sed 's/^[^"]*"\([^"]*\)".*"\([^"]*\)"$/\1 \2/' |
        while read -r option words; do
            text=$(grep -A 12 -e "--$option" <<<"$page")
            for word in ${words//|/ }; do
                grep -qw -e "$word" <<<"$text" ||
                    echo "docs/cl-nascent.1: --$option: the word '$word' is not there"
            done
        done
}

# Citations of the files, as "file:line:citation": "method.md 4, 5", "method.md sections 4 to 7",
# "method.md 9's rule". A line that ends within one goes on in the next, without a comment's signs.
citations() {
    awk -v cited="method\\.md,?( sections?)?( [0-9][0-9.]*(,| and| to|, and)?)*" '
        function print_all(line, at) {
            while (match(line, cited)) {
                print file ":" at ":" substr(line, RSTART, RLENGTH)
                line = substr(line, RSTART + RLENGTH)
            }
        }
        FNR == 1 { if (held != "") print_all(held, at); held = ""; file = FILENAME }
        {
            line = $0
            if (held != "") {
                sub(/^[ \t]*(\*|\/\/|#)?[ \t]*/, "", line)
                line = held " " line
            } else
                at = FNR
            held = ""
            if (line ~ cited "$") held = line
            else print_all(line, at)
        }
        END { if (held != "") print_all(held, at) }' "$@"
}

method() {
    local file line words number headings
    headings=" $(sed -n 's/^##* \([0-9][0-9.]*\)[. ].*/\1/p' docs/method.md | sed 's/\.$//' |
        tr '\n' ' ')"
    # shellcheck disable=SC2086
    citations $all_files $other_files docs/*.md |
        while IFS=: read -r file line words; do
            for number in $(grep -oE '[0-9][0-9.]*' <<<"$words" | sed 's/\.$//'); do
                case $headings in
                *" $number "*) ;;
                *) echo "$file:$line: docs/method.md has no section $number" ;;
                esac
            done
        done
}

documents() {
    tests/documents.sh
}

format() {
    local file
    for file in $all_files; do
        case $file in
        kernels/*) ;; # OpenCL C's vector literals confuse it
        *.[ch]) "$clang_format" --dry-run -Werror "$file" 2>&1 | head -3 ;;
        esac
    done
}

lengths() {
    # shellcheck disable=SC2086
    wc -l $all_files | awk '$2 != "total" && $1 > 1000 { print $2 ": " $1 " lines; split it" }'
    # a tab is 8 columns, a character of UTF-8 one; an address cannot be wrapped
    # shellcheck disable=SC2086
    LC_ALL=C awk '!/https?:\/\// {
        line = $0
        gsub(/\t/, "        ", line)
        gsub(/[\200-\277]/, "", line)
        if (length(line) > 100 && FILENAME !~ /\.md$/)
            print FILENAME ":" FNR ": over 100 columns"
    }' $all_files $other_files
}

shell_scripts() {
    shellcheck -S warning tests/*.sh tests/*/*.sh packaging/*.sh bench/*/*.sh .ci/run
}

clang=$(first_of clang-14 clang clang-15)
clang_format=$(first_of clang-format-14 clang-format)

check warnings warnings
if [ -n "$clang" ]; then check kernels kernels; else skip kernels "no clang"; fi
if [ -n "$clang" ]; then check bench-sort sort_bench; else skip bench-sort "no clang"; fi
check floats floats
check rooms rooms
check circles circles
check CL/cl.h opencl_header
if [ -e docs/cl-nascent.1 ]; then check options options; else skip options "no man page yet"; fi
check method method
check documents documents
if [ -n "$clang_format" ]; then check format format; else skip format "no clang-format"; fi
check length lengths
if command -v shellcheck >/dev/null; then
    check scripts shell_scripts
else
    skip scripts "not installed"
fi

echo "$passed passed, $failed failed$([ $skipped = 0 ] || echo ", $skipped skipped")"
[ $failed = 0 ]
