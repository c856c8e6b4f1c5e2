#!/bin/bash
# What documents say of files, headings, options and findings, against these; part of tests/lint.sh.
# Prints a line for each that is not there, and ends with 1 if there is one.
#   tests/documents.sh [FOLDER]
#   links     [text](FILE#HEADING) in Markdown
#   paths     host/..., tests/... and so on: what begins with a folder of the sources; * is any, and
#             NAME, ROOM stand for others
#   headings  "results.md, *Heading*": in a heading there, or in a line with bold words
#   options   of "cl-nascent COMMAND ... --option" it is the command's; any other --option is one of
#             the program or of OTHERS
#   findings  what `check` can find (cln_found_fault) is in docs/formats.md
# Not CHANGELOG.md and docs/history.md, which tell of what there was, but for their links.
set -u
cd "${1:-$(dirname "$0")/..}" || exit 2
export LC_ALL=C

# Options of other programs: ours beside cl-nascent, OpenSplat, builds, Oclgrind, podman, MPI,
# Slurm, timeout; and --name itself. Those of make-scene and the like are not looked at one by one.
OTHERS="name size kind train test fault unit from only list seeds results
    num-downscales resolution-schedule sh-degree-interval libs cflags static uninitialized
    rm pid ipc network env-host bind-to allow-run-as-root oversubscribe host mca
    mpi ntasks-per-node gpus-per-task signal requeue preserve-status"
now=(README.md ARCHITECTURE.md CONTRIBUTING.md)
for file in docs/*.md; do
    [ "$file" = docs/history.md ] || now+=("$file")
done
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

# "FILE:HEADING" of Markdown files, as links name it: lower case, words joined by -
anchors() {
    awk 'FNR == 1 { code = 0 }
        /^```/ { code = !code }
        !code && /^#+ / {
            name = tolower($0)
            sub(/^#+ +/, "", name)
            gsub(/\]\([^)]*\)/, "", name)
            gsub(/[^a-z0-9_ \200-\377-]/, "", name)
            gsub(/ /, "-", name)
            n = met[FILENAME, name]++
            print FILENAME ":" name (n ? "-" n : "")
        }' "$@"
}

# "FILE:LINE:TARGET" of links within the sources. A link may go on in the next line.
linked() {
    awk 'FNR == 1 { code = 0; held = "" }
        /^```/ { code = !code }
        code { held = ""; next }
        {
            line = held $0
            held = ""
            gsub(/`[^`]*`/, "`", line)
            while (match(line, /\]\([^) ]*\)/)) {
                to = substr(line, RSTART + 2, RLENGTH - 3)
                line = substr(line, RSTART + RLENGTH)
                if (to !~ /^[a-z]+:/) print FILENAME ":" FNR ":" to
            }
        }' "$@"
}

links() {
    local file line to target
    anchors ./*.md docs/*.md | sed 's|^\./||' >"$work/anchors"
    while IFS=: read -r file line to; do
        target=${to%%#*}
        case $file in */*) [ -z "$target" ] || target=${file%/*}/$target ;; esac
        case $target in docs/../*) target=${target#docs/../} ;; esac
        [ -n "$target" ] || target=$file
        if [ ! -e "$target" ]; then
            echo "$file:$line: $to: there is no $target"
        elif [[ $to = *#* && $target = *.md ]] &&
            ! grep -qxF "$target:${to#*#}" "$work/anchors"; then
            echo "$file:$line: $to: $target has no such heading"
        fi
    done < <(linked ./*.md docs/*.md | sed 's|^\./||')
}

paths() {
    local file line path
    grep -noE '\b(host|kernels|tests|bench|docs|examples|include|packaging)/[A-Za-z0-9_./*-]+' \
        "${now[@]}" | while IFS=: read -r file line path; do
        case $path in *NAME* | *ROOM*) continue ;; esac
        path=${path%%[._-]}
        compgen -G "$path" >/dev/null || [ -e "$path.c" ] || echo "$file:$line: there is no $path"
    done
}

# A heading's words may go on in the next line.
headings() {
    awk 'FILENAME ~ /^docs\// && /^#+ |\*\*/ {
            name = FILENAME
            sub(/.*\//, "", name)
            known[name] = known[name] "\n" tolower($0)
        }
        FNR == 1 { held = "" }
        pass == 2 {
            line = held $0
            held = $0 " "
            while (match(line, /[a-z-]+\.md\)?,? +\*[^*]+\*/)) {
                one = substr(line, RSTART, RLENGTH)
                if (RSTART + RLENGTH > length(held)) held = ""
                line = substr(line, RSTART + RLENGTH)
                split(one, part, /\)?,? +\*/)
                sub(/\*$/, "", part[2])
                if (part[1] in known && !index(known[part[1]], tolower(part[2])))
                    print FILENAME ":" FNR ": " part[1] " has no heading \"" part[2] "\""
            }
        }' docs/*.md pass=2 "${now[@]}" | sort -u
}

# "COMMAND NAME" of every option; "any NAME" of those of some command.
names() {
    {
        sed -n '/cln_args\[\] = {/,/^};/p' host/cli/option_table.c
        sed 's/^    X(\([a-z]*\), [A-Z]*,/FLAG(CLN_EXPORT, "\1", /' host/export/list.h
        tr '\n\\' '  ' <host/base/config_rows.h |
            sed -E -e 's/\<(INT|REAL|BOOL|ENUM|TEXT)\( *[a-z0-9_]+, *"/FLAG(ROWS, "/g' \
                -e 's/\.alias = "/FLAG(ROWS, "/g'
    } | tr '\n\\' '  ' | awk -v on="TRAIN EVAL RENDER VIEW EXPORT SELFTEST TUNE CHECK_SCENE" '
        function add(word, name, of, n, i) {
            if (word == "ON_DEVICE") word = on
            if (word == "EVERY") word = on " INFO DEVICES BUGREPORT POSES COMPLETION"
            if (word == "ROWS") word = "TRAIN CHECK_SCENE INFO TUNE"
            n = split(word, of, " ")
            for (i = 1; i <= n; i++) {
                sub(/^CLN_/, "", of[i])
                sub(/_SCENE/, "", of[i])
                print tolower(of[i]), name
            }
        }
        {
            while (match($0, /(TEXT|FLAG|COUNT|WORD|NUMBER|INT|REAL)\([A-Z_| ,]*, *"[a-z0-9-]+"/)) {
                one = substr($0, RSTART, RLENGTH)
                $0 = substr($0, RSTART + RLENGTH)
                split(one, part, "\"")
                sub(/^[A-Z]*\(/, "", part[1])
                gsub(/CLN_ARG_[A-Z]*|,/, "", part[1])
                n = split(part[1], of, /[ |]+/)
                for (i = 1; i <= n; i++) if (of[i] != "") add(of[i], part[2])
            }
        }'
    printf 'all %s\n' json help version
}

options() {
    names >"$work/names"
    awk -v others="$OTHERS" '
        FILENAME == ARGV[1] { known[$1, $2] = 1; any[$2] = 1; commands[$1] = 1; next }
        FNR == 1 {
            held = ""
            n = split(others, one, " ")
            for (i = 1; i <= n; i++) any[one[i]] = 1
        }
        {
            line = held $0
            held = ""
            if (sub(/\\$/, " ", line)) { held = line; next }
            gsub(/\\f[A-Z]|\\&/, "", line)
            gsub(/\\-/, "-", line)
            command = ""
            while (match(line, /cl-nascent [a-z]+|--(no-)?[a-z0-9][a-z0-9-]*/)) {
                before = RSTART > 1 ? substr(line, RSTART - 1, 1) : ""
                word = substr(line, RSTART, RLENGTH)
                line = substr(line, RSTART + RLENGTH)
                if (word ~ /^cl-/) {
                    command = substr(word, 12)
                    if (!(command in commands)) command = ""
                    continue
                }
                if (before ~ /[A-Za-z0-9_-]/ || word ~ /-$/) continue # a part of a word, --no-NAME
                name = substr(word, 3)
                plain = name
                sub(/^no-/, "", plain)
                if (!(name in any) && !(plain in any))
                    print FILENAME ":" FNR ": --" name " is an option of no command"
                else if (command != "" && !((command, name) in known) &&
                         !((command, plain) in known) && !(("all", name) in known))
                    print FILENAME ":" FNR ": --" name " is no option of " command
            }
        }' "$work/names" "${now[@]}" docs/cl-nascent.1
}

findings() {
    local name listed
    listed=$(sed -n 's/^| `findings` |.*`what`: //p' docs/formats.md | sed 's/ ([^)]*)//g; s/ |$//')
    cat host/scene/*.c host/api/*.c | tr '\n' ' ' |
        grep -oE 'cln_found_fault\([^"]*"[a-z ]+"' | cut -d '"' -f 2 | sort -u |
        while read -r name; do
            [[ ", $listed, " = *", $name, "* ]] ||
                echo "docs/formats.md: what check prints: the finding '$name' is not there"
        done
}

for part in links paths headings options findings; do $part; done >"$work/found"
cat "$work/found"
[ ! -s "$work/found" ]
