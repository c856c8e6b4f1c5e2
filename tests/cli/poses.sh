#!/bin/bash
# `cl-nascent poses`: photos and videos without poses, by a stand-in for COLMAP's program
# (tests/support/colmap) and, where it is installed, the real ffmpeg. On tiny generated photos,
# without a device.
#   tests/cli/poses.sh                 all of it
#   BUILD=build/sanitize               the programs to test
set -u
cd "$(dirname "$0")/../.." || exit 1

work=$(mktemp -d "${TMPDIR:-/tmp}/cln poses XXXXXX")
trap 'rm -rf "$work"' EXIT
. tests/support/checks.sh

section_photos() {
    local path how
    "$make_scene" "$work/photos" --size 24 --train 24 --test 3 >/dev/null || bad "make-scene"
    mkdir "$work/bin" "$work/none"
    cp tests/support/colmap "$work/bin/colmap"
    path=$work/bin:$PATH
    expect "poses without COLMAP: what to install" 1 "apt colmap" \
        env PATH="$work/none" "$cln" poses "$work/photos/train" -o "$work/posed"
    check "poses without COLMAP write nothing" [ ! -e "$work/posed" ]
    mkdir -p "$work/home/images" "$work/own"
    cp "$work/photos/train/r_000.png" "$work/home/images/holiday.png"
    touch "$work/own/letter.txt"
    expect "a folder that has other things" 7 "~own:.*letter.txt ~empty.folder" \
        env PATH="$path" "$cln" poses "$work/photos/train" -o "$work/own"
    for how in 1 2; do
        expect "a folder with images of another kind" 7 \
            "~holiday.png:.is.none.of.the.photos ~empty.folder" \
            env PATH="$path" "$cln" poses "$work/photos/train" -o "$work/home" --progress none
    done
    check "it is what it was" \
        [ -z "$(find "$work/home" "$work/own" -name "r_0*" -o -name "colmap*")" ]
    check "the way out is not to remove one's photo" eval '! said "remove"'
    cp -r "$work/photos/train" "$work/home/mine"
    rm -r "$work/home/images"
    touch "$work/home/colmap.db"
    expect "a database of another program" 7 "~home:.*colmap.db ~replaced" \
        env PATH="$path" "$cln" poses "$work/home/mine" -o "$work/home" --progress none
    rm "$work/home/colmap.db"
    expect "photos in a folder of the scene, which may have other things" 0 "" \
        env PATH="$path" "$cln" poses "$work/home/mine" -o "$work/home" --progress none
    rm -r "${work:?}/home" "$work/own"
    mkdir "$work/no photos"
    touch "$work/text.zip"
    expect "no photos: this is said before COLMAP is missed" 3 "~0.PNG.or.JPEG.photos.*three" \
        env PATH="$work/none" "$cln" poses "$work/no photos" -o "$work/posed"
    check "poses of no photos write nothing" [ ! -e "$work/posed" ]
    mkdir -p "$work/a run"
    echo '{"schema": "cl-nascent.run/1"}' >"$work/a run/run.json"
    expect "poses of a run" 3 "~holds.a.run.*no.photos" \
        env PATH="$path" "$cln" poses "$work/a run" -o "$work/posed"
    expect "one photo" 3 "~r_001.png:.*give.the.folder" "$cln" poses \
        "$work/photos/train/r_001.png" -o "$work/posed"
    expect "photos instead of their folder" 2 "~r_001.png.*give.the.folder" "$cln" poses \
        "$work/photos/train/r_000.png" "$work/photos/train/r_001.png" -o "$work/posed"
    expect "an archive" 3 "~text.zip:.*unpack" "$cln" poses "$work/text.zip" -o "$work/posed"
    touch "$work/no photos/"{a.HEIC,b.tif,c.tif}
    expect "photos without a command" 2 \
        "~command.comes.first ~cl-nascent.poses.*photos/train.*-o.SCENE" "$cln" "$work/photos/train"
    expect "poses without photos" 2 "~PHOTOS.is.missing ~cl-nascent.poses.PHOTOS.-o.SCENE" \
        "$cln" poses
    expect "photos in formats that are not read" 3 \
        "~0.PNG.or.JPEG ~3.in.formats.that.are.not.read a.HEIC ~convert.*three" \
        env PATH="$work/none" "$cln" poses "$work/no photos" -o "$work/posed"
    mkdir "$work/a phone"
    touch "$work/a phone/"{IMG_2.MOV,IMG_10.mov}
    expect "a folder with videos: the command that takes one" 3 \
        "~0.PNG.or.JPEG.photos,.and.2.videos" env PATH="$work/none" "$cln" poses \
        "$work/a phone" -o "$work/posed"
    check "it can be typed" said "cl-nascent poses '$work/a phone/IMG_10.mov' -o SCENE"
    cp -r "$work/photos/train" "$work/mixed"
    touch "$work/mixed/"{a.HEIC,b.webp,walk.mov}
    expect "a few in such formats, and a video, among others are told, too" 1 \
        "~mixed:.2.photos.in.formats.*left.out a.HEIC ~convert colmap ~1.video.*walk.mov'..is.not" \
        env PATH="$work/none" "$cln" poses "$work/mixed" -o "$work/posed"
    for how in r_004 r_007; do
        truncate -s 100 "$work/mixed/$how.png"
    done
    expect "photos that are cut off, before COLMAP works" 3 \
        "~mixed:.2.of.24.photos.cannot.be.read.*move.them.*r_004.png:.truncated" \
        env PATH="$work/none" "$cln" poses "$work/mixed" -o "$work/posed"
    check "they write nothing" [ ! -e "$work/posed" ]
    expect "photos that have poses" 1 "~is.a.scene.with.poses.already colmap" \
        env PATH="$work/none" "$cln" poses "$work/photos" -o "$work/posed"
    expect "poses into a scene that has them, which would be read on" 7 \
        "~photos:.it.has.poses.already ~transforms.reader.takes.it ~give.another.folder" \
        env PATH="$path" "$cln" poses "$work/photos/train" -o "$work/photos" --progress none
    check "nothing is written there" [ ! -e "$work/photos/images" ]
    mkdir "$work/llff"
    cp -r "$work/photos/train" "$work/llff/images"
    touch "$work/llff/poses_bounds.npy"
    expect "LLFF's, too" 7 "~llff:.it.has.poses.already ~poses_bounds.npy" env PATH="$path" \
        "$cln" poses "$work/llff/images" -o "$work/llff" --progress none
    check "COLMAP did not begin" [ ! -e "$work/llff/colmap.log" ]
    expect "a scene within the folder of photos" 2 "~beside.*photos/train$" \
        env PATH="$work/none" "$cln" poses "$work/photos/train" -o "$work/photos/train/a/b"
    expect "that folder itself" 2 "~beside" \
        env PATH="$work/none" "$cln" poses "$work/photos/train" -o "$work/photos/train/"
    touch "$work/no folder"
    expect "a scene that is a file, before COLMAP is missed" 7 "~no.folder: ~folder" \
        env PATH="$work/none" "$cln" poses "$work/photos/train" -o "$work/no folder"
    expect "no folder to write" 2 "-o" "$cln" poses "$work/photos/train"
    expect "poses of nothing" 3 "not there folder" "$cln" poses "$work/nowhere" -o "$work/x"
    expect "poses: who has none, and what EXIF tells" 0 \
        "~1.of.24.images.has.no.pose.and.is.left.out:.*r_023 ~of.23.photos" \
        env PATH="$path" "$cln" poses "$work/photos/train" -o "$work/posed" --progress none
    check "it is said once" [ "$(grep -c "no pose" "$work/err")" = 1 ]
    check "poses count the registered photos" grep -q "registered  23 of 24" "$work/out"
    check "it ends with the next command" grep -q "cl-nascent train .*posed'* -o" "$work/out"
    check "EXIF's focal length and COLMAP's" eval 'said "of 23 photos: 30 pixels" &&
        said "COLMAP'"'"'s focal length: 30 pixels, of photos 24 pixels wide"'
    check "it matches in small blocks, after each of which it says how far it is" \
        grep -q "ExhaustiveMatching.block_size 4$" "$work/posed/colmap.log"
    check "all are matched with all" grep -q "colmap exhaustive_matcher" "$work/posed/colmap.log"
    check "the scene that poses wrote is read" \
        [ "$("$cln" info "$work/posed" --json | "$query" views)" = 23 ]
    expect "a second time: nothing is replaced" 7 "posed sparse -o" \
        env PATH="$path" "$cln" poses "$work/photos/train" -o "$work/posed"

    # photos of two sizes: a camera for each, which a run of COLMAP's program each makes
    "$make_scene" "$work/large photos" --size 32 --train 4 --test 1 >/dev/null || bad "make-scene"
    mkdir "$work/sizes"
    cp "$work/photos/train"/r_00[0-4].png "$work/sizes"
    for i in 0 1 2 3; do
        cp "$work/large photos/train/r_00$i.png" "$work/sizes/a large one $i.png"
    done
    expect "photos of two sizes: a camera for each size" 0 \
        "~9.photos,.of.several.sizes:.2.cameras" \
        env PATH="$path" "$cln" poses "$work/sizes" -o "$work/two sizes" --progress none
    check "each photo comes once" eval '[ "$(sort "$work/two sizes/colmap.db" |
        uniq | wc -l)" = 9 ] && [ "$(wc -l <"$work/two sizes/colmap.db")" = 9 ]'
    check "first those of one size" \
        [ "$(head -n 4 "$work/two sizes/colmap.db" | grep -c "a large one")" = 4 ]
    check "each run makes one camera, and its list is gone" eval '[ "$(grep -c \
        "single_camera 1.*image_list_path" "$work/two sizes/colmap.log")" = 2 ] &&
        [ ! -e "$work/two sizes/colmap.photos" ]'
    ln -s "r_001.png" "$work/sizes/ blank.png"
    expect "a name that no list can have: a camera for each photo" 0 \
        "~several.sizes:.a.camera.for.each.photo" \
        env PATH="$path" "$cln" poses "$work/sizes" -o "$work/each" --progress none

    # EXIF data of a PNG: the lens's own focal length in tenths of mm, and that on 35 mm film
    exif() { # exif FROM TO TENTHS FILM
        perl -e 'local $/; my $png = <STDIN>;
            my $tiff = pack("A2 v V  v v v V V V  v  v v V V  v v V V  V  V V", "II", 42, 8,
                1, 0x8769, 4, 1, 26, 0,  2,  0x920A, 5, 1, 56,  0xA405, 3, 1, $ARGV[1],  0,
                $ARGV[0], 10);
            print substr($png, 0, 33), pack("N", length $tiff), "eXIf", $tiff, "\0" x 4,
                substr($png, 33);' "$3" "$4" <"$1" >"$2"
    }
    mkdir "$work/lenses"
    for i in 0 1 2 3 4; do
        # the third one's length on film was lost, the last two were taken with another lens
        exif "$work/photos/train/r_00$i.png" "$work/lenses/r_00$i.png" $((i < 3 ? 43 : 86)) \
            $((i == 2 ? 0 : i < 3 ? 26 : 52))
    done
    expect "photos of two focal lengths: a camera for each" 0 \
        "~5.photos,.of.several.focal.lengths.by.EXIF,.or.none:.2.cameras" \
        env PATH="$path" "$cln" poses "$work/lenses" -o "$work/two lenses" --progress none
    check "whose photos are those of the lens" \
        [ "$(tr '\n' ' ' <"$work/two lenses/colmap.db")" = "$(echo r_00{0..4}.png) " ]

    # a selection of photos, as links beside each other
    mkdir "$work/links"
    for i in 0 1 2 3; do ln -s "../photos/train/r_00$i.png" "$work/links"; done
    expect "links to photos" 0 "~4.photos" env PATH="$path" "$cln" poses "$work/links" \
        -o "$work/linked" --progress none
    check "the photos are linked, not their links" eval '[ ! -L "$work/linked/images/r_003.png" ] &&
        cmp -s "$work/linked/images/r_003.png" "$work/photos/train/r_003.png"'
    mv "$work/links" "$work/taken from a film.mp4"
    expect "a folder that is called like a video" 0 "~4.photos" env PATH="$path" "$cln" poses \
        "$work/taken from a film.mp4" -o "$work/of a film" --progress none

    expect "a fisheye's lens, in small letters" 0 "~lens:.OPENCV_FISHEYE" env PATH="$path" "$cln" \
        poses "$work/photos/train" -o "$work/fisheye" --lens opencv_fisheye --progress none
    check "is the cameras', and begins with a fisheye's focal length" grep -q -- "camera_model \
OPENCV_FISHEYE .*default_focal_length_factor 0\.4 " "$work/fisheye/colmap.log"
    expect "undistorted photos" 0 "" env PATH="$path" "$cln" poses "$work/photos/train" \
        -o "$work/pinhole" --lens PINHOLE --progress none
    check "begin with COLMAP's own" eval '! grep -q factor "$work/pinhole/colmap.log" &&
        grep -q "camera_model PINHOLE" "$work/pinhole/colmap.log"'
    expect "a lens that nobody knows, before COLMAP works" 2 \
        "~--lens.FISH:.*auto,.SIMPLE_PINHOLE,.*OPENCV_FISHEYE,.*EQUIRECTANGULAR" \
        "$cln" poses "$work/photos/train" -o "$work/no lens" --lens FISH
    check "it writes nothing" [ ! -e "$work/no lens" ]
    expect "one that this COLMAP does not know" 1 "~--lens.EUCM:.the.COLMAP.*newer colmap.log" \
        env PATH="$path" "$cln" poses "$work/photos/train" -o "$work/no lens" --lens EUCM \
        --progress none
    mkdir "$work/panoramas"
    for i in 1 2 3; do # 32 x 16
        base64 -d >"$work/panoramas/$i.png" <<<"iVBORw0KGgoAAAANSUhEUgAAACAAAAAQCAAAAABSayKFAAAAE\
0lEQVR42mNsYMAPmBhGFYwgBQAqnwCgtXfp8QAAAABJRU5ErkJggg=="
    done
    expect "panoramas, which COLMAP has no poses for" 3 "~3.of.3.photos.are.2.:.1 OpenSfM --lens" \
        env PATH="$path" "$cln" poses "$work/panoramas" -o "$work/of panoramas"
    check "it is not begun" eval '! grep -q feature_extractor "$work/of panoramas/colmap.log"'
    run env STAND_IN=newer PATH="$path" "$cln" poses "$work/panoramas" -o "$work/of spheres" \
        --progress none
    check "COLMAP 4.1 has a lens for them" grep -q "camera_model EQUIRECTANGULAR" \
        "$work/of spheres/colmap.log"
    check "it is said once, and nothing of focal lengths" eval \
        '[ "$(grep -c EQUIRECTANGULAR "$work/err")" = 1 ] && ! said "focal length"'
    expect "photos that are as wide go on" 3 "~lens:.SIMPLE_RADIAL matching" env PATH="$path" \
        "$cln" poses "$work/panoramas" -o "$work/of wide ones" --lens SIMPLE_RADIAL --progress none
    cp "$work/photos/train/"r_00{1,2,3}.png "$work/panoramas"
    expect "beside others" 3 "~3.of.6.photos.are.2.:.1" env PATH="$path" "$cln" poses \
        "$work/panoramas" -o "$work/of some" --progress none
    expect "which a newer COLMAP takes, with a lens of their own (the stand-in has one for all)" 3 \
        "~lens:.EQUIRECTANGULAR.of.3.photos ~2.cameras" env STAND_IN=newer PATH="$path" "$cln" \
        poses "$work/panoramas" -o "$work/of both" --progress none
    for how in EQUIRECTANGULAR SIMPLE_RADIAL; do
        check "of two cameras: $how" grep -q "camera_model $how" "$work/of both/colmap.log"
    done
    rm "$work/panoramas/3.png"
    expect "two of 2 : 1 among five may be ordinary ones" 3 "~2.cameras ~matching" env \
        PATH="$path" "$cln" poses "$work/panoramas" -o "$work/of few" --progress none
    for i in 1 2 5; do # the same, and behind its header XMP data that say what it is
        { head -c 33 "$work/panoramas/1.png" &&
            printf '\0\0\0\74iTXtXML:com.adobe.xmp\0\0\0\0\0%s%s' \
                GPano:ProjectionType=\"equirectangular\" XXXX
            tail -c +34 "$work/panoramas/1.png"; } >"$work/x"
        mv "$work/x" "$work/panoramas/told$i.png"
    done
    expect "ones that say what they are count" 3 "~5.of.8.photos" env PATH="$path" "$cln" \
        poses "$work/panoramas" -o "$work/of told ones" --progress none
    check "as they look alone, if not all say it" said "~5.of.8.photos.are.2.:.1"
    mkdir "$work/told"
    cp "$work/panoramas/"told[12].png "$work/photos/train/"r_00[1-3].png "$work/told"
    expect "two that say so among five are some" 3 "~2.of.5.photos.are.*XMP.data,.of.which" env \
        PATH="$path" "$cln" poses "$work/told" -o "$work/of two told" --progress none
    cp "$work/photos/train/r_000.png" "$work/told/ blank.png"
    expect "beside photos of which no list can be made" 3 \
        "~2.of.6.photos.are.*of.many.sizes:.find.*each.kind.in.a.folder" env STAND_IN=newer \
        PATH="$path" "$cln" poses "$work/told" -o "$work/of two told" --progress none
    { head -c 33 "$work/panoramas/1.png" &&
        printf '\0\0\0\204iTXtXML:com.adobe.xmp\0\0\0\0\0%s %s %s%s' \
            GPano:ProjectionType=\"equirectangular\" GPano:FullPanoHeightPixels=\"32\" \
            GPano:CroppedAreaImageHeightPixels=\"16\" XXXX
        tail -c +34 "$work/panoramas/1.png"; } >"$work/told/cut.png"
    expect "panoramas of which a part is cut off, beside others" 3 \
        "~1.of.7.photos.*cut.png.*is.cut.off:.fill.them.up" env STAND_IN=newer \
        PATH="$path" "$cln" poses "$work/told" -o "$work/of two told" --progress none
    mkdir "$work/circles"
    for i in 1 2 3; do # 32 x 16, of two circles
        base64 -d >"$work/circles/$i.png" <<<"iVBORw0KGgoAAAANSUhEUgAAACAAAAAQCAAAAABSayKFAA\
AAMUlEQVR42mNgAIH/YMAAB2j8/3BA\
iA8RwccHiaDzCSr4TwAMDQWUhwPhoCYcWfijGwBuFZ5wL2FvxwAAAABJRU5ErkJggg=="
    done
    expect "two circles side by side, before they are put together" 3 \
        "~circles:.'1.png'.has.two.circles.*SIMPLE_RADIAL" env STAND_IN=newer PATH="$path" \
        "$cln" poses "$work/circles" -o "$work/of circles" --progress none
    check "COLMAP is not begun" \
        eval '! grep -q "feature_extractor.*image_path" "$work/of circles/colmap.log"'
    mkdir "$work/cut panoramas"
    for i in 1 2 3; do # square ones that say it
        { head -c 33 "$work/photos/train/r_00$i.png" &&
            head -c 105 "$work/panoramas/told1.png" | tail -c +34 &&
            tail -c +34 "$work/photos/train/r_00$i.png"; } >"$work/cut panoramas/$i.png"
    done
    expect "panoramas of which a part is cut off, of that lens, too" 3 \
        "~3.of.3.photos.*part.is.cut.off" env STAND_IN=newer PATH="$path" "$cln" poses \
        "$work/cut panoramas" -o "$work/of a part" --lens EQUIRECTANGULAR --progress none
    expect "of another lens they are ordinary photos" 0 "" env PATH="$path" "$cln" poses \
        "$work/cut panoramas" -o "$work/of a lens" --lens SIMPLE_RADIAL --progress none
    : >"$work/x.insv"
    expect "a video of two fisheyes" 3 "~insv:.*put.together" env PATH="$path" "$cln" poses \
        "$work/x.insv" -o "$work/of x"
    expect "photos that COLMAP cannot read" 3 "~24.of.24.photos.*r_000.png ~mogrify.-path" \
        env STAND_IN=deep PATH="$path" "$cln" poses "$work/photos/train" -o "$work/of deep ones"
    cp -r "$work/photos/train" "$work/photos/some"
    cp "$work/photos/some/r_003.png" "$work/photos/some/deep.png"
    expect "one of them" 0 "~1.of.25.photos..deep.png.,.*no.pose" env PATH="$path" \
        "$cln" poses "$work/photos/some" -o "$work/of a deep one" --progress none
    rm -r "$work/photos/some"
    mkdir "$work/photos/many"
    for ((i = 0; i < 201; i++)); do
        cp "$work/photos/train/r_000.png" "$work/photos/many/$(tr 0-9 a-j <<<"$i")x.png"
    done
    expect "many photos without an order" 0 "~201.photos.*20100.pairs.*--match.next" \
        env PATH="$path" "$cln" poses "$work/photos/many" -o "$work/of many" --progress none
    expect "many photos, each with the next" 0 "" env PATH="$path" "$cln" poses \
        "$work/photos/many" -o "$work/of many 2" --match next --progress none
    check "no pairs are told" not_said "20100"
    rm -r "$work/photos/many"
    expect "matched as asked" 0 "~each.photo.with.the.next" env PATH="$path" "$cln" poses \
        "$work/photos/train" -o "$work/posed next" --match next --progress none
    check "no reason is given for what was asked for" eval '! said "as there are many"'
    expect "how far it is" 0 "~registered.photos.23/24" \
        env PATH="$path" "$cln" poses "$work/photos/train" -o "$work/posed 2" --progress line
    for how in all next; do
        expect "COLMAP 3.13: other names of options, other lines; matched: $how" 0 \
            "~registered.photos.23/24 ~EXIF.*of.23.photos" env PATH="$path" STAND_IN=newer \
            "$cln" poses "$work/photos/train" -o "$work/newer $how" --match $how --progress line
        check "its options" eval 'grep -q -- "--FeatureExtraction.use_gpu 0" \
            "$work/newer $how/colmap.log" && grep -q -- "--FeatureMatching.use_gpu 0" \
            "$work/newer $how/colmap.log"'
    done

    expect "two parts: the larger one" 0 "~2.groups" env PATH="$path" STAND_IN=parts "$cln" \
        poses "$work/photos/train" -o "$work/parts" --progress none --json
    check "that there are parts is said on the way" said "one start led to 23 of 24 photos"
    check "poses of two parts: the larger one's photos" [ "$(json registered)" = 21 ]
    check "how many photos each has is told" said "of 21, 2 photos"
    expect "a beginning that was given up is no part" 0 "~registered.photos.23/24" env \
        PATH="$path" STAND_IN=begun "$cln" poses "$work/photos/train" -o "$work/begun anew" \
        --progress line
    check "nor is it kept" eval '[ ! -e "$work/begun anew/sparse/1" ] && ! said groups'
    expect "a model that cannot be read counts, one that was dropped is not pointed to" 0 \
        "~2.groups.of.21,.2.photos ~each.group.*sparse/2$" env PATH="$path" STAND_IN=three \
        "$cln" poses "$work/photos/train" -o "$work/three" --progress none
    expect "a smaller model beside it is no fault" 0 "" "$cln" info "$work/parts"
    check "but it is told" said "1 other model beside it is not read"
    mv "$work/parts/sparse/0" "$work/parts/aside"
    mv "$work/parts/sparse/1" "$work/parts/sparse/0"
    mv "$work/parts/aside" "$work/parts/sparse/1"
    expect "a larger one is told, with its folder" 0 \
        "~which.has.2.images ~parts/sparse/1.has.21:.give.that.folder" "$cln" info "$work/parts"
    mv "$work/parts/sparse/0" "$work/parts/aside"
    mv "$work/parts/sparse/1" "$work/parts/sparse/0"
    mv "$work/parts/aside" "$work/parts/sparse/1"
    expect "a model of more than 1 GiB is counted" 0 "~2.groups" env PATH="$path" STAND_IN=large \
        "$cln" poses "$work/photos/train" -o "$work/large" --progress none --json
    rm -r "$work/large"
    expect "no poses: what to do, and where it says why" 1 \
        "colmap.log ~too.little.in.common ~--lens.OPENCV_FISHEYE" \
        env PATH="$path" STAND_IN=nothing "$cln" poses "$work/photos/train" -o "$work/hopeless"
    mkdir "$work/many" "$work/two"
    for i in $(seq 1000 1121); do
        ln "$work/photos/train/r_000.png" "$work/many/IMG_$i.png"
    done
    expect "8 of 24 photos are better than none" 0 "~16.of.24.images.have.no.pose" env \
        PATH="$path" STAND_IN=eight "$cln" poses "$work/photos/train" -o "$work/eight" \
        --progress none --json
    check "they are registered" [ "$(json registered)" = 8 ]
    check "but few: what to do, and where it says why" said \
        "~poses.of.8.of.24.photos.alone.*Take.more.*fisheye.*eight/colmap.log"
    run "$cln" check "$work/eight" --probe 0
    check "check takes it for a fault" eval 'tr "\n" " " <"$work/out" | tr -s " " |
        grep -q "FAULT no pose: 16 of 24 photos have no pose"'
    mkdir "$work/sixteen"
    cp "$work/photos/train"/r_00?.png "$work/photos/train"/r_01[0-5].png "$work/sixteen"
    expect "half of them" 0 "~8.of.16.photos.alone" env PATH="$path" STAND_IN=eight "$cln" poses \
        "$work/sixteen" -o "$work/half" --progress none
    run "$cln" check "$work/half" --probe 0
    check "is as bad" grep -q "no pose: 8 of 16 photos" "$work/out"
    run "$cln" check "$work/posed" --probe 0
    check "but not of one of them" eval '! grep -q "no pose:" "$work/out"'
    expect "of many photos 8 are a bad beginning, and it is said that there were so many" 1 \
        "~at.most.8.of.122.hung.together" env PATH="$path" STAND_IN=eight "$cln" poses \
        "$work/many" -o "$work/eight of many" --match next --progress none
    for how in full killed; do
        expect "no room on the disk is not said to be bad photos: $how" 7 \
            "~hopeless:.no.room.*disk ~another.disk" env PATH="$path" STAND_IN=$how "$cln" poses \
            "$work/photos/train" -o "$work/hopeless" --progress none
    done
    expect "it can be tried again" 0 "" env PATH="$path" "$cln" poses "$work/photos/train" \
        -o "$work/hopeless" --match next --progress none
    check "poses --match next matches in sequence" \
        grep -q sequential_matcher "$work/hopeless/colmap.log"
    expect "many in a row: each with the next" 0 "~next.12" \
        env PATH="$path" "$cln" poses "$work/many" -o "$work/row" --progress none
    cp "$work/photos/train/r_000.png" "$work/photos/train/r_001.png" "$work/two"
    expect "two photos" 3 "three" env PATH="$path" "$cln" poses "$work/two" -o "$work/of two"

    echo >"$work/walk.mp4"
    expect "a video without ffmpeg" 1 "apt ffmpeg" env PATH="$work/bin:$work/perl" "$cln" poses \
        "$work/walk.mp4" -o "$work/walk"
    printf '#!/bin/sh\necho "walk.mp4: Invalid data" >&2\nexit 1\n' >"$work/bin/ffmpeg"
    chmod +x "$work/bin/ffmpeg"
    cp "$work/bin/ffmpeg" "$work/bin/ffprobe"
    expect "a file that is no video: it is named first, with the reason" 3 \
        "~cl-nascent:.[^:]*walk.mp4:.*video.*Invalid.data.*give" env PATH="$path" "$cln" poses \
        "$work/walk.mp4" -o "$work/walk" --progress none
    check "neither writes a folder" [ ! -e "$work/walk" ]
    printf '#!/bin/sh\necho nb_frames=99\necho duration=10.0\n' >"$work/bin/ffprobe"
    cat >"$work/bin/ffmpeg" <<END
#!/bin/sh
case "\$*" in *"t)*1.200000+"*) ;; *) exit 1 ;; esac
for i in 1 2 3 4; do
    cp "$work/photos/train/r_00\$i.png" "$work/walk/images/frame_0000\$i.png"
done
END
    chmod +x "$work/bin/ffprobe" "$work/bin/ffmpeg"
    expect "a video" 0 "~4.of.the.video's.99.frames" env PATH="$path" "$cln" poses \
        "$work/walk.mp4" -o "$work/walk" --frames 12 --progress none --json
    check "poses of a video take its frames" [ "$(json registered) $(json photos)" = "3 4" ]
    # a second attempt in a folder where photos were linked, which ffmpeg must not write through
    mkdir "$work/mine"
    for i in 1 2 3 4; do cp "$work/photos/train/r_00$i.png" "$work/mine/frame_0000$i.jpg"; done
    cat >"$work/bin/ffmpeg" <<END
#!/bin/sh
for i in 1 2 3; do
    cat "$work/photos/train/r_01\$i.png" >"$work/again/images/frame_0000\$i.jpg"
done
END
    expect "photos that show too little" 1 "" env PATH="$path" STAND_IN=nothing "$cln" poses \
        "$work/mine" -o "$work/again" --progress none
    for i in 1 2; do # the second time, the first one's log is there
        expect "then a video: photos are no frames" 7 "~frame_0000.*no.frame ~empty.folder" \
            env PATH="$path" "$cln" poses "$work/walk.mp4" -o "$work/again" --progress none
    done
    check "the photos are what they were" cmp "$work/mine/frame_00001.jpg" \
        "$work/photos/train/r_001.png"
    check "and all there" [ "$(find "$work/again/images" -type f | wc -l)" = 4 ]
    rm -r "$work/again"
    for i in 1 2; do
        expect "a video, of which the second attempt removes the first one's frames" 1 \
            "~too.little.in.common" env PATH="$path" STAND_IN=nothing "$cln" poses \
            "$work/walk.mp4" -o "$work/again" --progress none
    done
    check "there are its frames alone" [ "$(find "$work/again/images" -type f | wc -l)" = 3 ]
    cp "$work/photos/train/r_001.png" "$work/again/images/mine.png"
    expect "a photo there that may be the only copy" 7 "~mine.png ~empty.folder" env PATH="$path" \
        "$cln" poses "$work/walk.mp4" -o "$work/again" --progress none
    expect "photos beside one that is none of them" 7 "~mine.png ~matched ~empty.folder" \
        env PATH="$path" "$cln" poses "$work/photos/train" -o "$work/again" --progress none
    cp "$work/walk.mp4" "$work/12:30.mp4"
    printf '#!/bin/sh\necho "$*" >"%s/probed"\necho duration=10.0\n' "$work" >"$work/bin/ffprobe"
    printf '#!/bin/sh\nprintf "%%s\\n" "$@" >"%s/made"\nexit 1\n' "$work" >"$work/bin/ffmpeg"
    expect "a video and a folder whose names mean something to ffmpeg" 1 "" \
        bash -c 'cd "$1" && PATH=$2 exec "$3" poses 12:30.mp4 -o a%d --progress none' - \
        "$work" "$path" "$cln"
    check "ffprobe gets a file, not an address" grep -q " file:12:30.mp4$" "$work/probed"
    check "so does ffmpeg" grep -qx "file:12:30.mp4" "$work/made"
    check "its percent sign is no number of a frame" \
        grep -qx "file:a%%d/images/frame_%05d.jpg" "$work/made"
    rm "$work/bin/ffmpeg" "$work/bin/ffprobe"
    film_poses "$path"
}

# film_poses PATH: a video of 6 frames a second for 2 seconds, by the real ffmpeg
film_poses() {
    local path=$1 asked taken
    if ! command -v ffmpeg >/dev/null || ! command -v ffprobe >/dev/null; then
        skip "frames of a real video" "no ffmpeg"
        return
    fi
    ffmpeg -nostdin -v error -framerate 6 -i "$work/photos/train/r_0%02d.png" -frames:v 12 \
        -c:v mjpeg -q:v 2 "$work/film.mov" || bad "ffmpeg makes a film"
    for asked in 150 4; do
        taken=$((asked < 12 ? asked : 12))
        expect "a film of 12 frames, of which $asked are asked for" 0 \
            "~$taken.of.the.video's.12.frames" env PATH="$path" "$cln" poses "$work/film.mov" \
            -o "$work/film $asked" --frames $asked --progress none
        check "$taken are taken, and none twice" [ "$(md5sum "$work/film $asked/images/"* |
            cut -d " " -f 1 | sort -u | wc -l) $(find "$work/film $asked/images" -type f |
            wc -l)" = "$taken $taken" ]
    done
}

# Copies of photos need room on another disk; on their own they are the same files. A file system of
# 12 MiB, and 24 photos of 1 MiB, whose ends are holes.
# Masks: COLMAP gets them as it wants them, training as they are.
section_masks() {
    local path=$work/bin:$PATH name
    [ -e "$work/photos" ] || "$make_scene" "$work/photos" --size 24 --train 24 --test 3 >/dev/null
    mkdir -p "$work/bin"
    cp tests/support/colmap "$work/bin/colmap"
    cp -r "$work/photos/train" "$work/cut out" # alpha is their own mask
    expect "masks, a folder of" 0 "~masks:.of.24.of.24.photos" env PATH="$path" "$cln" poses \
        "$work/photos/train" -o "$work/masked" --mask-path "$work/cut out" --progress none
    check "COLMAP is told where they are" \
        grep -q -- "--ImageReader.mask_path .*/masked/colmap.masks" "$work/masked/colmap.log"
    check "that they leave enough is not worth a word" not_said "turn the masks over"
    check "what it got is not kept, what was given is" eval \
        '[ ! -e "$work/masked/colmap.masks" ] && [ -e "$work/masked/masks/r_003.png" ]'
    expect "training finds them" 0 "" "$cln" info "$work/masked"
    check "all of them" printed "23 of them with a mask"
    rm -r "$work/masked/sparse"
    expect "the same again goes on" 0 "~goes.on.with.the.features" env PATH="$path" "$cln" poses \
        "$work/photos/train" -o "$work/masked" --mask-path "$work/cut out" --progress none
    rm -r "$work/masked/sparse"
    touch -d "2001-01-01" "$work/masked/masks/r_003.png"
    expect "not with other masks" 0 "" env PATH="$path" "$cln" poses "$work/photos/train" \
        -o "$work/masked" --mask-path "$work/cut out" --progress none
    check "features are found anew" not_said "goes on with"
    expect "one for all" 0 "~masks:.of.24.of.24" env PATH="$path" "$cln" poses \
        "$work/photos/train" -o "$work/masked 2" --mask-path "$work/cut out/r_003.png" \
        --progress none
    check "is called like none" [ -e "$work/masked 2/masks/of_all_photos.png" ]
    base64 -d >"$work/black.png" <<<"iVBORw0KGgoAAAANSUhEUgAAAAQAAAAECAAAAACMmsGiAAAAEklEQVR42mNg\
YGBgYGD4z4AEAA0HAQDbzr4EAAAAAElFTkSuQmCC"
    expect "one that is nearly black: white may be what does not count" 0 \
        "~leaves.3.*%.of.the.photos.*mogrify.-negate" env PATH="$path" "$cln" poses \
        "$work/photos/train" -o "$work/black" --mask-path "$work/black.png" --progress none
    cp "$work/black.png" "$work/one.JPG"
    expect "one for all of another ending" 0 "~masks:.of.24.of.24" env PATH="$path" "$cln" poses \
        "$work/photos/train" -o "$work/black 2" --mask-path "$work/one.JPG" --progress none
    check "keeps that" [ -e "$work/black 2/masks/of_all_photos.JPG" ]
    head -c 60 "$work/black.png" >"$work/half.png"
    expect "one that is cut off" 3 "~half.png:" env PATH="$path" "$cln" poses \
        "$work/photos/train" -o "$work/black 3" --mask-path "$work/half.png" --progress none
    check "this is said before anything is written" [ ! -e "$work/black 3" ]
    mkdir "$work/black 3"
    cp -r "$work/masked/masks" "$work/black 3/masks"
    expect "the scene's masks, of which nothing is said" 0 "~black.3/masks:.is.not.looked.at" \
        env PATH="$path" "$cln" poses "$work/photos/train" -o "$work/black 3" --progress none
    check "they are not looked at" not_said "masks: of"
    expect "photos with alpha, without masks" 0 "~alpha:.*of.24.photos" env \
        PATH="$path" "$cln" poses "$work/cut out" -o "$work/by alpha" --progress none
    check "what it cuts away is not looked at" \
        grep -q -- "--ImageReader.mask_path .*/by alpha/colmap.masks" "$work/by alpha/colmap.log"
    check "it makes no masks of the scene" [ ! -e "$work/by alpha/masks" ]
    cp -r "$work/cut out" "$work/photos/masks"
    expect "masks beside the photos, of which nothing is said" 0 "~masks:.is.not.*--mask-path" \
        env PATH="$path" "$cln" poses "$work/photos/train" -o "$work/unmasked" --progress none
    rm -r "$work/photos/masks"
    cp -r "$work/photos/train" "$work/both"
    cp -r "$work/cut out" "$work/both/masks"
    expect "masks in a folder among the photos are no photos" 0 \
        "~24.images.are.masks.*'masks/r_000.png'.*--mask-path.*/both/masks" \
        env PATH="$path" "$cln" poses \
        "$work/both" -o "$work/unmasked 2" --progress none
    check "they are not matched with them" [ ! -e "$work/unmasked 2/images/masks" ]
    expect "a folder of masks within that of the photos" 0 "~masks:.of.24.of.24.photos" \
        env PATH="$path" "$cln" poses "$work/both" -o "$work/masked 5" \
        --mask-path "$work/both/masks" --progress none
    expect "the photos' own folder, which has that of the masks" 3 "~give.*/both/masks," \
        env PATH="$path" "$cln" poses "$work/both" -o "$work/masked 6" --mask-path "$work/both"
    mv "$work/both/masks" "$work/both/people"
    expect "a folder within, of another name" 0 "~masks:.of.24.of.24.photos" \
        env PATH="$path" "$cln" poses "$work/both" -o "$work/masked 6" \
        --mask-path "$work/both/people" --progress none
    check "its files are no photos" [ ! -e "$work/masked 6/images/people" ]
    mkdir "$work/around"
    mv "$work/both" "$work/around/photos"
    expect "a folder of masks that has that of the photos" 2 "~the.photos.are.in.it" \
        env PATH="$path" "$cln" poses "$work/around/photos" -o "$work/masked 7" \
        --mask-path "$work/around"
    rm -r "$work/around/photos/people"
    expect "the photos' own folder, without masks" 3 "~no.photo.has.a.mask.beside" \
        env PATH="$path" "$cln" poses "$work/around/photos" -o "$work/masked 7" \
        --mask-path "$work/around/photos"
    for name in "$work/cut out"/*; do
        name=${name##*/}
        cp "$work/cut out/$name" "$work/around/photos/${name%.png}_mask.png"
    done
    expect "masks beside the photos in one folder" 0 "~masks:.of.24.of.24.photos" \
        env PATH="$path" "$cln" poses "$work/around/photos" -o "$work/masked 7" \
        --mask-path "$work/around/photos" --progress none
    check "they are the scene's masks, not its photos" eval \
        '[ -e "$work/masked 7/masks/r_003_mask.png" ] &&
         [ ! -e "$work/masked 7/images/r_003_mask.png" ] &&
         ! [ -e "$work/masked 7/masks/r_003.png" ]'
    expect "training finds them" 0 "" "$cln" info "$work/masked 7"
    check "all of them" printed "23 of them with a mask"
    mkdir "$work/in place"
    mv "$work/around/photos" "$work/in place/images"
    expect "masks among photos that are the scene's own" 3 "~24.masks.among.them.*move.them" \
        env PATH="$path" "$cln" poses "$work/in place/images" -o "$work/in place"
    rm -r "$work/masked/sparse" "$work/masked 2/sparse"
    cp -r "$work/cut out" "$work/corrected"
    cp "$work/cut out/r_004.png" "$work/corrected/r_003.png"
    expect "masks that were corrected" 7 "~r_003.png:.*another.mask;.move.*masks.away" \
        env PATH="$path" "$cln" poses "$work/photos/train" -o "$work/masked" \
        --mask-path "$work/corrected" --progress none
    expect "a folder of them in place of a single one" 7 \
        "~of_all_photos.png:.is.none.of.the.masks ~move.*masks.away" env PATH="$path" "$cln" \
        poses "$work/photos/train" -o "$work/masked 2" --mask-path "$work/cut out" --progress none
    expect "a single one in place of a folder" 7 "~has.masks.already ~move.it.away" env \
        PATH="$path" "$cln" poses "$work/photos/train" -o "$work/masked" \
        --mask-path "$work/cut out/r_003.png" --progress none
    mv "$work/masked/masks" "$work/masks before"
    expect "once these are away" 0 "~masks:.of.24.of.24" env PATH="$path" "$cln" poses \
        "$work/photos/train" -o "$work/masked" --mask-path "$work/corrected" --progress none
    check "features are found anew" not_said "goes on with"
    mkdir "$work/moved" "$work/no masks"
    cp "$work/cut out/r_003.png" "$work/moved/x1.png"
    cp "$work/cut out/r_004.png" "$work/moved/x2.png"
    expect "masks that are called otherwise" 3 "~none.of.its.pictures.*jpg.png" env \
        PATH="$path" "$cln" poses "$work/photos/train" -o "$work/masked 3" \
        --mask-path "$work/moved" --progress none
    check "before COLMAP begins" eval '! grep -q feature_extractor "$work/masked 3/colmap.log"'
    expect "no masks" 3 "~no.masks:.has.no.PNG" env PATH="$path" "$cln" poses \
        "$work/photos/train" -o "$work/masked 4" --mask-path "$work/no masks"
    expect "masks that are not there" 3 "~--mask-path.*not.there" env PATH="$path" "$cln" poses \
        "$work/photos/train" -o "$work/masked 4" --mask-path "$work/nowhere"
    check "nothing is written" [ ! -e "$work/masked 4" ]
}

section_room() {
    local path=$work/bin:$PATH in
    [ -e "$work/photos" ] || "$make_scene" "$work/photos" --size 24 --train 24 --test 3 >/dev/null
    mkdir -p "$work/bin" "$work/small"
    cp tests/support/colmap "$work/bin/colmap"
    if ! unshare -m mount -t tmpfs none "$work/small" 2>/dev/null; then
        skip "room for photos" "nothing can be mounted"
        return
    fi
    cp -r "$work/photos/train" "$work/long"
    truncate -s 1M "$work/long"/*
    in='mount -t tmpfs -o size=12m none "$0" && cp -r --sparse=always "$1" "$0/photos" && shift &&
        exec env PATH="$@"'
    expect "photos on their own disk need no room for copies" 0 "" unshare -m bash -c "$in" \
        "$work/small" "$work/long" "$path" "$cln" poses "$work/small/photos" \
        -o "$work/small/posed" --progress none
    expect "photos from another disk do" 7 "~too.little.room.for.24.photos" unshare -m bash -c \
        "$in" "$work/small" "$work/long" "$path" "$cln" poses "$work/long" \
        -o "$work/small/posed" --progress none
}

# What was found before an interruption lasts, if the photos and what was asked for are the same.
section_interrupted() {
    local path=$work/bin:$PATH s=$work/begun i
    mkdir -p "$work/bin"
    cp tests/support/colmap "$work/bin/colmap"
    "$make_scene" "$work/shots" --size 24 --train 8 --test 1 >/dev/null || bad "make-scene"
    env PATH="$path" STAND_IN=slow "$cln" poses "$work/shots/train" -o "$s" --progress none \
        >"$work/out" 2>"$work/err" &
    for ((i = 0; i < 100; i++)); do
        grep -q "Matching block .2/2, 2/2" "$s/colmap.log" 2>/dev/null && break
        sleep 0.1
    done
    kill -TERM $!
    wait $!
    check "a signal: exit code 143" [ $? = 143 ]
    check "it is said that the work lasts" said "~same.command.goes.on"
    echo "what was found" >>"$s/colmap.db"
    expect "the same command goes on" 0 "~goes.on.with.the.features.*colmap.db" env PATH="$path" \
        "$cln" poses "$work/shots/train" -o "$s" --progress none --json
    check "which tell no focal length now" eval '! said "EXIF tells"'
    check "with the same database" grep -qx "what was found" "$s/colmap.db"
    check "which has each photo once" [ "$(sort "$s/colmap.db" | uniq -d | wc -l)" = 0 ]
    check "and gives poses" [ "$(json registered)" = 7 ]
    env PATH="$path" STAND_IN=slow "$cln" poses "$work/shots/train" -o "$work/shot" \
        --progress none >"$work/out" 2>"$work/err" &
    for ((i = 0; i < 100; i++)); do
        grep -q "Matching block .2/2, 2/2" "$work/shot/colmap.log" 2>/dev/null && break
        sleep 0.1
    done
    kill -KILL $!
    wait $! 2>/dev/null
    sleep 0.5
    check "COLMAP does not outlive a program that is killed" eval \
        '! pgrep -f "$work/shot/colmap.db"'
    s=$work/other
    for i in first second; do
        [ $i = first ] || touch "$work/shots/train/r_003.png"
        env PATH="$path" STAND_IN=slow timeout 2 "$cln" poses "$work/shots/train" -o "$s" \
            --progress none >"$work/out" 2>"$work/err"
    done
    check "of a photo that has changed it begins anew" eval '! said "goes.on.with"'
    expect "so it does with other words" 0 "" env PATH="$path" "$cln" poses "$work/shots/train" \
        -o "$s" --match next --progress none
    check "without a word of the attempt before" eval '! said "goes.on.with"'
    expect "after a failure, too" 1 "" env PATH="$path" STAND_IN=nothing "$cln" poses \
        "$work/shots/train" -o "$work/failed" --progress none
    expect "which may be the features'" 0 "" env PATH="$path" "$cln" poses "$work/shots/train" \
        -o "$work/failed" --progress none
    check "likewise" eval '! said "goes.on.with"'
}

# with_gps FROM TO LATITUDE LONGITUDE ALTITUDE: a PNG with a GPS position in its EXIF data;
# ALTITUDE may be none
with_gps() {
    perl -e 'local $/; my $png = <STDIN>; my ($lat, $lon, $alt) = @ARGV;
        my $angle = sub { my $d = abs shift; my $m = 60 * ($d - int $d);
            (int $d, 1, int $m, 1, int(6e6 * ($m - int $m) + 0.5), 100000) };
        my $tiff = pack("A2 v V  v v v V V V  v", "II", 42, 8,  1, 0x8825, 4, 1, 26, 0,  6) .
            pack("v v V A4" . " v v V V" . " v v V A4" . " v v V V" . " v v V V" . " v v V V V",
                1, 2, 2, $lat < 0 ? "S\0\0\0" : "N\0\0\0",  2, 5, 3, 104,
                3, 2, 2, $lon < 0 ? "W\0\0\0" : "E\0\0\0",  4, 5, 3, 128,
                5, 1, 1, $alt =~ /^-/ ? 1 : 0,  6, 5, 1, 152, 0) .
            pack("V*", $angle->($lat), $angle->($lon),
                $alt eq "none" ? (0, 0) : (int(abs($alt) * 1000 + 0.5), 1000));
        print substr($png, 0, 33), pack("N", length $tiff), "eXIf", $tiff, "\0" x 4,
            substr($png, 33);' -- "$3" "$4" "$5" <"$1" >"$2"
}

# Photos on a circle of 40 m, whose heights are 1 m higher and lower than those of their cameras.
section_gps() {
    local path=$work/bin:$PATH i how first s
    [ -e "$work/photos" ] || "$make_scene" "$work/photos" --size 24 --train 24 --test 3 >/dev/null
    mkdir -p "$work/bin" "$work/flight" "$work/line" "$work/spot" "$work/flat" \
        "$work/two of them" "$work/spaced" "$work/rtk"
    cp tests/support/colmap "$work/bin/colmap"
    for ((i = 0; i < 24; i++)); do
        how=$(printf "r_%03d.png" $i)
        # of the 13th the device had no reception yet
        read -r lat lon alt first < <(perl -e 'my ($i) = @ARGV; my $a = $i * atan2(1, 1) / 3;
            printf "%.9f %.9f %.3f %.9f\n", $i == 12 ? (0, 0) : (-33.5 + 40 / 110900 * sin $a,
                151.25 + 40 / 92900 * cos $a), 70 + $i % 3, 151.25 + $i / 92900' $i)
        with_gps "$work/photos/train/$how" "$work/flight/$how" "$lat" "$lon" "$alt"
        with_gps "$work/photos/train/$how" "$work/spaced/a $how" "$lat" "$lon" "$alt"
        with_gps "$work/photos/train/$how" "$work/line/$how" -33.5 "$first" "$alt"
        with_gps "$work/photos/train/$how" "$work/flat/$how" "$lat" "$lon" none
        with_gps "$work/photos/train/$how" "$work/rtk/$how" "$lat" "$lon" \
            "$(perl -e 'printf "%.3f", 70 + 5.62 * sin($ARGV[0] * atan2(1, 1) / 3)' $i)"
        with_gps "$work/photos/train/$how" "$work/spot/$how" -33.5 151.25 "$alt"
        if ((i < 2)); then
            cp "$work/flight/$how" "$work/two of them"
        else
            cp "$work/photos/train/$how" "$work/two of them"
        fi
    done
    expect "photos with GPS: what can be had of it" 0 "~23.photos.have.GPS.*not.used:.--gps" \
        env PATH="$path" "$cln" poses "$work/flight" -o "$work/flown" --progress none --json
    check "the scene has no place" [ "$(json gps_photos) $(json origin)" = "23 null" ]
    cp -r "$work/flown" "$work/flown 2"
    for how in unaligned shrunk old; do
        expect "poses that are there, and COLMAP cannot place them: $how" 0 \
            "~--gps:.*stays.as.it.was" env PATH="$path" STAND_IN=$how "$cln" poses \
            "$work/flight" -o "$work/flown" --gps --progress none --json
        check "it is told" [ "$(json origin)" = null ]
        check "the model stays" cmp "$work/flown/sparse/0/images.bin" \
            "$work/flown 2/sparse/0/images.bin"
        case $how in
        unaligned) check "with COLMAP's word" said "Transform failed" ;;
        shrunk) check "with figures" said "~COLMAP.left.cameras.up.to.[34][0-9.]*.m.from" ;;
        old) check "with the version to install" said "~model_transformer.*3.8.or.newer" ;;
        esac
    done
    expect "poses that are there, later" 0 "~of.23.photos.already,.which.are.placed" \
        env PATH="$path" "$cln" poses "$work/flight" -o "$work/flown" --gps --progress none
    check "without mapping" eval '[ "$(grep -c "colmap mapper" "$work/flown/colmap.log")" = 1 ]'
    check "the origin" grep -q "^origin  *latitude -33.[45][09][0-9]*, longitude 151.25.*, h.* 71" \
        "$work/out"
    check "how well it fits" grep -q "within [01].[0-9]* m of" "$work/out"
    check "and how well the turn is known" \
        grep -q "by 2[0-9] positions: up is known to about 0.[0-9]* degrees" "$work/out"
    check "of a cube, nothing" eval '! grep -q bbox "$work/out"'
    expect "info tells the place" 0 "" "$cln" info "$work/flown" --json
    check "in words" grep -q "metres east, north and up from .*latitude -33.[45][09]" "$work/out"
    check "nothing is left over" [ "$(cd "$work/flown" && echo *) $(ls "$work/flown/sparse")" = \
        "colmap.db colmap.log colmap.stamp images sparse 0" ]
    head -n 2 "$work/flown/sparse/0/origin.txt" >"$work/origin once.txt"
    echo "bbox -1,-1,-1,1,1,1" >"$work/flown/cl-nascent.conf"
    expect "placed again" 0 "~which.are.placed" env PATH="$path" "$cln" poses "$work/flight" \
        -o "$work/flown" --gps --progress none
    check "its cube is of another frame" \
        grep -q "^  *the bbox in its cl-nascent.conf is" "$work/out"
    rm "$work/flown/cl-nascent.conf"
    check "in the same place" eval \
        'head -n 2 "$work/flown/sparse/0/origin.txt" | cmp - "$work/origin once.txt"'
    cp -r "$work/flown" "$work/worked on"
    s=$work/worked\ on
    for how in project.ini points3D.ply images.txt cameras.txt; do
        echo "$how" >"$s/sparse/0/$how"
    done
    mkdir "$s/sparse/0/lists" "$s/sparse.before"
    touch "$s/sparse/0/lists/train.txt"
    echo "another program's" >"$s/sparse/0/origin.txt"
    expect "placed with files of others beside the model" 0 "~0.holds.2.files.*make.it.anew" env \
        PATH="$path" "$cln" poses "$work/flight" -o "$s" --gps --progress none
    check "these stay" [ "$(cd "$s/sparse/0" && cat project.ini points3D.ply && ls lists)" = \
        $'project.ini\npoints3D.ply\ntrain.txt' ]
    check "text of the model before, and another's file of that name, are kept aside" eval \
        '[ "$(cd "$s" && echo sparse*)" = "sparse sparse.before sparse.before.2" ] &&
            [ "$(cd "$s/sparse.before.2" && echo *)" = "cameras.txt images.txt origin.txt" ] &&
            grep -q "another program" "$s/sparse.before.2/origin.txt" &&
            said "sparse.before.2 now"'
    check "beside the model that is placed" eval \
        'head -n 2 "$s/sparse/0/origin.txt" | cmp - "$work/origin once.txt"'
    mkdir "$s/sparse.gps" # as of one that was killed between
    touch "$s/sparse.gps/images.bin" "$s/sparse.gps/depth_params.json"
    expect "after one that was interrupted" 0 "" env PATH="$path" "$cln" poses "$work/flight" \
        -o "$s" --gps --progress none
    check "files of others are not lost, either" eval \
        '[ -e "$s/sparse/0/depth_params.json" ] && [ ! -e "$s/sparse.gps" ]'
    cp -r "$work/flown" "$work/by link"
    mv "$work/by link/sparse/0" "$work/elsewhere"
    ln -s ../../elsewhere "$work/by link/sparse/0"
    touch "$work/elsewhere/mine.txt" "$work/elsewhere/frames.bin"
    find "$work/elsewhere" -type f -exec md5sum {} + | sort >"$work/elsewhere once.txt"
    expect "a model that sparse/0 points to" 0 "" env PATH="$path" "$cln" poses "$work/flight" \
        -o "$work/by link" --gps --progress none
    check "is left as it was" eval \
        'find "$work/elsewhere" -type f -exec md5sum {} + | sort | cmp - "$work/elsewhere once.txt"'
    check "and what is placed stands in the link's place" \
        eval '[ ! -L "$work/by link/sparse/0" ] && [ -e "$work/by link/sparse/0/images.bin" ]'
    touch "$s/sparse/0/"{rigs,frames}.bin # as newer COLMAPs write them; this one does not
    expect "rigs and frames are of the model before" 0 "" env PATH="$path" "$cln" poses \
        "$work/flight" -o "$s" --gps --progress none
    check "and go with it" \
        eval '[ ! -e "$s/sparse/0/rigs.bin" ] && [ ! -e "$s/sparse/0/frames.bin" ]'
    mkdir -p "$work/few"
    cp "$work/flight"/r_00[0369].png "$work/flight/r_012.png" "$work/flight/r_016.png" "$work/few"
    expect "placed again by some of the photos" 0 "~by.the.positions.of.5.of.23.cameras.alone" env \
        PATH="$path" "$cln" poses "$work/few" -o "$s" --gps --progress none --json
    check "of which so many have a pose" [ "$(json photos) $(json registered)" = "6 6" ]
    cp "$work/flight"/r_0{0[1245],10}.png "$work/flight"/r_01[1378].png "$work/few"
    expect "by more than half of them" 0 "" env PATH="$path" "$cln" poses "$work/few" -o "$s" \
        --gps --progress none
    check "that is not told" not_said "alone"
    cp "$s/sparse/0"/*.bin "$s/sparse"
    cp "$s/sparse/0/images.bin" "$work/images once.bin"
    expect "where readers take another model" 7 "~--gps.places.sparse/0.*is.in.*sparse;.move" env \
        PATH="$path" "$cln" poses "$work/flight" -o "$s" --gps --progress none
    check "nothing is placed" cmp "$s/sparse/0/images.bin" "$work/images once.bin"
    expect "poses of photos without, which are told how" 7 "~has.poses.already.*--gps.places" \
        env PATH="$path" "$cln" poses "$work/flight" -o "$work/flown" --progress none
    expect "poses of photos without GPS" 0 "" env PATH="$path" "$cln" poses "$work/photos/train" \
        -o "$work/later" --progress none
    rm "$work/later/colmap."* # as of another program that runs COLMAP
    expect "whose copies got it later" 0 "" env PATH="$path" "$cln" poses "$work/flight" \
        -o "$work/later" --gps --progress none
    check "placed" eval \
        'head -n 2 "$work/later/sparse/0/origin.txt" | cmp - "$work/origin once.txt"'
    check "with the photos that were there" cmp "$work/later/images/r_000.png" \
        "$work/photos/train/r_000.png"
    mkdir -p "$work/others"
    for ((i = 0; i < 24; i++)); do
        cp "$work/flight/r_$(printf %03d $i).png" "$work/others/other_$i.png"
    done
    expect "photos of other names" 0 "~0.have.a.pose.*stays.as.it.was" env PATH="$path" "$cln" \
        poses "$work/others" -o "$work/later" --gps --progress none
    for how in "" newer unknown; do
        expect "at once; COLMAP: ${how:-3.8}" 0 "" env PATH="$path" STAND_IN=$how "$cln" poses \
            "$work/flight" -o "$work/at once $how" --gps --progress none --json
        check "its JSON" eval '[ "$(json origin.height)" = 71 ] &&
            [[ $(json origin.gps_distance) =~ ^(0|1\.0) && $(json origin.up_sd) =~ ^0\.[1-5] &&
                $(json origin.gps_used) =~ ^2[0-9]$ ]]'
    done
    expect "no altitudes: up by the cameras" 0 "~23.photos.have.latitude.*0.an.altitude" env \
        PATH="$path" "$cln" poses "$work/flat" -o "$work/flattened" --gps --progress none --json
    check "the height is 0" [ "$(json origin.height)" = 0 ]
    check "and how it fits" eval '[[ $(json origin.gps_distance) =~ ^0.0 ]]'
    expect "heights that fit, and cameras that lean by 8 degrees: GPS" 0 \
        "~8.0.degrees.from.where.GPS.*is.taken.*give.--up=.*0.99..to.render" env PATH="$path" \
        "$cln" poses "$work/rtk" -o "$work/leaning" --gps --progress none
    expect "which is up in what is made of it, too" 0 "" "$cln" train "$work/leaning" \
        -o "$work/leaning run" --steps 1 --progress none
    check "z, not the cameras'" [ "$(perl -0777 -ne \
        'print join ",", $1 =~ /[-0-9.]+/g if /"up": \[([^]]*)\]/' \
        "$work/leaning run/run.json")" = 0.0,0.0,1.0 ]
    expect "positions along a line, of photos from a circle" 0 "~north.to.*degrees|too.little" \
        env PATH="$path" "$cln" poses "$work/line" -o "$work/lined" --gps --progress none --json
    check "COLMAP is not asked to" eval '[ "$(json origin)" = null ] &&
        ! grep -q "colmap model_transformer" "$work/lined/colmap.log"'
    expect "nor is it advised where all are from a spot" 0 "" env PATH="$path" "$cln" poses \
        "$work/spot" -o "$work/lined 2" --progress none
    check "not a word" eval '! said "GPS"'
    for how in photos/train "two of them"; do
        expect "--gps of photos without: $how" 3 "~[02].of.24.photos.have.a.GPS ~leave.--gps.out" \
            env PATH="$path" "$cln" poses "$work/$how" -o "$work/unplaced" --gps
        check "nothing is written" [ ! -e "$work/unplaced" ]
    done
    expect "names with a space" 0 "" env PATH="$path" "$cln" poses "$work/spaced" \
        -o "$work/spaced placed" --gps --progress none --json
    check "are placed as others" [ "$(json origin.height)" = 71 ]
    touch "$work/film.mp4"
    expect "--gps of a video" 2 "~film.mp4:.--gps:.*no.GPS" env PATH="$path" "$cln" poses \
        "$work/film.mp4" -o "$work/unplaced" --gps
}

run_sections "photos masks interrupted room gps" "$@"
