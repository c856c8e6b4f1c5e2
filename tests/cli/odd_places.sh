#!/bin/bash
# Scenes and places that are at the edge: one photo, no home, names that are long or not ASCII,
# folders that were moved or are files. On a tiny scene and short trainings.
#   tests/cli/odd_places.sh
#   BUILD=build/sanitize                   the programs to test
set -u
cd "$(dirname "$0")/../.." || exit 1

work=$(mktemp -d "${TMPDIR:-/tmp}/cln odd XXXXXX")
trap 'rm -rf "$work"' EXIT

. tests/support/checks.sh

small=("${grown[@]}" --skip-selftest --progress line)

section_edges() {
    local s=$work/one r="$work/one run" long
    "$make_scene" "$s" --format nerfstudio --size 32 --train 1 --test 0 >/dev/null
    sed -i 's/_filenames/_names/' "$s/transforms.json"
    expect "a scene of one photo, which is held out" 3 "--holdout" "$cln" info "$s"
    expect "one photo to train on" 0 "" \
        "$cln" train "$s" -o "$r" "${small[@]}" --steps 3 --holdout 0
    check "no test PSNR is printed" \
        grep -qE "^PSNR +[0-9.]+ train [(]mean of the last 3 steps[)]$" "$work/out"
    expect "cameras of one photo" 0 "" "$cln" export "$r" --cameras "$work/one.json"
    check "they are one" printed ": 1 camera, "
    expect "eval has nothing to compare with" 3 "--split" "$cln" eval "$r"
    expect "without HOME" 0 "" env -u HOME -u XDG_CONFIG_HOME "$cln" devices --no-test
    expect "the device in capitals" 0 "" "$cln" train "$s" -o "$work/cpu" "${small[@]}" \
        --steps 2 --holdout 0 -d CPU
    on_terminal 40 "$cln" train --resume "$r" --skip-selftest --steps +30
    check "40 columns: whole fields" eval 'tr "\r" "\n" <"$work/out" | sed "s/\x1b\[K//" |
        grep -aE "^train [0-9]" | grep -qE "^train [0-9]+% \| PSNR [0-9.]+ train$"'
    on_terminal 80 env TERM=dumb "$cln" render "$r" --split train --width 8
    check "TERM=dumb: no line is redrawn" eval '! grep -qF $'"'\033'"' "$work/out"'
    on_terminal 60 "$cln" check "$s" --probe 0 --holdout 0
    check "check fits into 60 columns" eval 'tr -d "\r" <"$work/out" | grep -q "^cameras" &&
        ! tr -d "\r" <"$work/out" | grep -qE "^.{61}"'
    expect "info of a run" 0 "" "$cln" info "$r"
    check "info of a run has memory in units" \
        grep -qE "^  device_peak +[0-9.]+ [KMG]iB$" "$work/out"
    check "its plan has memory in units" grep -qE "^  leaf weights +[0-9.]+ [KMG]iB$" "$work/out"
    check "its times are not estimates" \
        grep -qE "^  wall_seconds +[0-9]+:[0-9]+$" "$work/out"
    mv "$s" "$s.away"
    expect "--resume without the scene: how to name it" 3 "$s" \
        "$cln" train --resume "$r" --skip-selftest --steps +1
    check "the run is quoted" said "by train --resume '$r' SCENE"
    expect "eval without the scene: how to name it" 3 "~--scene.SCENE" "$cln" eval "$r"
    check "it has no word of training" not_said "train --resume"
    expect "the scene is named so" 0 "" "$cln" train --resume "$r" "$s.away" --skip-selftest \
        --progress none --steps +1
    mv "$s.away" "$s"
    cp -r "$r" "$work/half"
    : >"$work/half/run.json"
    expect "a run whose run.json is empty" 3 "run.json ~is.empty.*copy" "$cln" info "$work/half"
    rm "$work/half/run.json"
    expect "a run without run.json" 3 "~run.without.its.run.json ~copy.the.run.again" \
        "$cln" info "$work/half"
    long=$(printf 'n%.0s' {1..300})
    expect "an output name that is too long" 7 "~too.long.*300.*255.*shorter" \
        "$cln" train "$s" -o "$work/$long" "${small[@]}" --steps 3 --holdout 0
    check "no device was opened for it" not_said "device:"
    expect "a folder on the way that is" 7 "~too.long.*shorter" \
        "$cln" train "$s" -o "$work/$long/run" "${small[@]}" --steps 3 --holdout 0
    expect "in a path that is too long" 7 "~path.is.too.long" \
        "$cln" train "$s" -o "$work/$(printf 'nnn/%.0s' {1..1000})" "${small[@]}" --steps 3
    expect "render to it" 7 "~too.long.*shorter" "$cln" render "$r" --orbit 2 -o "$work/$long"
    expect "eval to it" 7 "~too.long.*shorter" "$cln" eval "$r" --split train -o "$work/$long"
    check "no device was opened for them" not_said "device:"
    # a name of 250 bytes is possible, but not while the file is written
    expect "export to a name that is nearly too long" 7 "~too.long.*shorter" \
        "$cln" export "$r" --octree "$work/${long:0:246}.ply"
    expect "a film with such a name" 7 "~too.long.*shorter" \
        "$cln" render "$r" --orbit 2 -o "$work/${long:0:246}.gif"
    cp -r "$s" "$work/named"
    mv "$work/named/images/frame_00001.png" "$work/named/images/${long:0:246}.png"
    sed -i "s/frame_00001/${long:0:246}/" "$work/named/transforms.json"
    expect "a photo with a long name" 0 "" "$cln" train "$work/named" -o "$work/named run" \
        "${small[@]}" --steps 3 --holdout 0
    expect "its render is saved" 0 "" "$cln" eval "$work/named run" --split train
    check "under a shorter name" eval \
        'find "$work/named run/eval" -name "*nnnn*.png" | grep -q .'
    cp -r "$s" "$work/umlaut"
    mv "$work/umlaut/images/frame_00001.png" "$work/umlaut/images/Bär.png"
    sed -i "s/frame_00001/Bär/" "$work/umlaut/transforms.json"
    expect "a name with an umlaut" 0 "" "$cln" eval "$r" --split train --scene "$work/umlaut" \
        -o "$work/umlaut eval"
    check "its figures stand below the others" awk '/r.png/ { a = length($0) }
        /^mean/ { b = length($0) } END { exit !(a == b + 1) }' "$work/out" # in bytes
    expect "output folder that is a file" 7 "folder" \
        "$cln" train "$s" -o "$s/transforms.json" --steps 1
}

# Limits of a process (ulimit), as batch systems set them.
section_limits() {
    local s=$work/limits few=3000000
    if nm "$cln" 2>/dev/null | grep -q __asan_init ||
        ! "$cln" devices --no-test | grep -q "PoCL"; then
        skip "limits of a process" "made for PoCL, without a sanitizer's addresses"
        return
    fi
    export POCL_MAX_PTHREAD_COUNT=2 # a thread reserves addresses
    "$make_scene" "$s" --format nerfstudio --size 32 --train 8 --test 2 >/dev/null
    expect "what a training needs, within limits" 0 "" \
        bash -c "ulimit -v $few; exec \"\$@\"" limit "$cln" info "$s" --json
    check "is told beside them" \
        [ "$(json training.host_memory_limit | cut -d. -f1)" -lt $((few * 1024)) ]
    check "of addresses less than all, as the program has reserved some" \
        [ "$(json training.host_memory_limit | cut -d. -f1)" -gt 100000000 ]
    expect "a training within them" 0 "" bash -c "ulimit -v $few; exec \"\$@\"" limit \
        "$cln" train "$s" -o "$work/limited" "${small[@]}" --steps 20
    check "has a plan that keeps to them" grep -qE \
        "host about [0-9]+ MiB of [12][.][0-9] GiB" "$work/err"
    mkdir "$work/brackets"
    (printf '{"frames": [], "x": [' && yes '[],' | head -n 9000000 && printf '[]]}') \
        >"$work/brackets/transforms.json"
    expect "a file of many small values" 5 "~transforms.json:.its.values.may.take.1.5.GiB" \
        bash -c 'ulimit -v 1400000; exec "$@"' limit "$cln" info "$work/brackets"
    rm -r "$work/brackets"
    expect "no file may be large enough for kernels" 7 "~no.file.may ~ulimit.-f" \
        bash -c 'ulimit -f 500; exec "$@"' limit "$cln" train "$s" -o "$work/small files" \
        "${small[@]}" --steps 20
    expect "nor for a checkpoint" 7 "~no.file.may.*first.checkpoint ~ulimit.-f" \
        bash -c 'ulimit -f 2000; exec "$@"' limit "$cln" train "$s" -o "$work/small files" \
        --skip-selftest --progress none --preset voxel --start-level 3 --steps 20
    check "no step was trained for it" [ ! -e "$work/small files/metrics.jsonl" ]
    unset POCL_MAX_PTHREAD_COUNT
}

# Names as they are written on Windows.
section_windows() {
    local s=$work/windows r="$work/windows run"
    "$make_scene" "$s" --format nerfstudio --size 32 --train 8 --test 2 >/dev/null
    sed -i 's/_filenames/_names/' "$s/transforms.json"
    cp "$s/transforms.json" "$work/plain.json"
    sed -i 's|"images/|".\\\\images\\\\|' "$s/transforms.json"
    printf '%s\r\n' '.\images\frame_00003.png' 'images\frame_00007.png' >"$s/list.txt"
    expect "a path of Windows, in WSL" 3 "~is.'/mnt/c/Users/J/x'" "$cln" info 'C:\Users\J\x'
    expect "backslashes in poses and in a list" 0 "~views:.8.train,.2.test" "$cln" train "$s" \
        -o "$r" "${small[@]}" --test-views "$s/list.txt" --steps 3
    expect "and in --views" 0 "" "$cln" eval "$r" --views 'images\frame_00007.png' --json
    check "the photo is found" [ "$(json images.0.name | tr '\\' / | sed 's/^[.]*[/]*//')" = \
        images/frame_00007.png ]
    sed 's|"images/|"images//|' "$work/plain.json" >"$s/transforms.json"
    expect "separators that stand twice" 0 "" "$cln" info "$s"
    check "no photo is without a pose for it" not_said "no pose"
    mkdir "$s/Masken Größe"
    # the folder composed, the file decomposed, both in another case
    cp "$s/images/frame_00001.png" "$s/Masken Größe/$(printf 'Gro\314\210\303\237e').png"
    sed 's|"file_path"|"mask_path": "masken größe/GRÖßE.png", "file_path"|' "$work/plain.json" \
        >"$s/transforms.json"
    expect "masks of another case and Unicode form" 0 "" "$cln" info "$s"
    check "are found" not_said "no mask"
    { printf '\357\273\277' && cat "$r/run.json"; } >"$work/marked.json"
    cp "$work/marked.json" "$r/run.json"
    expect "a byte order mark in JSON" 0 "" "$cln" info "$r"
    sed 's|"images/|"C:\\\\Users\\\\Ann\\\\images\\\\|' "$work/plain.json" >"$s/transforms.json"
    expect "photos on a drive" 0 "" "$cln" train "$s" -o "$work/drive" "${small[@]}" --steps 2
    check "pictures have their names alone" [ -s "$work/drive/eval/00000002-test/frame_00001.png" ]
    printf 'images/frame_00003.png\n' | iconv -f UTF-8 -t UTF-16 >"$s/list.txt"
    expect "a list in UTF-16" 3 "~list.txt:.is.UTF-16" "$cln" train "$s" -o "$work/none" \
        --steps 1 --test-views "$s/list.txt"
    iconv -f UTF-8 -t UTF-16LE "$work/plain.json" >"$work/wide.json"
    expect "JSON in UTF-16, without its mark" 3 "~wide.json:.is.UTF-16" "$cln" info \
        "$work/wide.json"
    touch "$s/cl-nascent.conf.txt"
    expect "an ending that an editor adds" 3 "~settings.are.not.read.from.*conf.txt" "$cln" train \
        "$s" -o "$work/none" --steps 1 --holdout 999 --test-views "$work/nowhere"
    expect "a drive of Windows to write to" 2 "~is.'/mnt/c/Users/J/run'" "$cln" train "$s" \
        -o 'C:\Users\J\run'
    expect "likewise of an export" 2 "~drive.of.Windows" "$cln" export "$r" --octree 'D:/a.ply'
    rm -r "$s/Masken Größe" "$s/cl-nascent.conf.txt"
    sed 's|"images/|"images\\|' "$work/plain.json" >"$s/transforms.json"
    expect "single backslashes in JSON" 3 \
        "~frame.*'images.frame_0.*single.backslashes ~write.each.twice" "$cln" info "$s"
    sed 's|"images/|"images\\I|' "$work/plain.json" >"$s/transforms.json"
    expect "and such that JSON does not know" 3 "~escape.*written.twice.in.JSON" "$cln" info "$s"
}

# Photos of two flights, whose files have the same names.
section_flights() {
    local s=$work/flights
    "$make_scene" "$s" --format colmap --size 32 --train 8 --test 2 >/dev/null
    mkdir "$work/photos"
    mv "$s"/images/* "$work/photos"
    mkdir "$s/images/101MEDIA" "$s/images/100MEDIA"
    cp "$work/photos"/* "$s/images/100MEDIA"
    cp "$work/photos"/* "$s/images/101MEDIA"
    expect "poses without the folders of their photos" 3 \
        "~several.folders ~100MEDIA.*101MEDIA ~write.their.folder" "$cln" info "$s"
    rm -r "$s/images/101MEDIA"
    expect "one of the folders alone" 0 "" "$cln" info "$s"
    mv "$s/images/100MEDIA"/* "$s/images"
    rmdir "$s/images/100MEDIA"
    find "$s" -name 'images.*' -exec sed -i 's/[.]png/.TIF/' {} +
    expect "names of photos that were converted since" 0 "" "$cln" info "$s" --json
    check "all are found" [ "$(json splits.train)" = 8 ]
    printf '# Bundle file v0.3\n8 100\n' >"$work/bundle.out"
    expect "Bundler's file" 3 "~Bundler.*Colmap" "$cln" info "$work/bundle.out"
    printf '# Cameras (8)\n# PhotoID, X, Y, Z, Omega, Phi, Kappa\n' >"$work/opk.txt"
    expect "Metashape's angles" 3 "~angles.of.Metashape.*Colmap" "$cln" info "$work/opk.txt"
}

# Photos in two splits, poses and masks with others' names.
section_twice() {
    local s=$work/twice r="$work/twice run" pose i
    "$make_scene" "$s" --format nerfstudio --size 32 --train 6 --val 2 --test 2 >/dev/null
    sed -i 's|"test_filenames": \[|&"images/frame_00008.png",|' "$s/transforms.json"
    expect "a scene with a photo in two splits" 0 "" "$cln" info "$s" --json
    check "it counts in both" eval '
        [ "$(json splits.train) $(json splits.val) $(json splits.test)" = "6 2 3" ]'
    run "$cln" train "$s" -o "$r" "${small[@]}" --steps 3
    expect "a switch with a word behind it" 0 "" "$cln" train --exposure auto "$s" \
        -o "$work/word run" "${small[@]}" --steps 3
    check "is that" [ "$("$query" config.exposure <"$work/word run/run.json")" = auto ]
    mkdir "$work/again"
    expect "its cameras" 0 "" "$cln" export "$r" --cameras "$work/again/transforms.json"
    check "each is written once" printed ": 10 cameras, "
    expect "as COLMAP's" 0 "" "$cln" export "$r" --cameras "$work/again/sparse"
    cp -r "$s/images" "$work/again"
    expect "they are a scene" 0 "" "$cln" info "$work/again" --format transforms --json
    check "with the same splits" eval '
        [ "$(json splits.train) $(json splits.val) $(json splits.test)" = "6 2 3" ]'
    expect "and so are COLMAP's" 0 "" "$cln" info "$work/again" --format colmap
    pose='"transform_matrix":[[1,0,0,0],[0,1,0,0],[0,0,1,4],[0,0,0,1]]'
    printf '{"w":8,"h":8,"fl_x":9,"frames":[%s,%s,%s]}' "{\"file_path\":\"x/a.png\",$pose}" \
        "{\"file_path\":\"x/a.png\",$pose}" "{\"file_path\":\"x/a-0001.png\",$pose}" \
        >"$work/poses.json"
    expect "poses that are called like others" 0 "~called.like" "$cln" render "$r" \
        --poses "$work/poses.json" -o "$work/posed"
    check "each has its picture" \
        [ "$(grep '"file_path"' "$work/posed/transforms.json" | sort -u | wc -l)" = 3 ]
    for ((i = 2; i < 10; i++)); do
        cp "$s/images/frame_0000$i.png" "$s/images/frame_0000${i}_mask.png"
    done
    "$make_scene" "$work/wide" --held 1 --format nerfstudio --size 32 --train 1 --test 0 >/dev/null
    cp "$work/wide/images/frame_00001.png" "$s/images/frame_00001_mask.png"
    expect "a mask of another shape, and none" 0 \
        "~1.mask.is.not.read ~8.of.10.photos.have.a.mask" "$cln" info "$s"
}

# What photo programs and servers do to photos after their poses were found.
section_edited() {
    local s=$work/edited i
    "$make_scene" "$s" --format nerfstudio --size 24 --train 12 --test 2 >/dev/null
    cp -r "$s" "$work/renamed"
    for i in "$work/renamed/images/"*; do
        mv "$i" "${i%/*}/2026 ${i##*/}"
    done
    expect "photos that were renamed" 3 "~renamed..*has.14.of.other.names.*names.back" \
        "$cln" info "$work/renamed"
    mkdir -p "$s/images/@eaDir/frame_00001.png"
    cp "$s/images/frame_00001.png" "$s/images/@eaDir/frame_00001.png/SYNOPHOTO_THUMB_M.png"
    expect "a server's small copies" 0 "" "$cln" info "$s"
    check "are no photos" not_said "THUMB"
    sed -i 's/"w": 24/"w": 32/' "$s/transforms.json"
    expect "photos that were cropped" 3 "~and.so.with.13.other.photos" "$cln" info "$s"
}

# A scene's folder that has another object by now, photos and poses that changed since.
section_reused() {
    local s=$work/current r="$work/vault/first run"
    mkdir -p "$work/vault"
    "$make_scene" "$s" --format colmap --size 32 --train 20 --test 4 >/dev/null
    run "$cln" train "$s" -o "$r" "${small[@]}" --steps 3
    cp -r "$s" "$work/vault/current"
    rm -r "$s"
    "$make_scene" "$s" --kind room --format colmap --size 32 --train 12 --test 4 >/dev/null
    for file in "$s"/images/*; do
        mv "$file" "$s/images/other_$(basename "$file")"
    done
    sed -i 's/frame_/other_frame_/' "$s/sparse/0/images.txt"
    cp -r "$r" "$work/first alone"
    expect "the run's own scene went with it" 0 "~another.scene.is.there ~vault/.*current" \
        "$cln" eval "$r" --no-save-images --json
    check "it is read" [ "$(json split)" = test ]
    expect "and trained on" 0 "~another.scene.is.there" "$cln" train --resume "$r" \
        --skip-selftest --progress none --steps +1
    expect "none of the run's photos is in the folder" 3 "~none.of.its.16.photos" \
        "$cln" train --resume "$work/first alone" --skip-selftest --progress none --steps +1
    rm -r "$s"
    cp -r "$work/vault/current" "$s"
    rm "$s/images/frame_00003.png"
    expect "a photo that is gone" 0 "~1.image.is.left.out.now ~1.photo.is.gone" "$cln" train \
        --resume "$work/first alone" --skip-selftest --progress none --steps +1
    expect "the run tells that its photos changed" 0 "" "$cln" info "$work/first alone"
    check "with both digests" printed "and other photos or poses: scene "
    rm "$s/images/frame_00004.png"
    cp "$work/first alone/run.json" "$work/record"
    expect "a run that is done keeps its record" 3 "~first.alone.was.trained.on ~--steps.+N" \
        "$cln" train --resume "$work/first alone" --skip-selftest --progress none
    check "to the byte" cmp "$work/record" "$work/first alone/run.json"
    cp "$work/vault/current/images/frame_00004.png" "$s/images"
    expect "unless none may be missing" 3 "frame_00003" "$cln" train --resume "$work/first alone" \
        --skip-selftest --progress none --steps +1 --missing fail
    cp "$s/sparse/0/images.txt" "$work/images.txt"
    awk '$NF == "frame_00007.png" { $6 += 1 } { print }' "$work/images.txt" \
        >"$s/sparse/0/images.txt"
    expect "one pose that moved is told" 0 \
        "~warning:.*1.of.the.23.photos.*has.another.pose.*frame_00007.png --settings-of" \
        "$cln" train --resume "$work/first alone" --skip-selftest --progress none --steps +1
    check "not the photos" not_said "masks or lenses"
    cp "$work/images.txt" "$s/sparse/0/images.txt"
    run "$cln" train "$s" -o "$work/corrected" "${small[@]}" --refine-poses --exposure --steps 3
    mv "$s/images/frame_00005.png" "$s/images/frame_00005b.png"
    sed -i 's/frame_00005.png/frame_00005b.png/' "$s/sparse/0/images.txt"
    expect "as many corrected poses, but of other photos" 8 "~corrections.of.*has.others" \
        "$cln" train --resume "$work/corrected" --skip-selftest --progress none --steps +1
}

# Masks in another format or size than their photos; names in another form.
section_forms() {
    local s=$work/forms i
    "$make_scene" "$s" --format colmap --size 32 --train 10 --test 2 >/dev/null
    "$make_scene" "$work/half size" --format nerfstudio --size 16 --train 10 --test 2 \
        --masks >/dev/null
    cp -r "$work/half size/masks" "$s"
    expect "masks of half the size" 0 "" "$cln" info "$s" --json
    check "they count" [ "$(json masks.views)" = 12 ]
    for i in alpha ignore; do
        expect "and are trained with, as $i" 0 "" "$cln" train "$s" -o "$work/$i run" \
            "${small[@]}" --masks $i --steps 3
    done
    for i in 1 2 3; do
        mv "$s/masks/frame_0000$i.png" "$s/masks/frame_0000$i.tif"
    done
    expect "masks that are TIFF" 0 "~3.masks.are.not.read.*frame_00001.tif.*PNG" "$cln" info "$s"
    rm -r "$s/masks"
    mv "$s/images/frame_00001.png" "$s/images/u"$'\xcc\x88'" #1.png"
    mv "$s/images/frame_00002.png" "$s/images/b.png"
    : >"$s/images/b.tif"
    sed -i 's/frame_00002.png/b.tif/; s/frame_00001.png/u'$'\xcc\x88'' #1.png/' \
        "$s/sparse/0/images.txt"
    printf '# some\n\xc3\xbc #1.png\nframe_00004.png # a remark\n' >"$s/list.txt"
    expect "names with a # and in another form" 0 "~views:.10.train,.2.test" "$cln" train "$s" \
        -o "$work/forms run" "${small[@]}" --test-views "$s/list.txt" --steps 3
    expect "in --views, too" 0 "" "$cln" eval "$work/forms run" --views $'\xc3\xbc #1.png' \
        --no-save-images
    check "a photo beside its TIFF is read" eval '! grep -q "left out" "$work/err"'
}

# Cameras of engines and of Blender that would become others.
section_engines() {
    local s=$work/engines r="$work/engines run" pose
    "$make_scene" "$s" --size 32 --train 8 --test 2 >/dev/null
    run "$cln" train "$s" -o "$r" "${small[@]}" --steps 3
    pose='1,0,0,0, 0,1,0,0, 0,0,1,0, 0,0,4,1'
    printf '{"render_height":8,"render_width":8,"camera_path":[{"fov":50,%s:[%s]}]}' \
        '"camera_to_world"' "$pose" >"$work/columns.json"
    expect "a matrix by columns" 3 "~last.row ~column.by.column" "$cln" render "$r" \
        --poses "$work/columns.json" -o "$work/columns"
    sed 's/"camera_angle_x"/"shift_x":0.1,&/' "$s/transforms_test.json" >"$work/shift.json"
    expect "a key of poses that is not used" 0 "~not.used:.*shift_x" "$cln" render "$r" \
        --poses "$work/shift.json" -o "$work/shift"
    sed 's/"camera_angle_x"/"camera_type":"ORTHO",&/' "$s/transforms_test.json" >"$work/flat.json"
    expect "an orthographic camera" 3 "~orthographic.cameras.are.not.traced" "$cln" render "$r" \
        --poses "$work/flat.json" -o "$work/flat"
    "$make_scene" "$work/upright" --format nerfstudio --held 1 --size 32 --train 4 --test 0 \
        >/dev/null
    cp "$work/upright/images/frame_00001.png" "$s/train/r_001.png"
    expect "photos of several shapes under one angle" 0 "~several.shapes ~r_001.*32.x.24" \
        "$cln" info "$s"
}

# Photos that are divided, with cameras that do not say their size: a pose has the same picture in
# the scene's file and in one elsewhere.
section_divided() {
    local s=$work/divided r="$work/divided run" i
    "$make_scene" "$s" --format nerfstudio --size 33 --train 8 --test 2 >/dev/null
    sed -i '/^ "[wh]": /d' "$s/transforms.json"
    sed 's,images/frame,new/pose,' "$s/transforms.json" >"$work/new.json"
    run "$cln" train "$s" -o "$r" "${small[@]}" --steps 3 --downscale 2
    expect "eval of divided photos" 0 "" "$cln" eval "$r" --no-save-images
    check "tells their size and the one it measured at" grep -q \
        "^photos: of 33 x 33 pixels, measured at 16 x 16 (--downscale 2;" "$work/out"
    run "$cln" eval "$r" --no-save-images --json
    check "so does its document" [ "$(json images.0.downscale) $(json images.0.width)" = "2 16" ]
    expect "poses beside their photos" 0 "" "$cln" render "$r" --poses "$s/transforms.json" \
        --frames 1 -o "$work/beside"
    expect "new poses" 0 "" "$cln" render "$r" --poses "$work/new.json" --frames 1 -o "$work/new"
    check "have the photos' size" \
        [ "$("$query" frames.0.w <"$work/new/transforms.json")" = 33 ]
    check "and show the same" cmp "$work/beside/images_frame_00002.png" \
        "$work/new/new_pose_00002.png"
    mv "$s" "$s.away"
    expect "without the scene" 0 "" "$cln" render "$r" --poses "$work/new.json" --frames 1 \
        -o "$work/alone"
    check "they do so, too" cmp "$work/alone/new_pose_00002.png" "$work/new/new_pose_00002.png"
    rm "$r/cameras.json"
    expect "of an older run" 0 "" "$cln" render "$r" --poses "$work/new.json" --frames 1 \
        -o "$work/older"
    check "all that was trained on" \
        [ "$("$query" frames.0.w <"$work/older/transforms.json")" = 32 ]
    mv "$s.away" "$s"
    "$make_scene" "$work/smaller" --format nerfstudio --size 27 --train 8 --test 2 >/dev/null
    cp "$work/smaller/images/frame_00002.png" "$s/images/frame_00002.png"
    run "$cln" train "$s" -o "$r.2" "${small[@]}" --steps 3
    expect "eval of whole ones" 0 "" "$cln" eval "$r.2" --no-save-images
    check "has no word of sizes" eval '! grep -q "^photos:" "$work/out"'
    expect "photos of several sizes" 0 "~new.json: ~several.sizes ~33.x.33.is.taken ~w.and.h" \
        "$cln" render "$r.2" --poses "$work/new.json" --frames 1 -o "$work/several"
}

run_sections "edges limits windows flights twice edited reused forms engines divided" "$@"
