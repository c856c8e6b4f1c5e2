#!/bin/sh
# How much does the seed decide? Trains one scene from several seeds for as many steps, and
# evaluates every test view: a row per seed, then mean, spread (standard deviation) and worst. With
# a number of steps the same command gives the same bits: other work on the machine changes only the
# seconds.
#
#   bench/scenes/seeds.sh SCENE OUT STEPS SEEDS [TRAIN OPTIONS]
#   bench/scenes/seeds.sh build/demo/scene build/seeds 2500 "$(seq 0 19)"
#
# A run is OUT/seed-N. The same command continues a stopped bench: it keeps finished runs and
# resumes interrupted ones. Each run adds its row to OUT/seeds.md. Trains networks (--preset fast)
# unless TRAIN OPTIONS, which go to every run, name another preset; a run made with others ends the
# bench. The self-test is skipped. Seconds are processor seconds of training and evaluation, of all
# calls that trained the seed.
# CLN, QUERY: the programs (build/cl-nascent, build/json-query).
set -eu
[ $# -ge 4 ] || { sed -n '2,/^[^#]/s/^# \{0,1\}//p' "$0"; exit 2; }
# shellcheck source=bench/common/lib.sh
. "$(dirname "$0")/../common/lib.sh"
bench=seeds scene=$1 out=$2 steps=$3 seeds=$4
shift 4
# shellcheck source=bench/scenes/programs.sh
. "$(dirname "$0")/programs.sh"
limit="$steps steps"
mkdir -p "$out"

# One seed: trained, evaluated, and a row in OUT/seed-N.row.
one() {
    seed=$1
    shift
    run=$out/seed-$seed
    row=$run.row
    given=$(printf '%s\n' "$scene" "$steps" "$@")
    if [ -e "$run.options" ] && [ "$(cat "$run.options")" != "$given" ]; then
        bench_fail "$run was made with other options ($run.options); choose another OUT"
    fi
    [ ! -e "$run" ] || [ -e "$run.options" ] ||
        bench_fail "$run was not made by this bench; choose another OUT"
    printf '%s\n' "$given" >"$run.options"
    [ ! -s "$row" ] || return 0
    [ "$(bench_state "$run")" != none ] || rm -f "$run.times"
    # a call that is interrupted adds its seconds, too
    trap 'times >>"$run.times"' EXIT
    trap 'exit 130' INT TERM
    bench_run "$run" fast --steps "$steps" --seed "$seed" --skip-selftest "$@" ||
        bench_fail "$run does not fit the device; see $run.log"
    "$cln" eval "$run" --max-images 0 --no-save-images --progress none --json >"$run.eval.json" \
        2>>"$run.log" || bench_fail "$run: see $run.log"
    times >>"$run.times" # not in a pipe: its process would have no children to count
    trap - EXIT
    printf '%s %s %s %s %s %s\n' "$seed" "$(bench_value "seed-$seed" result.leaves)" \
        "$(bench_value "seed-$seed" result.psnr_train)" \
        "$("$query" mean.psnr <"$run.eval.json")" "$("$query" mean.ssim <"$run.eval.json")" \
        "$(awk 'NR % 2 == 0 {
            for (i = 1; i <= 2; i++) { split($i, t, "m"); sum += 60 * t[1] + t[2] }
        } END { print sum }' "$run.times")" >"$row.new"
    mv "$row.new" "$row"
}

# OUT/seeds.md from the rows that are there
write_table() {
    cat "$out"/seed-*.row | sort -n | awk -v steps="$steps" '
        NR == 1 {
            print "| seed | leaves | PSNR train | PSNR test | SSIM test | processor seconds |"
            print "|---|---|---|---|---|---|"
            best = worst = $4
        }
        {
            printf "| %d | %d | %.2f | %.2f | %.4f | %.0f |\n", $1, $2, $3, $4, $5, $6
            sum += $4; squares += $4 * $4; ssim += $5; train += $3
            if ($4 > best) best = $4
            if ($4 < worst) { worst = $4; which = $1 }
        }
        END {
            mean = sum / NR
            variance = NR > 1 ? (squares - NR * mean * mean) / (NR - 1) : 0
            spread = variance > 0 ? sqrt(variance) : 0
            printf "\n%d seeds, %d steps each: PSNR test %.2f dB on average, standard deviation ",
                NR, steps, mean
            printf "%.2f dB, best %.2f dB, worst %.2f dB (seed %d, %.2f dB below the best); ",
                spread, best, worst, which, best - worst
            printf "PSNR train %.2f dB, SSIM test %.4f on average.\n", train / NR, ssim / NR
        }' >"$out/seeds.md.new"
    mv "$out/seeds.md.new" "$out/seeds.md"
}

for seed in $seeds; do
    (one "$seed" "$@") || exit
    write_table
done
cat "$out/seeds.md"
bench_say "$out/seeds.md"
