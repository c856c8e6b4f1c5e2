# shellcheck shell=sh
# The programs of the scripts here, to be sourced: $cln and $query, from CLN and QUERY or build/.
# Looked for before anything is trained.
cln=${CLN:-build/cl-nascent}
query=${QUERY:-build/json-query}
for program in "$cln" "$query"; do
    [ -x "$program" ] || {
        echo "${0##*/}: $program is missing; run \`make all bench-programs\`" >&2
        exit 2
    }
done
