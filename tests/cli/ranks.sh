#!/bin/bash
# Training, evaluation and rendering by several processes (docs/scale-out.md). With samples
# exchanged, model and pictures are those of one process, bit for bit, also when another number of
# processes resumes; with stretches they are nearly the same, in fewer bytes. All write one
# checkpoint. Settings that differ, and a process that dies or cannot write, end all.
#   tests/cli/ranks.sh [SECTION...]    sections are in the last lines
# Skipped without OpenMPI, which tests/deps.sh installs on Debian.
set -u
cd "$(dirname "$0")/../.." || exit 1

ranked=$PWD/build/mpi/cl-nascent
shim=$PWD/build/faults.so
work=$(mktemp -d "${TMPDIR:-/tmp}/cln ranks XXXXXX")
beside="" # process of the sections that run beside the others
trap '[ -z "$beside" ] || kill "$beside" 2>/dev/null; rm -rf "$work"' EXIT
. tests/support/checks.sh

if ! command -v mpirun >/dev/null || ! pkg-config --exists ompi-c; then
    skip ranks "no OpenMPI (apt-get install libopenmpi-dev openmpi-bin)"
    count
    exit
fi
${MAKE:-make} --no-print-directory MPI=1 build/mpi/cl-nascent build/faults.so >"$work/out" 2>&1 ||
    bad "make MPI=1"

export OMPI_ALLOW_RUN_AS_ROOT=1 OMPI_ALLOW_RUN_AS_ROOT_CONFIRM=1 POCL_MAX_PTHREAD_COUNT=1
mpi=(mpirun --oversubscribe --bind-to none)

small=("${adapted[@]}")

baseline() {
    [ -d "$work/scene" ] && return
    "$make_scene" "$work/scene" --size 48 --train 8 --test 2 >/dev/null || bad "make-scene"
    expect "train with one process" 0 "" "$cln" train "$work/scene" -o "$work/one" "${small[@]}" \
        --steps 200
}

samples=(--exchange samples) # with the bits of one process

# three ranks by samples; $three_sent: bytes that rank 0 sent
three() {
    [ -d "$work/parts" ] && return
    expect "three ranks train by samples" 0 "" "${mpi[@]}" -n 3 "$ranked" train "$work/scene" \
        -o "$work/parts" "${small[@]}" "${samples[@]}" --steps 200
    three_sent=$(number sent_bytes "$work/parts/metrics.jsonl")
}

# Three ranks share the walk of rays; of a batch with too many samples, its first rays alone.
section_walk() {
    local cut=(--steps 40 --rays 8192 --batch-samples 1024)

    baseline
    expect "one process cuts its batches" 0 "" "$cln" train "$work/scene" -o "$work/cut" \
        "${small[@]}" "${cut[@]}"
    expect "three ranks cut theirs" 0 "" "${mpi[@]}" -n 3 "$ranked" train "$work/scene" \
        -o "$work/cut three" "${small[@]}" "${samples[@]}" "${cut[@]}"
    check "the model is that of one process" same_model "$work/cut" "$work/cut three"
    expect "three ranks cut theirs by stretches" 0 "" "${mpi[@]}" -n 3 "$ranked" train \
        "$work/scene" -o "$work/cut stretches" "${small[@]}" "${cut[@]}" --log-every 1
    check "and tell each other intervals" grep -q '"intervals"' "$work/cut stretches/metrics.jsonl"
}

section_same() {
    baseline
    expect "train with two ranks" 0 "" "${mpi[@]}" -n 2 "$ranked" train "$work/scene" \
        -o "$work/two" "${small[@]}" "${samples[@]}" --steps 200 -v
    check "leaves moved between them" said "moved to other ranks"
    check "the model is that of one process" same_model "$work/one" "$work/two"
    check "one rank prints the run" [ "$(grep -c '^run ' "$work/out")" = 1 ]
    check "and warns" [ "$(grep -c 'only 8 training photos' "$work/err")" = 1 ]
    check "rows have the bytes sent" grep -q '"sent_bytes"' "$work/two/metrics.jsonl"
    check "and the idlest and the busiest rank's seconds in messages" awk -F'"messages":[[]' '
        NF == 2 { split($2, ends, "[],]"); n++; if (!(ends[1] > 0 && ends[1] < ends[2])) bad++ }
        END { exit !(n > 100 && bad < 2) }' "$work/two/metrics.jsonl"
    check "the report shows them" grep -q '<tr><td>messages<td class=n>' "$work/two/report.html"
    "$make_scene" "$work/shaken" --size 48 --train 8 --test 2 --fault shaken >/dev/null
    run "$cln" train "$work/shaken" -o "$work/refined" "${small[@]}" --steps 400 --refine-poses
    check "one process refines poses" said "training cameras were turned by"
    expect "two ranks refine poses" 0 "~cameras.were.turned.by" "${mpi[@]}" -n 2 "$ranked" train \
        "$work/shaken" -o "$work/refined two" "${small[@]}" "${samples[@]}" --steps 400 \
        --refine-poses
    check "both refine to the same bits" same_model "$work/refined" "$work/refined two"
    local more=(--steps 60 --distortion-loss 0.01 --edge 0.01 --sparsity 0.01 --stage1 splat
        --moments bfloat16)
    run "$cln" train "$work/scene" -o "$work/more" "${small[@]}" "${more[@]}"
    expect "three ranks, with regularisers and splatting" 0 "" "${mpi[@]}" -n 3 "$ranked" train \
        "$work/scene" -o "$work/three" "${small[@]}" "${more[@]}"
    check "their model is that of one process" same_model "$work/more" "$work/three"
}

# number KEY FILE: of the last row that has it
number() {
    sed -n 's/.*"'"$1"'":\([0-9.e+-]*\).*/\1/p' "$2" | tail -n 1
}

# psnr RUN: of its last evaluation
psnr() {
    "$query" mean.psnr <"$(ls "$1"/eval/*-test.json | tail -n 1)"
}

# near A B: two PSNRs of trainings that differ by rounding, which grows with every step
near() {
    awk -v a="$1" -v b="$2" 'BEGIN { exit !(a > 12 && a - b < 0.7 && b - a < 0.7) }'
}

section_stretches() {
    baseline
    local n on
    for n in 2 3; do
        on=$work/stretch-$n
        expect "train with $n ranks by stretches" 0 "" "${mpi[@]}" -n $n "$ranked" train \
            "$work/scene" -o "$on" "${small[@]}" --steps 200 -v
        check "leaves moved between them" said "moved to other ranks"
        check "the pictures are about as good as those of one process" \
            near "$(psnr "$on")" "$(psnr "$work/one")"
    done
    expect "two ranks by stretches, again" 0 "" "${mpi[@]}" -n 2 "$ranked" train "$work/scene" \
        -o "$work/stretch-again" "${small[@]}" --steps 200
    check "the same ranks and seed give the same bits" \
        same_model "$work/stretch-2" "$work/stretch-again"
    # the first step has one process's rays and samples: its loss differs by rounding alone
    check "the first step's loss is that of one process" eval '
        paste <(grep -o "\"loss\":[0-9.e-]*" "$work/one/metrics.jsonl" | head -n 1) \
              <(grep -o "\"loss\":[0-9.e-]*" "$work/stretch-2/metrics.jsonl" | head -n 1) |
            sed "s/\"loss\"://g" | awk "{ d = \$1 / \$2 - 1; exit !(d * d < 1e-10) }"'
    three
    check "fewer bytes than by samples" awk \
        -v a="$(number sent_bytes "$work/stretch-3/metrics.jsonl")" -v b="$three_sent" \
        'BEGIN { exit !(a > 0 && a < 0.95 * b) }'
    expect "every loss, by stretches" 0 "" "${mpi[@]}" -n 2 "$ranked" train "$work/scene" \
        -o "$work/losses" "${small[@]}" --steps 40 --distortion-loss 0.01 --cauchy 1e-4 \
        --opacity-entropy 0.01 --loss huber --stage1 splat
    # one process first: several would each compile the same kernels
    run "$cln" train "$work/scene" -o "$work/points-one" "${small[@]}" --steps 40 --sparsity 0.01
    expect "regularisers of points, by samples" 0 "" "${mpi[@]}" -n 2 "$ranked" train \
        "$work/scene" -o "$work/points" "${small[@]}" --steps 40 --sparsity 0.01
    check "they have the bits of one process" same_model "$work/points" "$work/points-one"
}

# Photos are dealt: a rank reads and keeps its own alone, and learns others' pixels by messages.
section_photos() {
    baseline
    local r i limit
    # of eight training photos, three ranks have 0-2, 3-4 and 5-7; a rank also compares the files of
    # the next one with it, but never opens those of the third
    for r in 0 1 2; do
        cp -r "$work/scene" "$work/scene-$r"
    done
    for i in 0/r_005 0/r_006 0/r_007 1/r_000 1/r_001 1/r_002 2/r_003 2/r_004; do
        head -c 64 "$work/scene/train/${i#*/}.png" >"$work/scene-${i%/*}/train/${i#*/}.png"
    done
    expect "three ranks without each other's photos" 0 "" "${mpi[@]}" \
        -n 1 "$ranked" train "$work/scene-0" -o "$work/dealt" "${small[@]}" "${samples[@]}" \
        --steps 200 : \
        -n 1 "$ranked" train "$work/scene-1" -o "$work/dealt" "${small[@]}" "${samples[@]}" \
        --steps 200 : \
        -n 1 "$ranked" train "$work/scene-2" -o "$work/dealt" "${small[@]}" "${samples[@]}" \
        --steps 200
    check "their model is that of one process" same_model "$work/one" "$work/dealt"
    check "the last evaluation's pictures are those of one process" \
        diff -r -x '*tree*' "$work/one/eval/00000200-test" "$work/dealt/eval/00000200-test"
    # 48 x 48 x 4 bytes each; of the two test photos, ranks 0 and 2 have one each
    check "rows tell the photos' bytes of the ranks" \
        grep -q '"photo_bytes":\[18432,36864\]' "$work/dealt/metrics.jsonl"
    check "the report shows them" grep -q 'memory for photos.*18.0 KiB' "$work/dealt/report.html"
    expect "one process needs them all" 3 "r_005" "$cln" train "$work/scene-0" -o "$work/no" \
        "${small[@]}" --steps 1
    cp "$work/scene/train/r_006.png" "$work/scene-1/train/r_003.png"
    cp "$work/scene/train/r_00"[012].png "$work/scene-1/train/"
    expect "ranks with different photos are refused" 2 "~different.files.of.*r_003" "${mpi[@]}" \
        -n 1 "$ranked" train "$work/scene" -o "$work/no" "${small[@]}" --steps 1 : \
        -n 1 "$ranked" train "$work/scene-1" -o "$work/no" "${small[@]}" --steps 1
    # masks, and the photos' mean behind the scene
    "$make_scene" "$work/masked" --size 48 --train 8 --test 2 --format nerfstudio --masks >/dev/null
    run "$cln" train "$work/masked" -o "$work/masked-one" "${small[@]}" --steps 60 --masks ignore
    expect "two ranks, photos with masks" 0 "" "${mpi[@]}" -n 2 "$ranked" train "$work/masked" \
        -o "$work/masked-two" "${small[@]}" "${samples[@]}" --steps 60 --masks ignore
    check "their model is that of one process, too" same_model "$work/masked-one" "$work/masked-two"
    # every rank needs all masks, but compares the files of one other rank alone
    cp -r "$work/masked" "$work/masked-0"
    cp "$work/masked/masks/frame_00002.png" "$work/masked-0/masks/frame_00007.png"
    expect "three ranks with different masks are refused" 2 "~rank.1.on ~has.another.set.of.masks" \
        "${mpi[@]}" \
        -n 1 "$ranked" train "$work/masked-0" -o "$work/no" "${small[@]}" --steps 1 \
        --masks ignore : \
        -n 2 "$ranked" train "$work/masked" -o "$work/no" "${small[@]}" --steps 1 \
        --masks ignore
    # more ranks than photos of either split, photos with alpha, each with a gain
    "$make_scene" "$work/few" --size 48 --train 3 --test 1 >/dev/null
    run "$cln" train "$work/few" -o "$work/few-one" "${small[@]}" --steps 40 --exposure
    expect "four ranks, three photos" 0 "" "${mpi[@]}" -n 4 "$ranked" train "$work/few" \
        -o "$work/few-four" "${small[@]}" "${samples[@]}" --steps 40 --exposure
    check "their model is that of one process with three photos" \
        same_model "$work/few-one" "$work/few-four"
    check "and the pictures of the one test photo" diff -r -x '*tree*' \
        "$work/few-one/eval/00000040-test" "$work/few-four/eval/00000040-test"
    # what does not fit a rank's memory beside a tree that cannot be smaller lies in its file
    local still=("${small[@]}" --no-adaptive --level-at "")
    "$make_scene" "$work/large scene" --size 150 --train 8 --test 2 >/dev/null
    run "${mpi[@]}" -n 2 "$ranked" train "$work/large scene" -o "$work/whole" "${still[@]}" \
        --steps 20
    limit=$("$query" host_plan.total <"$work/whole/run.json")
    limit=$(awk -v t="$limit" -v i="$("$query" host_plan.images <"$work/whole/run.json")" \
        'BEGIN { printf "%.0f", t - 0.2 * i }')
    expect "two ranks with little memory" 0 "their pixels go to a file" "${mpi[@]}" -n 2 "$ranked" \
        train "$work/large scene" -o "$work/stored" "${still[@]}" --steps 20 --host-mem "$limit"
    check "their model is the same" same_model "$work/whole" "$work/stored"
    check "and the evaluation's pictures" diff -r "$work/whole/eval/00000020-test" \
        "$work/stored/eval/00000020-test"
    run "$cln" eval "$work/whole" --split train --max-images 2 --save-images -o "$work/seen"
    expect "two ranks with little memory evaluate, which needs less" 0 "" "${mpi[@]}" -n 2 \
        "$ranked" eval "$work/stored" --split train --max-images 2 --save-images \
        -o "$work/seen-stored"
    check "with the pictures of one process" diff -r -x '*.json' "$work/seen" "$work/seen-stored"
}

# process RANK: its id, of the ranks that $child started
process() {
    local of
    for of in /proc/[0-9]*; do
        if grep -q "^PPid:[[:space:]]*$child\$" "$of/status" 2>/dev/null &&
            grep -qzx "OMPI_COMM_WORLD_RANK=$1" "$of/environ" 2>/dev/null; then
            echo "${of#/proc/}"
        fi
    done
}

# tensors RUN: the file of its last checkpoint
tensors() {
    ls "$1"/checkpoint/*.safetensors | tail -n 1
}

# floats RUN NAME: the numbers of that tensor of 32 bits, one a line
floats() {
    local file header length from to
    file=$(tensors "$1")
    length=$(($(od -An -tu8 -N8 "$file")))
    header=$(tail -c +9 "$file" | head -c $length)
    from=$("$query" "$2.data_offsets.0" <<<"$header")
    to=$("$query" "$2.data_offsets.1" <<<"$header")
    tail -c +$((9 + length + from)) "$file" | head -c $((to - from)) | od -An -v -tf4 -w4
}

# equal RUN RUN NAME PARAMS: in each leaf of PARAMS numbers, the tensors differ by less than 1e-5 of
# the root of the sum of squares; some are not 0
equal() {
    paste <(floats "$1" "$3") <(floats "$2" "$3") | awk -v each="$4" '
        { a += $1 * $1; d += ($1 - $2) * ($1 - $2) }
        NR % each == 0 { some += a > 0; if (d > 1e-10 * a) bad++; a = d = 0 }
        END { exit !(some > 4 && !bad && NR && NR % each == 0) }'
}

# One step has the gradients of one process, thus the weights: by samples to the bit, by stretches
# within rounding. Adam turns a gradient of rounding errors into a whole step: weights, whose
# gradient is much smaller than the leaf's, may differ by that.
section_step() {
    local n params step=(--steps 1 --start-level 2 --level-at "" --no-adaptive --moments float32
        --roulette 0 --rrelu-lower -0.2 --rrelu-upper -0.2)
    baseline
    run "$cln" train "$work/scene" -o "$work/step-1" "${small[@]}" "${step[@]}"
    params=$("$query" params_per_leaf <"$(ls "$work/step-1"/checkpoint/*.json)")
    for n in 2 3; do
        expect "a step by $n ranks" 0 "" "${mpi[@]}" -n $n "$ranked" train "$work/scene" \
            -o "$work/step-$n" "${small[@]}" "${step[@]}"
        check "its gradients are those of one" equal "$work/step-1" "$work/step-$n" adam_m "$params"
        check "its weights are those of one" equal "$work/step-1" "$work/step-$n" params "$params"
        run "${mpi[@]}" -n $n "$ranked" train "$work/scene" -o "$work/step-samples-$n" \
            "${small[@]}" "${step[@]}" "${samples[@]}"
        check "by samples its bits are those of one" \
            same_model "$work/step-1" "$work/step-samples-$n"
    done
}

# voxels: a tree that grows by a level, is culled, then splits single leaves; some leaves have more
# samples than a slice
voxels=(--skip-selftest --progress none --preset voxel --start-level 1 --level-at 2:0.1 --rays 512
    --batch-samples 8192 --refresh-every 8 --cull-after 8 --cell-pixels 0.1 --log-every 1
    --structure-from 0.4 --structure-every 0.1 --structure-wait 0 --split-samples 0
    --max-leaves 300 --regrow 0.01 --lr 0.05 --antialias-after 0.2)

# copies RUN: each vertex is the same in all leaves that have it, and some have
copies() {
    build/voxel-copies "$1" | grep -qE '^[1-9][0-9]+ copies, 0 differ$'
}

# Voxels: vertices that leaves of several ranks have get the gradients of all. Step, splits and
# joins are those of one process, by samples to the bit.
section_voxels() {
    local n on one=$work/vox-1 step=(--steps 1 --start-level 2 --level-at "" --no-adaptive
        --moments float32 --roulette 0 --beta1 0.9)
    ${MAKE:-make} --no-print-directory build/voxel-copies >"$work/out" 2>&1 ||
        bad "make voxel-copies"
    baseline
    run "$cln" train "$work/scene" -o "$one" "${voxels[@]}" --steps 120 -v
    check "one process splits single leaves" said "~structure|leaves.->"
    expect "train voxels with three ranks by samples" 0 "~moved.to.other.ranks" "${mpi[@]}" -n 3 \
        "$ranked" train "$work/scene" -o "$work/vox-samples" "${voxels[@]}" "${samples[@]}" \
        --steps 120 -v
    check "the checkpoint has the bytes of one process" \
        cmp "$(tensors "$one")" "$(tensors "$work/vox-samples")"
    for n in 2 3; do
        on=$work/vox-$n
        expect "train voxels with $n ranks by stretches" 0 "~moved.to.other.ranks" "${mpi[@]}" \
            -n $n "$ranked" train "$work/scene" -o "$on" "${voxels[@]}" --steps 120 -v
        check "all copies of vertices are equal" copies "$on"
        check "pictures of these voxels are about as good" near "$(psnr "$on")" "$(psnr "$one")"
    done
    expect "two ranks train voxels again, with means at edges" 0 \
        "~pixels.at.edges.are.means.of.4.rays" "${mpi[@]}" -n 2 "$ranked" train "$work/scene" \
        -o "$work/vox-again" "${voxels[@]}" --steps 120 -v
    check "the same ranks and seed give the same voxels" same_model "$work/vox-2" "$work/vox-again"
    check "rows have the bytes of common vertices" \
        number_above "$(number vertex_bytes "$on/metrics.jsonl")" 1000
    check "the report has them, too" grep -q 'for common vertices of leaves' "$on/report.html"
    run "$cln" train "$work/scene" -o "$work/vox-step-1" "${voxels[@]}" "${step[@]}"
    n=$("$query" params_per_leaf <"$(ls "$work/vox-step-1"/checkpoint/*.json)")
    expect "a step of voxels by three ranks" 0 "" "${mpi[@]}" -n 3 "$ranked" train "$work/scene" \
        -o "$work/vox-step-3" "${voxels[@]}" "${step[@]}"
    check "its gradients are those of one" equal "$work/vox-step-1" "$work/vox-step-3" adam_m "$n"
    check "its voxels are those of one" equal "$work/vox-step-1" "$work/vox-step-3" params "$n"
    local decoded=("${voxels[@]}" --decoder-width 16 --decoder-after 0)
    run "$cln" train "$work/scene" -o "$work/decoder-1" "${decoded[@]}" "${step[@]}"
    expect "two ranks train a decoder" 0 "" "${mpi[@]}" -n 2 "$ranked" train "$work/scene" \
        -o "$work/decoder-2" "${decoded[@]}" "${step[@]}"
    check "the decoder's gradient is that of one" \
        equal "$work/decoder-1" "$work/decoder-2" decoder_m 4
    "$make_scene" "$work/masked" --format nerfstudio --masks --size 40 --train 30 --test 2 \
        >/dev/null || bad "make-scene"
    run "$cln" train "$work/masked" -o "$work/masked-1" "${voxels[@]}" --steps 8
    check "one process takes the box that masks show" said "~cube:.the.cube.around.--bbox"
    expect "so do two" 0 "~cube:.the.cube.around.--bbox" "${mpi[@]}" -n 2 "$ranked" train \
        "$work/masked" -o "$work/masked-2" "${voxels[@]}" "${samples[@]}" --steps 8
    check "their model is that of one" same_model "$work/masked-1" "$work/masked-2"
    cp -r "$work/vox-2" "$work/vox-on-1"
    expect "one process goes on with voxels of two" 0 "resumed" "$cln" train \
        --resume "$work/vox-on-1" --skip-selftest --progress none --steps +10
    for n in 2 3; do
        cp -r "$work/vox-2" "$work/vox-on-$n"
        expect "$n go on with voxels of two" 0 "resumed" "${mpi[@]}" -n $n "$ranked" train \
            --resume "$work/vox-on-$n" --skip-selftest --progress none --steps +10 "${samples[@]}"
        check "to the same voxels" same_model "$work/vox-on-1" "$work/vox-on-$n"
    done
}

# start RUN OPTIONS...: two ranks in the background, once they train; $child: mpirun. $told: where
# it writes its stderr, if not to $work/err
start() {
    local on=$1 end=$((SECONDS + 300))
    shift
    "${mpi[@]}" -n 2 "$ranked" train "$work/scene" -o "$on" "${small[@]}" "$@" >"$work/out" \
        2>"${told:-$work/err}" &
    child=$!
    until [ -s "$on/metrics.jsonl" ] || [ $SECONDS -ge $end ]; do
        sleep 0.02
    done
}

section_resume() {
    baseline
    start "$work/on" "${samples[@]}" --steps 200
    kill -TERM "$(process 1)" # any of them
    wait "$child"
    check "a signal to one stops all, after a checkpoint" said "stopped by a signal"
    check "it stopped before the end" [ "$(digest "$work/on")" != "$(digest "$work/one")" ]
    expect "three ranks resume the run of two" 0 "resumed" "${mpi[@]}" -n 3 "$ranked" train \
        --resume "$work/on" --skip-selftest --progress none
    check "the model is that of one process" same_model "$work/one" "$work/on"
    start "$work/by-stretches" --steps 200
    kill -TERM "$(process 0)"
    wait "$child"
    expect "one process resumes a run by stretches" 0 "resumed" "$cln" train \
        --resume "$work/by-stretches" --skip-selftest --progress none
    local n
    expect "four ranks train" 0 "" "${mpi[@]}" -n 4 "$ranked" train "$work/scene" -o "$work/four" \
        "${small[@]}" "${samples[@]}" --steps 12
    for n in 1 2 8; do
        cp -r "$work/four" "$work/four-$n"
        expect "$n go on with the run of four" 0 "resumed" "${mpi[@]}" -n $n "$ranked" train \
            --resume "$work/four-$n" --skip-selftest --progress none --steps 24
        check "to the same model" same_model "$work/four-1" "$work/four-$n"
    done
    check "which is not that of four" [ "$(digest "$work/four")" != "$(digest "$work/four-1")" ]
}

# near_plan RUN: the rank that took most device memory took no more than the plan, and the plan has
# no more than 15 % above that
near_plan() {
    awk -v most="$(sed -n 's/.*"device_peaks":[[][^,]*,\([0-9.e+]*\).*/\1/p' "$1/metrics.jsonl" |
        tail -n 1)" -v plan="$("$query" plan.total <"$1/run.json")" 'BEGIN {
            printf "plan %.1f MiB, allocated %.1f\n", plan / 1048576, most / 1048576 >"/dev/stderr"
            exit !(most > 0 && most <= plan && plan <= 1.15 * most) }' 2>"$work/err"
}

# What does not fit --device-mem of one process is trained by four, each within it.
section_memory() {
    local limit n on=$work/full
    local large=(--skip-selftest --progress none --preset fast --width 64 --depth 8 --start-level 2
        --level-at "" --no-adaptive --rays 64 --batch-samples 1024 --n1 8 --steps 2)
    baseline
    run "$cln" train "$work/scene" -o "$on" "${large[@]}" --device-mem 1M
    limit=$(grep -oE '= [0-9.]+ MiB of' "$work/err" | awk '{ printf "%.1fM", 0.88 * $2 }')
    expect "a training too large for one process" 5 "~leaf.weights device-mem" "$cln" train \
        "$work/scene" -o "$on" "${large[@]}" --device-mem "$limit"
    check "it writes nothing" [ ! -e "$on" ]
    expect "four ranks train it" 0 "" "${mpi[@]}" -n 4 "$ranked" train "$work/scene" -o "$on" \
        "${large[@]}" --device-mem "$limit"
    check "of more than 56 leaves" [ "$("$query" result.leaves <"$on/run.json")" -gt 56 ]
    check "rank 0 in that memory" \
        number_above "$(awk -v m="${limit%M}" 'BEGIN { print m * 1048576 }')" \
        "$("$query" result.device_peak <"$on/run.json")"
    # most memory is that of voxels' leaves; most of these split, then some move
    for n in 2 3; do
        run "${mpi[@]}" -n $n "$ranked" train "$work/scene" -o "$work/planned-$n" "${voxels[@]}" \
            --start-level 2 --level-at "" --max-alloc 5M --batch-samples 2048 --rays 256 \
            --cull-from 1 --max-level 3 --max-leaves 400 --regrow 0 --steps 36
        check "memory of $n ranks is as planned" near_plan "$work/planned-$n"
    done
}

# Ranks of a machine take the devices that match in turn: here two of different kinds, which one
# training cannot have; unless the choice leaves only one of them.
section_devices() {
    local go=(train "$work/scene" -o "$work/devices" "${small[@]}" --steps 2)
    baseline
    if [ "$(POCL_DEVICES="pthread basic" "$cln" devices --json 2>/dev/null |
        grep -cE '"name": "(pthread|basic)')" != 2 ]; then
        skip "devices of ranks" "no two devices by POCL_DEVICES"
        return
    fi
    export POCL_DEVICES="pthread basic"
    expect "two ranks take two devices" 2 "~rank.1.on ~has.another.device" \
        "${mpi[@]}" -n 2 "$ranked" \
        "${go[@]}"
    expect "ranks share a device that alone matches" 0 "" "${mpi[@]}" -n 2 "$ranked" "${go[@]}" \
        -d pthread
    unset POCL_DEVICES
}

# faulty HOW K: two ranks train on and write a checkpoint; rank 1's K-th write fails, HOW
# (support/faults.c)
faulty() {
    local go=(train --resume "$work/parts" --skip-selftest --progress none --steps +20)
    "${mpi[@]}" -n 1 "$ranked" "${go[@]}" : -n 1 env LD_PRELOAD="$shim" FAULT_CALL=write \
        FAULT_DO="$1" FAULT_AT="$2" "$ranked" "${go[@]}"
}

# The file that ranks write together is that of one process, on a shared file system or not; a rank
# that cannot write its part leaves the last checkpoint intact.
section_checkpoints() {
    baseline
    local before at
    three
    check "the checkpoint of three ranks has the bytes of one process" \
        cmp "$(tensors "$work/one")" "$(tensors "$work/parts")"
    mkdir "$work/here" "$work/there"
    expect "ranks without a common file system" 0 "rank 0 writes" "${mpi[@]}" \
        -n 1 --wdir "$work/here" "$ranked" train "$work/scene" -o apart "${small[@]}" \
        "${samples[@]}" --steps 200 -v : \
        -n 1 --wdir "$work/there" "$ranked" train "$work/scene" -o apart "${small[@]}" \
        "${samples[@]}" --steps 200 -v
    check "rank 0 writes the checkpoint" \
        cmp "$(tensors "$work/one")" "$(tensors "$work/here/apart")"
    check "only rank 0 writes" [ -z "$(ls "$work/there")" ]
    before=$(digest "$work/parts")
    expect "a rank whose disk is full" 7 "rank 1: space" faulty full 3
    check "a full disk leaves the last checkpoint intact" [ "$(digest "$work/parts")" = "$before" ]
    check "no partial file is left" [ -z "$(find "$work/parts/checkpoint" -name '*.tmp.*')" ]
    for at in 2 6; do
        run faulty kill $at
        check "a rank that dies at its write $at ends all" [ $rc != 0 ]
        check "it leaves the last checkpoint intact" [ "$(digest "$work/parts")" = "$before" ]
    done
    expect "one process resumes that run" 0 "resumed" "$cln" train --resume "$work/parts" \
        --skip-selftest --progress none --steps +20
}

# start_saving RUN: as start, once it has a checkpoint
start_saving() {
    local end=$((SECONDS + 300))
    start "$1" --steps 1000000 --save-every 1
    until [ -e "$1/checkpoint/latest" ] || ! kill -0 "$child" || [ $SECONDS -ge $end ]; do
        sleep 0.02
    done
}

section_dies() {
    baseline
    start_saving "$work/dies"
    kill -9 "$(process 1)"
    wait "$child"
    check "a rank that dies ends all" [ $? != 0 ]
    check "the dead rank is named" grep -q 'process rank 1 with PID' "$work/err" "$work/out"
    expect "the last checkpoint is intact" 0 "" "$cln" info "$work/dies"
}

# A rank that stands still ends all, with its name, when the others have waited long enough; not if
# it goes on before, nor if all stood still.
section_hangs() {
    local rank rows end on=$work/hangs told
    local -a child_of pids
    export CL_NASCENT_RANK_WAIT=soon
    baseline
    expect "a wait that is no time is refused" 2 "CL_NASCENT_RANK_WAIT ~10m.*0" "${mpi[@]}" -n 2 \
        "$ranked" train "$work/scene" -o "$on" "${small[@]}" --steps 20
    CL_NASCENT_RANK_WAIT=10
    for rank in 1 0; do # two runs at once, as both wait most of the time
        told=$on-$rank.err
        start_saving "$on-$rank"
        child_of[rank]=$child
    done
    kill -STOP "$(process 0)" # of the second run: it hangs
    child=${child_of[1]}
    pids=("$(process 0)" "$(process 1)")
    kill -STOP "${pids[0]}"
    sleep 2
    kill -STOP "${pids[1]}" # now all of the first: this time counts for nobody
    sleep 11
    rows=$(wc -l <"$on-1/metrics.jsonl")
    kill -CONT "${pids[@]}"
    end=$((SECONDS + 120))
    while kill -0 "$child" && [ "$(wc -l <"$on-1/metrics.jsonl")" -le "$rows" ] &&
        [ $SECONDS -lt $end ]; do
        sleep 0.1
    done 2>/dev/null
    check "ranks that stood still go on" [ "$(wc -l <"$on-1/metrics.jsonl")" -gt "$rows" ]
    kill -STOP "${pids[1]}"
    for rank in 0 1; do
        child=${child_of[rank]}
        end=$((SECONDS + 120))
        while kill -0 "$child" && [ $SECONDS -lt $end ]; do
            sleep 0.1
        done 2>/dev/null
        kill -9 "$child" 2>/dev/null # it waits for ever
        wait "$child"
        check "a rank $rank that hangs ends all" [ $? = 1 ]
        cp "$on-$rank.err" "$work/err"
        check "rank $rank is named, with its host and what to do" \
            said "~error: rank $((1 - rank)) of 2 .*: rank $rank of 2 on $(hostname) .*--resume"
        check "one sentence says so" [ "$(grep -c 'kept others waiting' "$work/err")" = 1 ]
        expect "the last checkpoint is intact" 0 "" "$cln" info "$on-$rank"
    done
    unset CL_NASCENT_RANK_WAIT
}

# each ONE TWO: two ranks, with other options and of other programs. ONE, TWO: names of arrays with
# program and options
each() {
    local -n one=$1 two=$2
    "${mpi[@]}" -n 1 "${one[@]}" : -n 1 "${two[@]}"
}

# Where cameras look in parallel, two ranks find a box among their own photos; they share what the
# machine has.
section_parallel() {
    local air=$work/air one two
    "$make_scene" "$air" --kind terrain --size 96 --train 32 --test 0 --format nerfstudio >/dev/null
    rm "$air"/images/frame_000{17..32}.png # the oblique ones
    expect "two ranks find a box where cameras look in parallel" 0 \
        "~places.that.photos.show.alike --bbox" "${mpi[@]}" -n 2 "$ranked" train "$air" \
        -o "$work/air-two" "${small[@]}" --missing skip --preset voxel --steps 2
    run "$cln" train "$air" -o "$work/air-one" "${small[@]}" --missing skip --preset voxel --steps 2
    one=$("$query" host_plan.limit <"$work/air-one/run.json")
    two=$("$query" host_plan.limit <"$work/air-two/run.json")
    check "each may take half of the memory: $two of $one" awk -v a="$one" -v b="$two" \
        'BEGIN { exit !(b > 0.499 * a && b < 0.501 * a) }'
}

# What differs between ranks is found before the first step.
# shellcheck disable=SC2034 # here, there: `each` takes their names
section_differ() {
    baseline
    local here there version on=$work/differ
    local go=(train "$work/scene" -o "$on" "${small[@]}" --steps 20)
    here=("$ranked" "${go[@]}")
    there=("$ranked" "${go[@]}" --seed 7)
    expect "ranks of different settings are refused" 2 \
        "~rank.1.on ~has.another.choice.of.settings" \
        each here there
    "$make_scene" "$work/other" --size 48 --train 8 --test 2 --fault shaken >/dev/null
    there=("$ranked" train "$work/other" "${go[@]:2}")
    expect "ranks of different scenes are refused" 2 "~rank.1.on ~has.another.scene" each here there
    # sparse points, which are no part of a scene's digest; the cube is given
    "$make_scene" "$work/sparse" --kind terrain --format colmap --size 32 --train 6 --test 0 \
        >/dev/null
    cp -r "$work/sparse" "$work/sparse-1"
    head -n 200 "$work/sparse/sparse/0/points3D.txt" >"$work/sparse-1/sparse/0/points3D.txt"
    local depths=("${go[@]:2}" --depth-loss 0.1 "--bbox=-2,-2,-2,2,2,2")
    here=("$ranked" train "$work/sparse" "${depths[@]}")
    there=("$ranked" train "$work/sparse-1" "${depths[@]}")
    expect "ranks of different sparse points are refused" 2 \
        "~rank.1.on ~has.another.set.of.sparse.points" each here there
    # a run that only one machine has
    mkdir -p "$work/machine a" "$work/machine b"
    ln -s "$work/scene" "$work/machine a/scene"
    ln -s "$work/scene" "$work/machine b/scene"
    go=(train scene -o run "${small[@]}" --resume-or-start)
    run env -C "$work/machine a" "$cln" "${go[@]}" --steps 20
    for there in 20 40; do
        here=(--wdir "$work/machine a" "$ranked" "${go[@]}" --steps "$there")
        expect "a run that rank 1 has not is not gone on with" 2 \
            "~rank.1.on ~does.not.have.this.run" "${mpi[@]}" -n 1 "${here[@]}" : \
            -n 1 --wdir "$work/machine b" "${here[@]:2}"
    done
    go=(train "$work/scene" -o "$on" "${small[@]}" --steps 20)
    here=("$ranked" "${go[@]}")
    # this program, but for the digits of its version
    version=$("$ranked" --version | cut -d' ' -f2)
    sed "s/${version//./\\.}\x00/$(tr 0-9 1-90 <<<"$version")\x00/g" "$ranked" >"$work/newer"
    chmod +x "$work/newer"
    there=("$work/newer" "${go[@]}")
    expect "ranks of different versions are refused" 2 "~rank.1.on ~has.another.version" \
        each here there
    check "different ranks write nothing" [ ! -e "$on" ]
    cp -r "$work/one" "$on"
    run "$cln" train --resume "$on" --skip-selftest --progress none --steps +1
    go=(--skip-selftest --progress none --steps 300)
    here=("$ranked" train --resume "$work/one" "${go[@]}")
    there=("$ranked" train --resume "$on" "${go[@]}")
    expect "ranks of different checkpoints are refused" 2 "~rank.1.on ~has.another.checkpoint" \
        each here there
}

# Pictures by ranks: files equal to one process's, and a model too large for one is shown by four.
section_pictures() {
    baseline
    run "$cln" eval "$work/one" -o "$work/eval-one" --save-images
    expect "evaluate with two ranks" 0 "" "${mpi[@]}" -n 2 "$ranked" eval "$work/one" \
        -o "$work/eval-two" --save-images
    check "one rank prints the mean" [ "$(grep -c '^mean' "$work/out")" = 1 ]
    check "pictures are those of one process" diff -r -x '*.json' "$work/eval-one" "$work/eval-two"
    check "figures are those of one process" diff <(grep -v seconds "$work/eval-one/"*-test.json) \
        <(grep -v seconds "$work/eval-two/"*-test.json)
    run "$cln" render "$work/one" -o "$work/render-one" --normals --seen --antialias 2
    expect "render with three ranks" 0 "" "${mpi[@]}" -n 3 "$ranked" render "$work/one" \
        -o "$work/render-two" --normals --seen --antialias 2
    check "frames are those of one process" diff -r "$work/render-one" "$work/render-two"
    rm "$work/render-two/test_r_001.png"
    expect "render a missing frame" 0 "" "${mpi[@]}" -n 2 "$ranked" render "$work/one" \
        -o "$work/render-two" --normals --seen --antialias 2
    check "only one frame is rendered" grep -q '1 rendered.* 1 left as it is' "$work/out"
    check "frames are those of one process again" diff -r "$work/render-one" "$work/render-two"
    expect "ranks of different frames are refused" 2 "checkpoint or choice of frames" \
        "${mpi[@]}" -n 1 "$ranked" render "$work/one" -o "$work/no" : \
        -n 1 "$ranked" render "$work/one" -o "$work/no" --width 24 --height 24
    check "different frames write nothing" [ ! -e "$work/no" ]
    run "$cln" train "$work/scene" -o "$work/voxels" --preset voxel --skip-selftest \
        --progress none --rays 256 --batch-samples 4096 --steps 60
    run "$cln" eval "$work/voxels" -o "$work/voxels-eval-one" --save-images
    expect "evaluate voxels with two ranks" 0 "" "${mpi[@]}" -n 2 "$ranked" eval "$work/voxels" \
        -o "$work/voxels-eval-two" --save-images
    check "pictures of voxels are those of one process" \
        diff -r -x '*.json' "$work/voxels-eval-one" "$work/voxels-eval-two"
    run "$cln" render "$work/voxels" -o "$work/voxels-one"
    expect "render voxels with two ranks" 0 "" "${mpi[@]}" -n 2 "$ranked" render "$work/voxels" \
        -o "$work/voxels-two"
    check "frames of voxels are those of one process" \
        diff -r "$work/voxels-one" "$work/voxels-two"
    run "$cln" train "$work/scene" -o "$work/large" --skip-selftest --progress none --preset fast \
        --width 64 --depth 8 --start-level 2 --level-at "" --max-level 5 --rays 256 \
        --batch-samples 2048 --n1 8 --steps 1
    expect "a model too large for one process" 5 "~leaf.weights device-mem" "$cln" render \
        "$work/large" -o "$work/views of four" --device-mem 13M
    expect "four ranks render that model" 0 "" "${mpi[@]}" -n 4 "$ranked" render "$work/large" \
        -o "$work/views of four" --device-mem 13M
    run "$cln" render "$work/large" -o "$work/alone"
    check "the pictures are those of one process with room" \
        diff -r "$work/alone" "$work/views of four"
}

# viewing COMMAND...: starts a viewer: its $child and $address, empty if it does not serve
viewing() {
    local end=$((SECONDS + 120))
    : >"$work/out"
    env --default-signal=INT,TERM "$@" >"$work/out" 2>"$work/err" &
    child=$!
    until [ -s "$work/out" ] || ! kill -0 "$child" 2>/dev/null || [ $SECONDS -ge $end ]; do
        sleep 0.05
    done
    address=$(cat "$work/out")
}

# viewed RANK: a signal to this rank ends the viewer; $rc: its end, 99 if it does not
viewed() {
    local rank end=$((SECONDS + 60))
    rank=$(process "$1")
    kill -TERM "${rank:-$child}"
    while kill -0 "$child" 2>/dev/null && [ $SECONDS -lt $end ]; do
        sleep 0.05
    done
    if kill -KILL "$child" 2>/dev/null; then
        wait "$child"
        rc=99
    else
        wait "$child"
        rc=$?
    fi
}

# shown FOLDER PROGRAM...: what a viewer of the first run sends for some requests; $rc: its end
shown() {
    local to=$1 child address path i=0
    shift
    mkdir "$to"
    viewing "$@" view "$work/one"
    for path in "picture?view=9&format=png" "picture?view=3&width=200&format=png&show=depth" \
        "picture?view=9&format=png&crop=-1,-1,-1,1,0.2,1&background=1,0,0" \
        "point?view=9&x=24&y=20" "picture?view=9&format=png&show=level" "photo?view=2&side=48"; do
        curl -sg --max-time 120 -o "$to/$((i++))" -H "X-Viewer: me" "${address%/}/$path"
    done
    curl -sg --max-time 120 -o "$to/small" -H "X-Viewer: me" "${address%/}/picture?view=9&ms=1"
    [ -s "$to/small" ] && rm "$to/small" # its size depends on the device's speed
    viewed 0
}

# Rank 0 serves a browser, the others render their part.
section_view() {
    local child address
    baseline
    shown "$work/shown-one" "$cln"
    check "one process shows a run" [ $rc = 0 ]
    check "it sends pictures" grep -q PNG "$work/shown-one/0"
    shown "$work/shown-two" "${mpi[@]}" -n 2 "$ranked"
    check "two ranks show a run, until a signal" [ $rc = 0 ]
    check "what they send is what one process sends" \
        diff -r "$work/shown-one" "$work/shown-two"
    check "rank 0 alone says that the viewer ends" \
        [ "$(grep -c 'viewer has ended' "$work/err")" = 1 ]
    viewing "${mpi[@]}" -n 2 "$ranked" view "$work/one"
    viewed 1
    check "a signal to rank 1 ends the viewer, too" [ $rc = 0 ]
    cp -r "$work/one" "$work/lost"
    sed -i 's|"path\(_from_run\)\?": ".*"|"path\1": "/gone/nowhere"|' "$work/lost/run.json"
    viewing "${mpi[@]}" -n 1 "$ranked" view "$work/one" : -n 1 "$ranked" view "$work/lost"
    viewed 0
    check "ranks that do not all find the scene show the run" [ $rc = 0 ]
    check "without photos, as rank 0 alone says" \
        [ "$(grep -c 'keeps, without photos: another rank' "$work/err")" = 1 ]
    rm "$work/lost/cameras.json"
    expect "ranks of which one has neither scene nor cameras" 3 "~the.scene.of.*is.not.there" \
        "${mpi[@]}" -n 1 "$ranked" render "$work/one" : -n 1 "$ranked" render "$work/lost"
    cp -r "$work/one" "$work/changed"
    run "$cln" train --resume "$work/changed" --skip-selftest --progress none --steps +1
    expect "viewers of different checkpoints are refused" 2 "~rank.1.on ~has.another.checkpoint" \
        "${mpi[@]}" -n 1 "$ranked" view "$work/one" : \
        -n 1 "$ranked" view "$work/changed"
    expect "other commands by several are refused" 2 "~info:.runs.in.one.process" \
        "${mpi[@]}" -n 2 "$ranked" info "$work/one"
}

# bench/scale computes the bytes that a training counted.
section_scale() {
    ${MAKE:-make} --no-print-directory MPI=1 build/mpi/bench-scale >"$work/out" 2>&1 ||
        bad "make MPI=1 build/mpi/bench-scale"
    baseline
    run "${mpi[@]}" -n 2 "$ranked" train "$work/scene" -o "$work/bytes" "${small[@]}" \
        --refresh-every 8 --steps 256 --start-level 2 --level-at "" --no-adaptive --cull-from 1
    expect "bytes of a step" 0 "" build/mpi/bench-scale bytes "$work/bytes"
    check "the bytes are the model's within 5 %" \
        awk '{ exit !($2 > 1000 && $3 > -0.05 && $3 < 0.05) }' \
        "$work/out"
    run "${mpi[@]}" -n 2 "$ranked" train "$work/scene" -o "$work/vox-bytes" "${voxels[@]}" \
        --steps 128 --log-every 8 --level-at "" --no-adaptive --cull-from 1 --start-level 2
    expect "bytes of a step of voxels" 0 "" build/mpi/bench-scale bytes "$work/vox-bytes"
    check "the bytes but those of common vertices are the model's within 5 %" \
        awk '{ exit !($2 > 1000 && $3 > -0.05 && $3 < 0.05 && $4 > 1000) }' "$work/out"
    expect "messages between two" 0 "" "${mpi[@]}" -n 2 build/mpi/bench-scale messages
    check "messages have latency and bandwidth" \
        awk '{ exit !($1 > 0 && $2 > 0 && NF == 2) }' "$work/out"
    run "$cln" train "$work/scene" -o "$work/vox-alone" "${voxels[@]}" --steps 64 --log-every 8 \
        --level-at "" --no-adaptive --cull-from 1 --start-level 2
    expect "a prediction for voxels wants their bytes" 3 "vertex_bytes voxels" \
        build/mpi/bench-scale predict 1e-5 1e9 2 "$work/vox-alone" "$work/vox-alone" \
        "$work/vox-alone" -- "$work/bytes"
    expect "a run of one process has no bytes" 3 "several" build/mpi/bench-scale bytes "$work/one"
}

# The sections that ran beside: their lines and counts.
section_beside() {
    local p f
    wait "$beside"
    beside=""
    p=$(sed -n 's/^\([0-9]*\) passed.*/\1/p' "$work/beside")
    f=$(sed -n 's/^[0-9]* passed, \([0-9]*\) failed.*/\1/p' "$work/beside")
    grep -vE '^[0-9]+ passed, ' "$work/beside"
    passed=$((passed + ${p:-0})) failed=$((failed + ${f:-0}))
    [ -n "$p" ] || bad "sections beside the others"
}

# Some wait or use one core most of the time: without arguments, they run beside the others.
waiting=(resume dies hangs differ)
others=(same walk photos parallel stretches step voxels checkpoints memory devices pictures view
    scale)
if [ $# = 0 ]; then
    baseline # its kernels are compiled once
    tests/cli/ranks.sh "${waiting[@]}" >"$work/beside" 2>&1 &
    beside=$!
    set -- "${others[@]}" beside
fi
run_sections "${others[*]} ${waiting[*]}" "$@"
