#!/bin/bash
# `make install` into a folder of its own and into folders as packagers choose them, and uninstall;
# completion; `make deb`, `make dist`; the header by itself, the shared library's exports,
# pkg-config, and examples/ compiled against only the installed files, shared and static, and run on
# a tiny generated scene. Runs on any OpenCL device (PoCL is enough).
#   tests/cli/install.sh
# Every check is one line of the count in the last line; the output of a failed one is shown.
set -u
cd "$(dirname "$0")/../.." || exit 1

sources=$PWD/examples
work=$(mktemp -d "${TMPDIR:-/tmp}/cln-install-XXXXXX")
trap 'rm -rf "$work"' EXIT

. tests/support/checks.sh

root="$work/the root" # nothing may break at a space
usr=$root/usr
cln=$usr/bin/cl-nascent
lib=$usr/lib
cc=${CC:-gcc}
flags=(-std=c11 -O1 -Wall -Wextra -Wpedantic -Werror)

# Without root, packages that the program needs are an error, others are named.
mkdir "$work/packages"
cat >"$work/packages/dpkg-query" <<'END'
#!/bin/sh
case " $* " in *lcms2* | *"$MISSING"*) exit 1 ;; esac
echo installed
END
printf '#!/bin/sh\necho 1001\n' >"$work/packages/id"
chmod +x "$work/packages/"*
for name in tr sh cat env grep; do
    ln -s "$(command -v $name)" "$work/packages/$name"
done
expect "make deps without root: what is optional may lack" 0 "" \
    env PATH="$work/packages" MISSING=meshopt sh tests/deps.sh build
check "it is named" grep -q "liblcms2-dev libmeshoptimizer-dev" "$work/out"
expect "make deps without root: what is needed may not" 1 "~apt-get.install.*libjansson-dev" \
    env PATH="$work/packages" MISSING=jansson sh tests/deps.sh build

# Scripts that get make's name are not run by a dry run, as a recipe with $(MAKE) would be.
mkdir -p "$work/dry/tests"
ln -s "$PWD"/{bench,data,docs,examples,host,include,kernels} "$work/dry"
cp -r Makefile packaging "$work/dry"
printf '#!/bin/sh\n[ "$0" = tests/deps.sh ] || touch ran\n' |
    tee "$work/dry/tests/all.sh" "$work/dry/tests/deps.sh" >"$work/dry/packaging/deb.sh"
chmod +x "$work/dry"/*/*.sh
for target in test test-all check deb; do
    run "${MAKE:-make}" -C "$work/dry" -n $target
    check "make -n $target runs nothing" [ $rc = 0 -a ! -e "$work/dry/ran" ]
    rm -f "$work/dry/ran"
done
expect "make test runs the suite" 0 "" "${MAKE:-make}" -C "$work/dry" test
check "that it does" [ -e "$work/dry/ran" ]

# tests/documents.sh, a part of make lint, finds what documents name and is not there.
mkdir "$work/tree"
ln -s "$PWD"/* "$work/tree"
rm "$work/tree/docs" "$work/tree/README.md"
cp -r docs README.md "$work/tree"
run tests/documents.sh "$work/tree"
check "what documents name is there" [ $rc = 0 -a ! -s "$work/out" ]
sed -i 's/ frames ([^)]*),//' "$work/tree/docs/formats.md"
cat >>"$work/tree/README.md" <<'END'
[a](docs/nowhere.md) [b](docs/formats.md#no-such-heading) [good](docs/formats.md#digests)
host/nowhere.c host/api/*.c results.md, *No such
heading*, and `build/cl-nascent eval RUN --no-seams --no-mesh -o x`.
    cl-nascent train --steps 3 \
        --split test
`--speed`
END
run tests/documents.sh "$work/tree"
check "what is not there is an error" [ $rc = 1 ]
check "each is named, and nothing else" [ "$(wc -l <"$work/out")" = 9 ]
while read -r words; do
    check "$words" grep -qF -e "$words" "$work/out"
done <<'END'
docs/nowhere.md: there is no docs/nowhere.md
docs/formats.md has no such heading
there is no host/nowhere.c
results.md has no heading "No such heading"
--no-mesh is no option of eval
--split is no option of train
--speed is an option of no command
the finding 'frames' is not there
END

run "${MAKE:-make}" --no-print-directory -j2 build/make-scene build/json-query
check "make-scene and json-query are built" [ $rc = 0 ]
run "${MAKE:-make}" --no-print-directory install DESTDIR="$root" PREFIX=/usr
check "make install" [ $rc = 0 ] # the rest needs it
[ $rc = 0 ] || { count; exit 1; }
for file in bin/cl-nascent include/cl_nascent.h lib/libcl-nascent.a lib/libcl-nascent.so.0 \
    lib/libcl-nascent.so lib/pkgconfig/cl-nascent.pc \
    share/man/man1/cl-nascent.1 share/doc/cl-nascent/docs/api.md; do
    check "$file is there" [ -s "$usr/$file" ]
done

for file in README.md docs/api.md docs/formats.md docs/results.md; do
    tr -d '\n' <"$usr/share/doc/cl-nascent/$file" | grep -oE '\]\([^):# ]+' | cut -c 3- |
        grep -vx https >"$work/links"
    while read -r link; do
        [ -e "$(dirname "$usr/share/doc/cl-nascent/$file")/$link" ] || echo "$link"
    done <"$work/links" >"$work/out"
    check "$file refers to documents that are there" [ -s "$work/links" -a ! -s "$work/out" ]
done

# ---- manual pages ----

"$cln" --help | sed -n '/^Commands:/,/^$/s/^  \([a-z]*\) .*/\1/p' |
    grep -vxE 'help|version' >"$work/commands"
check "there are commands" [ "$(wc -l <"$work/commands")" -gt 10 ]
while read -r command; do
    page=$usr/share/man/man1/cl-nascent-$command.1
    check "the page of $command says what it is" grep -q "^cl.-nascent.-$command .- [a-zA-Z]" \
        "$page"
    check "the page of $command has a date that mandoc reads, too" \
        grep -qE '^\.TH [^ ]+ 1 "20[0-9]{2}-[0-9]{2}-[0-9]{2}" ' "$page"
    check "the page of $command has its options" grep -q '^\.SS All commands' "$page"
    if command -v man >/dev/null && command -v groff >/dev/null; then
        LC_ALL=C.UTF-8 MANROFFSEQ='' MANWIDTH=80 man --warnings -E UTF-8 -l -Tutf8 -Z "$page" \
            2>"$work/err" >/dev/null
        check "the page of $command is clean" [ ! -s "$work/err" ]
    fi
done <"$work/commands"

# ---- completion ----

bash_completion=$usr/share/bash-completion/completions/cl-nascent
zsh_completion=$usr/share/zsh/site-functions/_cl-nascent
fish_completion=$usr/share/fish/vendor_completions.d/cl-nascent.fish

# completes WORD...: what bash offers for the last word
completes() {
    # shellcheck disable=SC2016
    bash -c '. "$1"; shift; COMP_WORDS=("$@"); COMP_CWORD=$(($# - 1)); _cl_nascent
        echo "${COMPREPLY[*]}"' bash "$bash_completion" "$@"
}
check "bash completes commands" [ "$(completes cl-nascent tr)" = train ]
check "bash completes options of the command" \
    [ "$(completes cl-nascent render r --spir)" = --spiral ]
check "bash completes no options of another command" [ -z "$(completes cl-nascent eval r --spir)" ]
check "bash completes settings" [ "$(completes cl-nascent train s --uniform-sh)" = --uniform-share ]
check "bash completes switches both ways" \
    [ "$(completes cl-nascent train s --no-conf)" = --no-conf ]
check "bash completes values" [ "$(completes cl-nascent render r --depth mea)" = mean ]
check "bash completes values after =" [ "$(completes cl-nascent eval r --split = tr)" = train ]
check "bash completes version" [ "$(completes cl-nascent ver)" = version ]
check "bash completes help's command" [ "$(completes cl-nascent help ev)" = eval ]
check "bash completes shells" [ "$(completes cl-nascent completion z)" = zsh ]
# sorted: what stands in a command's place, one a line
completes cl-nascent "" | tr ' ' '\n' | sort >"$work/words"
check "bash has the commands of --help, help and version" \
    diff <(sort "$work/commands" - <<<$'help\nversion') "$work/words"
check "zsh has the same" \
    diff <(sed -nE "s/^        '([a-z]+):.*/\1/p" "$zsh_completion" | sort) "$work/words"
check "zsh has the options of every command" \
    diff <(sed -nE 's/^([a-z]+)\)$/\1/p' "$zsh_completion" | sort) \
    <(grep -vxE 'help|version' "$work/words")
check "fish has the same" \
    diff <(sed -nE 's/.*__fish_use_subcommand -f -a ([a-z]+) .*/\1/p' "$fish_completion" | sort) \
    "$work/words"
check "fish completes help's command" grep -qE "from help' -f -a '.* eval( |')" "$fish_completion"
for file in "$zsh_completion" "$fish_completion"; do
    check "apostrophes stay in ${file##*/}" grep -qF "of a run'\\''s renders" "$file"
    shell=$([ "$file" = "$zsh_completion" ] && echo zsh || echo fish)
    if command -v "$shell" >/dev/null; then
        run "$shell" -n "$file"
        check "$shell reads its completion" [ $rc = 0 ]
    else
        skip "$shell reads its completion" "no $shell"
    fi
done

# ---- a Debian package, and the way back ----

if command -v dpkg-shlibdeps >/dev/null && command -v dpkg-deb >/dev/null; then
    run "${MAKE:-make}" --no-print-directory deb
    check "make deb" [ $rc = 0 ]
    deb=$PWD/$(tail -1 "$work/out")
    run dpkg-deb -x "$deb" "$work/deb"
    check "the package can be unpacked" [ $rc = 0 ]
    check "the package's program runs" [ "$("$work/deb/usr/bin/cl-nascent" --version)" = \
        "$("$cln" --version)" ]
    check "the package depends on OpenCL's loader" \
        grep -q ocl-icd <<<"$(dpkg-deb -f "$deb" Depends)"
    doc=$work/deb/usr/share/doc/cl-nascent
    check "the package's copyright names what is linked in" grep -q "Sean Barrett" "$doc/copyright"
    check "the package has no photos under other licences, nor asks for them" \
        [ ! -e "$doc/docs/captures.jpg" -a -z "$(grep -F '](captures.jpg)' "$doc/docs/"*.md)" ]
    (cd "$work/deb" && dpkg-deb --ctrl-tarfile "$deb" | tar -xO ./md5sums | md5sum -c --quiet)
    check "the package's checksums are right" [ $? = 0 ]
    if command -v lintian >/dev/null; then
        lintian --allow-root "$deb" >"$work/out" 2>&1
        check "lintian finds nothing" [ ! -s "$work/out" ]
    else
        skip "lintian finds nothing" "not installed"
    fi
else
    skip "make deb" "no dpkg-dev"
fi
run "${MAKE:-make}" --no-print-directory install DESTDIR="$work/gone" PREFIX=/usr
touch "$work/gone/usr/bin/other"
run "${MAKE:-make}" --no-print-directory uninstall DESTDIR="$work/gone" PREFIX=/usr
check "make uninstall" [ $rc = 0 ]
check "make uninstall leaves only others' files, and no empty folders" \
    [ "$(cd "$work/gone" && find . | sort | xargs)" = ". ./usr ./usr/bin ./usr/bin/other" ]
mkdir -p "$work/gone/usr/local/lib/pkgconfig" "$work/gone/usr/share/empty"
run "${MAKE:-make}" --no-print-directory uninstall DESTDIR="$work/gone" PREFIX=/usr/local
check "nor do others' empty folders go, nor what is above the prefix" \
    [ "$(cd "$work/gone" && find . | sort | xargs)" = \
    ". ./usr ./usr/bin ./usr/bin/other ./usr/share ./usr/share/empty" ]

# a relative prefix, as GNU spells it, and all of it goes
own="$work/own$PWD/build/own prefix"
run "${MAKE:-make}" --no-print-directory install DESTDIR="$work/own" prefix="build/own prefix"
check "make install into a relative prefix=" [ $rc = 0 -a -x "$own/bin/cl-nascent" ]
check "pkg-config has the whole of it" grep -qxF "prefix=$PWD/build/own\\ prefix" \
    "$own/lib/pkgconfig/cl-nascent.pc"
run "${MAKE:-make}" --no-print-directory uninstall DESTDIR="$work/own" prefix="build/own prefix"
check "make uninstall takes the prefix away, too, and nothing above it" \
    [ $rc = 0 -a ! -e "$own" -a -d "${own%/*}" ]

# ---- folders that packagers choose ----

chosen=(DESTDIR="$work/chosen" PREFIX=/usr BINDIR=/b LIBDIR=/usr/lib/x86_64-linux-gnu
    INCLUDEDIR=/usr/include/cl DATADIR=/data MANDIR=/man DOCDIR=/documents
    BASHDIR=/bash ZSHDIR=/zsh FISHDIR=/fish)
run "${MAKE:-make}" --no-print-directory install "${chosen[@]}"
check "make install into other folders" [ $rc = 0 ]
for file in b/cl-nascent usr/lib/x86_64-linux-gnu/libcl-nascent.so.0 usr/include/cl/cl_nascent.h \
    usr/lib/x86_64-linux-gnu/pkgconfig/cl-nascent.pc data/cl-nascent/tune man/man1/cl-nascent.1 \
    documents/README.md bash/cl-nascent zsh/_cl-nascent fish/cl-nascent.fish; do
    check "$file is there" [ -s "$work/chosen/$file" ]
done
check "nothing is elsewhere" [ "$(cd "$work/chosen" && echo * usr/*)" = \
    "b bash data documents fish man usr zsh usr/include usr/lib" ]
for pair in libdir=/usr/lib/x86_64-linux-gnu includedir=/usr/include/cl; do
    check "pkg-config has $pair" [ "$(pkg-config "--variable=${pair%=*}" \
        "$work/chosen/usr/lib/x86_64-linux-gnu/pkgconfig/cl-nascent.pc")" = "${pair#*=}" ]
done
touch "$work/chosen/documents/others"
run "${MAKE:-make}" --no-print-directory uninstall "${chosen[@]}"
check "make uninstall from these folders" \
    [ "$(cd "$work/chosen" && find . | sort | xargs)" = ". ./documents ./documents/others" ]

# ---- the sources as an archive ----

if git rev-parse HEAD >/dev/null 2>&1 && command -v xz >/dev/null; then
    run "${MAKE:-make}" --no-print-directory dist
    version=$("$cln" --version | cut -d' ' -f2)
    check "make dist" [ $rc = 0 ]
    tar -tf "build/cl-nascent-$version.tar.xz" | grep -v '/$' | sort >"$work/out"
    check "the archive has what the commit has, in a folder of its own" \
        diff <(git ls-tree -r --name-only HEAD | sed "s|^|cl-nascent-$version/|" | sort) \
        "$work/out"
    check "it names the commit" [ "$(tar -xOf "build/cl-nascent-$version.tar.xz" \
        "cl-nascent-$version/packaging/commit")" = "$(git log -1 --format=%H)" ]
else
    skip "make dist" "no git, or no xz"
fi
run "${MAKE:-make}" --no-print-directory help
check "make help names what it makes" grep -q '^ *make install  *program and library: PREFIX=' \
    "$work/out"
run "${MAKE:-make}" -pn uninstall DESTDIR="$work/none"
check "make check is make test" grep -qx "check: test" "$work/out"

# ---- variables of make ----

# what make would do for one object and the archive
run "${MAKE:-make}" --no-print-directory -Bn CPPFLAGS=-DFROM_CPPFLAGS CFLAGS=-DFROM_CFLAGS \
    AR=other-ar OBJCOPY=other-objcopy B="$work/none" "$work/none/public/libcl-nascent.a"
for word in -DFROM_CPPFLAGS -DFROM_CFLAGS "other-ar rcs" "other-objcopy --localize"; do
    check "make takes $word" grep -q -e "$word" "$work/out"
done
without=(EXPAT= LCMS2= MICROHTTPD= MESHOPTIMIZER= UTF8PROC=)
check "CONTRIBUTING.md has the same words" eval \
    'tr "\n" " " <CONTRIBUTING.md | grep -q "make ${without[*]}"'
run "${MAKE:-make}" --no-print-directory -n "${without[@]}" \
    B="$work/none" "$work/none/obj/host/io/colour.o" "$work/none/cl-nascent.pc" \
    "$work/none/cl-nascent"
check "make leaves out what packagers name" \
    eval 'grep -q "colour.o" "$work/out" &&
        ! grep -qE "CLN_WITH|lcms|microhttpd|utf8proc|expat" "$work/out"'
printf '#!/bin/sh\necho "$*" >>"%s/asked"\nexec pkg-config "$@"\n' "$work" >"$work/other-config"
chmod +x "$work/other-config"
run "${MAKE:-make}" -n PKG_CONFIG="$work/other-config" B="$work/none" "$work/none/none.o"
check "make takes PKG_CONFIG" grep -q stb "$work/asked"
run "${MAKE:-make}" --no-print-directory B="$work/spaced" PREFIX="/opt/my app" \
    "$work/spaced/cl-nascent.pc"
check "a prefix with a space" [ "$(PKG_CONFIG_PATH="$work/spaced" \
    pkg-config --cflags --libs cl-nascent | sed 's/ *$//')" = \
    '-I/opt/my\ app/include -L/opt/my\ app/lib -lcl-nascent' ]

(umask 077 && "${MAKE:-make}" --no-print-directory install DESTDIR="$work/strict" PREFIX=/usr) \
    >"$work/out" 2>&1
check "make install under a strict umask" [ $? = 0 ]
# the folders above /usr are the system's
find "$work/strict/usr" ! -type l ! -perm -444 -o -type d ! -perm -555 >"$work/out"
check "under a strict umask everybody can read what is installed" \
    [ -d "$work/strict/usr" -a ! -s "$work/out" ]
rm -rf "$work/strict"

# From here on nothing of the source tree is used but the examples' text.
cp "$sources"/*.c tests/support/two_threads.c "$work"
cd "$work" || exit 1

# ---- header ----

echo '#include <cl_nascent.h>' >header.c
run "$cc" "${flags[@]}" -fsyntax-only -I"$usr/include" header.c
check "the header stands alone, in C" [ $rc = 0 ]
if command -v g++ >/dev/null; then
    run g++ -std=c++11 -Wall -Wextra -Werror -fsyntax-only -x c++ -I"$usr/include" header.c
    check "the header stands alone, in C++" [ $rc = 0 ]
else
    skip "the header stands alone, in C++" "no g++"
fi

# ---- shared library ----

declared() {
    grep -v '^#' "$usr/include/cl_nascent.h" | tr '\n' ' ' |
        grep -oE 'CLN_API [a-z_ *0-9]+\(' | sed 's/($//; s/.*[ *]//' | sort
}
exported() {
    nm -D --defined-only "$lib/libcl-nascent.so.0" | awk '{ print $3 }' | sort
}
declared >declared.txt
exported >exported.txt
check "functions are declared for export" [ "$(wc -l <declared.txt)" -gt 20 ]
while read -r name; do
    grep -qw "$name" "$usr/share/doc/cl-nascent/docs/api.md" || echo "$name"
done <declared.txt >out
check "docs/api.md names every function" [ ! -s out ]
run diff declared.txt exported.txt
check "the shared library exports what the header declares, and nothing else" [ $rc = 0 ]
nm -g --defined-only "$lib/libcl-nascent.a" | awk 'NF == 3 { print $3 }' | sort >exported.txt
run diff declared.txt exported.txt
check "so does the static library, which goes with others' stb_image, say" [ $rc = 0 ]
readelf -d "$lib/libcl-nascent.so.0" >dynamic.txt
check "the shared library has its soname" grep -q 'SONAME.*\[libcl-nascent\.so\.0\]' dynamic.txt
check "the linker's name leads to it" [ "$(readlink "$lib/libcl-nascent.so")" = libcl-nascent.so.0 ]

# ---- pkg-config ----

# The file's prefix is /usr, where it will be; here it is in $root.
config() {
    PKG_CONFIG_PATH="$lib/pkgconfig" pkg-config --define-variable=prefix=/prefix "$@" cl-nascent
}
version=$(sed -n 's/^#define CLN_VERSION "\(.*\)"/\1/p' "$usr/include/cl_nascent.h")
check "the version of pkg-config is the header's" [ "$(config --modversion)" = "$version" ]
check "the version of pkg-config is the program's" \
    [ "$("$cln" --version)" = "cl-nascent $version" ]
run config --libs
check "shared linking needs this library alone" [ "$(tr -d ' ' <out)" = -L/prefix/lib-lcl-nascent ]
run config --static --libs
for name in OpenCL jansson z m $(pkg-config --exists libmicrohttpd && echo microhttpd) \
    $([ -e /usr/include/meshoptimizer.h ] && echo meshoptimizer); do
    check "static linking names -l$name" grep -qE -- "-l$name( |\$)" out
done

# words OUTPUT: the flags of pkg-config, one a line, in this root
words() {
    tr ' ' '\n' <<<"$1" | sed '/^$/d' | sed "s|/prefix|$usr|"
}

# build KIND NAME: KIND/NAME from NAME.c
build() {
    local kind=$1 name=$2 libs
    mkdir -p "$kind"
    mapfile -t cflags < <(words "$(config --cflags)")
    if [ "$kind" = static ]; then # the linker prefers a shared library of the same name
        libs=$(config --static --libs |
            sed 's/-lcl-nascent/-Wl,-Bstatic -lcl-nascent -Wl,-Bdynamic/')
    else
        libs=$(config --libs)
    fi
    mapfile -t libs < <(words "$libs")
    run "$cc" "${flags[@]}" "${cflags[@]}" "$name.c" "${libs[@]}" -lm -pthread -o \
        "$kind/$name"
    check "$name.c compiles, $kind" [ $rc = 0 ]
}
for name in train render field; do
    build shared $name
    build static $name
done
check "static examples do not need the shared library" \
    [ "$(readelf -d static/* | grep -c 'NEEDED.*cl-nascent')" = 0 ]
check "shared examples need the shared library" \
    [ "$(readelf -d shared/* | grep -c 'NEEDED.*libcl-nascent\.so\.0')" = 3 ]
export LD_LIBRARY_PATH=$lib
build shared two_threads
for i in 1 2 3 4 5; do
    run shared/two_threads
    check "threads that begin together, $i" [ $rc = 0 ]
done

# ---- the examples ----

"$make_scene" "$work/scene" --size 32 --train 8 --test 2 >/dev/null || bad "make-scene"
small=(grid-cells=4 n1=8 rays=256 batch-samples=4096 start-level=1
    level-at= max-level=1 cull-after=0 log-every=20)

for kind in shared static; do
    run $kind/train scene run-$kind steps=60 "${small[@]}"
    check "train, $kind" [ $rc = 0 ]
    check "train prints its result, $kind" grep -qE '^60 steps in .* leaves$' out
    check "train measures the held-out views, $kind" grep -qE '^mean: [0-9.]+ dB, SSIM' out
done
check "both train the same model" same_model run-shared run-static
run shared/train scene run-shared steps=+20
check "the same call resumes the run" [ $rc = 0 ]
check "it trains to the added steps" grep -q '^80 steps' out
expect "a setting that does not exist, with the nearest" 2 "stepz steps" \
    shared/train scene other stepz=5
expect "a value out of range" 2 "width 16" shared/train scene other width=3
expect "a missing scene" 3 "nowhere" shared/train nowhere other steps=5
check "no refused training leaves a run" [ ! -e other ]

run shared/render run-shared orbit 2
check "render" [ $rc = 0 ]
check "the library prints nothing of its own" [ ! -s err ]
for file in 0000.png 0001.png 0001.depth.npy 0001.opacity.png; do
    check "orbit_$file is there" [ -s orbit/orbit_$file ]
done
run static/render run-shared orbit 2
check "existing frames are skipped" grep -q '^0 frames in .*; 2 existed already$' out
expect "no frames" 2 "~which.poses orbit_frames" shared/render run-shared orbit 0

run shared/field run-shared
check "field" [ $rc = 0 ]
check "field shows the slice and the picture" [ "$(wc -l <out)" = 66 ]
check "field shows where it is densest" grep -qE '^densest at ' out
check "field shows what is seen from above" grep -qE '^from above: [1-9][0-9]* % of ' out
cp out slice.txt
run static/field run-shared
check "both builds print the same field" cmp -s out slice.txt
expect "a folder that is not a run" 3 "~a.scene,.not.a.run" shared/field scene

count
