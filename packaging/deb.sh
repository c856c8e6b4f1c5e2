#!/bin/sh
# make deb: build/cl-nascent_VERSION_ARCH.deb, with only the program (it contains the library), from
# `make install` into a folder. Needs dpkg-dev. Uses no debhelper and makes no source package.
set -eu
cd "$(dirname "$0")/.."

make=${MAKE:-make}
work=build/deb
root=$work/root
# 0.2.0~dev comes before 0.2.0
version=$(sed -n 's/^#define CLN_VERSION "\(.*\)"/\1/p' include/cl_nascent.h | tr - '~')-1local1
arch=$(dpkg --print-architecture)
maintainer="${DEBFULLNAME:-cl-nascent developers} <${DEBEMAIL:-cl-nascent@packages.invalid}>"
# the newest file's date, so that the same sources give the same package
SOURCE_DATE_EPOCH=${SOURCE_DATE_EPOCH:-$(git log -1 --format=%ct 2>/dev/null || echo 1767225600)}
export SOURCE_DATE_EPOCH
date=$(LC_ALL=C date -u -R -d "@$SOURCE_DATE_EPOCH")

rm -rf "$work"
mkdir -p "$root/DEBIAN" "$work/debian"
"$make" --no-print-directory install DESTDIR="$root" PREFIX=/usr \
    ZSHDIR=/usr/share/zsh/vendor-completions >/dev/null
rm -r "$root/usr/include" "$root/usr/lib" "$root/usr/share/doc/cl-nascent/examples" \
    "$root/usr/share/doc/cl-nascent/docs/api.md" "$root/usr/share/doc/cl-nascent/"*.md \
    "$root/usr/share/doc/cl-nascent/LICENSE" "$root/usr/share/doc/cl-nascent/docs/captures.jpg"
# others' photos, under licences of their own, stay with the sources
sed -i 's|^!\[[^]]*\](captures.jpg)$|(The picture is docs/captures.jpg of the sources.)|' \
    "$root/usr/share/doc/cl-nascent/docs/results.md"
strip --remove-section=.comment --remove-section=.note "$root/usr/bin/cl-nascent"
gzip -9n "$root"/usr/share/man/man1/cl-nascent*.1

doc=$root/usr/share/doc/cl-nascent
{
    echo "Format: https://www.debian.org/doc/packaging-manuals/copyright-format/1.0/"
    echo "Upstream-Name: cl-nascent"
    echo
    echo "Files: *"
    echo "Copyright: $(sed -n 's/^Copyright (c) //p' LICENSE)"
    echo "License: Expat"
    sed '1,/^Copyright/d; /./,$!d; s/^$/./; s/^/ /' LICENSE
    echo "Comment:"
    echo " The program has stb_image and stb_image_write in it (Copyright 2017 Sean Barrett), which"
    echo " are under the same licence, Expat, or in the public domain, as one chooses."
} >"$doc/copyright"
gzip -9nc CHANGELOG.md >"$doc/changelog.gz"
printf 'cl-nascent (%s) unstable; urgency=medium\n\n  * As in changelog.gz.\n\n -- %s  %s\n' \
    "$version" "$maintainer" "$date" | gzip -9n >"$doc/changelog.Debian.gz"

# dpkg-shlibdeps needs a debian/control beside it
printf 'Source: cl-nascent\n\nPackage: cl-nascent\nArchitecture: any\n' >"$work/debian/control"
depends=$(cd "$work" && dpkg-shlibdeps -O root/usr/bin/cl-nascent 2>/dev/null |
    sed -n 's/^shlibs:Depends=//p')
cat >"$root/DEBIAN/control" <<END
Package: cl-nascent
Version: $version
Architecture: $arch
Maintainer: $maintainer
Installed-Size: $(du -sk --exclude=DEBIAN "$root" | cut -f1)
Depends: $depends
Recommends: opencl-icd
Suggests: colmap, ffmpeg
Section: graphics
Priority: optional
Description: views of a scene from anywhere, learnt from posed photos
 Trains a radiance field, an octree of small grids or networks, from photos with
 known poses, and renders it from new points of view, as pictures, films and
 depth, or exports points, meshes and volumes. Runs on any OpenCL device; on
 processors with PoCL (pocl-opencl-icd).
END
(cd "$root" && find usr -type f -print0 | LC_ALL=C sort -z | xargs -0 md5sum) \
    >"$root/DEBIAN/md5sums"
chmod -R u=rwX,go=rX "$root"
dpkg-deb --root-owner-group -Zxz -b "$root" "build/cl-nascent_${version}_$arch.deb" >/dev/null
echo "build/cl-nascent_${version}_$arch.deb"
