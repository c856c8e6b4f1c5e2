#!/bin/sh
# A manual page per command, cut out of docs/cl-nascent.1: what the command does, its options, exit
# status. Names and purposes are those of `cl-nascent --help`. Called by make.
#   packaging/man-pages.sh PROGRAM FOLDER
set -eu
page=$(dirname "$0")/../docs/cl-nascent.1

"$1" --help | awk '/^Commands:/ { on = 1; next } /^$/ { on = 0 } on' |
    while read -r name purpose; do
        case $name in help | version) continue ;; esac
        computes=$("$1" help "$name" | grep -c -e --device || true)
        awk -v name="$name" -v purpose="$purpose" -v computes="$computes" '
            function heading(text) { print ".SH " text }
            BEGIN {
                if (substr(purpose, 2, 1) ~ /[a-z ]/)
                    purpose = tolower(substr(purpose, 1, 1)) substr(purpose, 2)
            }
            /^\.TH/ {
                sub(/CL\\-NASCENT/, "CL\\-NASCENT\\-" toupper(name))
                print
                heading("NAME")
                print "cl\\-nascent\\-" name " \\- " purpose
                next
            }
            /^\.S[HS]/ {
                title = $0
                sub(/^\.S[HS] /, "", title)
                gsub(/"/, "", title)
                if (title == "SYNOPSIS") { heading("SYNOPSIS"); print ".nf" }
                if (title == "DESCRIPTION") { print ".fi" }
                if (title == "COMMANDS") heading("DESCRIPTION")
                if (title == "OPTIONS") heading("OPTIONS")
                in_head = /^\.SH/ ? title : in_head
                general = title == "All commands" || (title == "Commands that compute" && computes)
                ours = (", " title ", ") ~ (", " name ", ") ||
                    (name == "train" && title ~ /^(Data, budgets, output|Leaf networks|Octree)$/) ||
                    (name == "train" && title ~ /^(Sampling|Loss and optimiser)$/)
                if (title == "EXIT STATUS") { printf "%s", rest; heading("\"EXIT STATUS\"") }
                if (in_head == "OPTIONS" && ours) print
                if (in_head == "OPTIONS" && general) rest = rest $0 "\n"
                next
            }
            in_head == "SYNOPSIS" && index($0, "\\fBcl\\-nascent " name) { print }
            in_head == "COMMANDS" && /^\.TP/ { tag = 1; next }
            in_head == "COMMANDS" && tag {
                word = $2
                gsub(/[",]/, "", word)
                mine = word == name
                tag = 0
                if (mine) print ".TP"
            }
            in_head == "COMMANDS" && mine { print }
            in_head == "OPTIONS" && ours { print }
            in_head == "OPTIONS" && general { rest = rest $0 "\n" }
            in_head == "EXIT STATUS" { print }
            END {
                heading("\"SEE ALSO\"")
                print ".BR cl\\-nascent (1)"
                print "has the rest: kinds of scenes, files, signals, the environment."
            }' "$page" >"$2/cl-nascent-$name.1"
    done
