#!/bin/sh
# Error against run time on one scene: trains with test PSNR at the given points, then evaluates
# every test view. Two tables in Markdown: the points and the end, and the time of a step by stage,
# by OpenCL events, after the last change of the tree (--structure-until); what is no training
# stands below. Nothing else should run on the machine. Trains the default preset unless TRAIN
# OPTIONS name another.
#
#   bench/scenes/scene.sh SCENE RUN LIMIT POINTS [TRAIN OPTIONS]
#   bench/scenes/scene.sh ../lego build/lego-10m 10m 1m,2m,5m
#
# Seconds are training seconds: growth, refresh and culling count, evaluation and building kernels
# do not. PSNR is over the evenly chosen test views of --eval-images (8) at the points, over all
# test views in the last row.
# CLN, QUERY: the programs (build/cl-nascent, build/json-query).
set -eu
[ $# -ge 4 ] || { sed -n '2,/^[^#]/s/^# \{0,1\}//p' "$0"; exit 2; }
scene=$1 run=$2 limit=$3 points=$4
shift 4
# shellcheck source=bench/scenes/programs.sh
. "$(dirname "$0")/programs.sh"
metrics=$run/metrics.jsonl

"$cln" train "$scene" -o "$run" --time-limit "$limit" --eval-at "$points" --progress none "$@" >&2
"$cln" eval "$run" --save-images --progress none --json >"$run/scene.json"
value() {
    "$query" "$1" <"$2"
}
from=$("$query" config.structure_until <"$run/run.json")

echo "| training seconds | steps | leaves | PSNR train | PSNR test | SSIM test |"
echo "|---|---|---|---|---|---|"
# step and seconds are adjacent in a row, the others follow in this order
n='([0-9.]+)'
grep '"psnr_test"' "$metrics" | sed -E \
    -e 's/.*"step":'$n',"seconds":'$n'.*"psnr_train":'$n'.*"leaves":'$n'.*"psnr_test":'$n'.*/'\
'\2 \1 \4 \3 \5/' |
    awk '{ printf "| %.0f | %d | %d | %.2f | %.2f | |\n", $1, $2, $3, $4, $5 }'
awk -v psnr="$(value mean.psnr "$run/scene.json")" -v ssim="$(value mean.ssim "$run/scene.json")" \
    -v time="$(value train_seconds "$run/scene.json")" -v step="$(value step "$run/scene.json")" \
    -v leaves="$(value result.leaves "$run/run.json")" \
    -v train="$(value result.psnr_train "$run/run.json")" \
    -v each="$(value mean.seconds "$run/scene.json")" \
    -v device="$(value result.device_peak "$run/run.json")" \
    -v host="$(value result.host_peak "$run/run.json")" 'BEGIN {
    printf "| %.0f, all views | %d | %d | %.2f | %.2f | %.3f |\n\n",
        time, step, leaves, train, psnr, ssim
    printf "%.2f s a picture; at most %.0f MB on the device, %.0f MB in the process.\n\n",
        each, device / 1e6, host / 1e6 }'

# rows of metrics.jsonl: stages since the previous row, in seconds
end=$(tail -n 1 "$metrics" | sed -E 's/.*"seconds":([0-9.]+).*/\1/')
grep '"stages"' "$metrics" | awk -v after="$(echo "$from $end" | awk '{ print $1 * $2 }')" '
    function field(name) {
        key = "\"" name "\":"
        if (!match($0, key "[0-9.e+-]+"))
            return 0
        return substr($0, RSTART + length(key), RLENGTH - length(key)) + 0
    }
    {
        seconds = field("seconds"); step = field("step")
        if (/"padding"/) { padding += field("padding"); filled += field("leaf_samples"); rows++ }
        if (seconds < after) {
            first = seconds; first_step = step; padding = filled = rows = 0
            next
        }
        match($0, /"stages":\{[^}]*/)
        n = split(substr($0, RSTART + 10, RLENGTH - 10), parts, ",")
        for (i = 1; i <= n; i++) {
            split(parts[i], pair, ":")
            gsub(/"/, "", pair[1])
            if (pair[1] ~ /^(evaluation|probes|viewing)$/) { # not in training seconds
                apart[pair[1]] += pair[2]
                continue
            }
            if (!(pair[1] in sum)) order[++kinds] = pair[1]
            sum[pair[1]] += pair[2]; device += pair[2]
        }
    }
    END {
        steps = step - first_step; all = seconds - first
        if (steps <= 0) exit
        printf "| stage, steps %d to %d | ms a step | share |\n|---|---|---|\n", first_step, step
        for (i = 1; i <= kinds; i++)
            printf "| %s | %.2f | %.1f %% |\n", order[i], 1e3 * sum[order[i]] / steps,
                100 * sum[order[i]] / all
        printf "| host, and the device waiting for it | %.2f | %.1f %% |\n",
            1e3 * (all - device) / steps, 100 * (all - device) / all
        printf "| all | %.2f | |\n", 1e3 * all / steps
        for (name in apart)
            printf "\nBeside it: %s, %.1f s.\n", name, apart[name]
        if (rows)
            printf "\n%.0f samples a leaf; %.1f %% of the rows of the forward tiles are empty.\n",
                filled / rows, 100 * padding / rows
    }'
