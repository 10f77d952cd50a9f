#!/bin/sh
# The package carries the command line, all licences, and a library whose name tells which versions are compatible.
#
#   check_package.sh PACKAGE_CMAKE_DIR
set -eu
PKG_CONFIG_PATH=$(cd "$1/../../pkgconfig" && pwd)
export PKG_CONFIG_PATH
prefix=$(pkg-config --variable=prefix outcrop)
lib=$(pkg-config --variable=libdir outcrop)
version=$(pkg-config --modversion outcrop)

[ "$("$prefix/bin/outcrop" --version)" = "outcrop $version" ]
for file in LICENSE-MIT LICENSE-APACHE THIRD_PARTY.txt; do
    [ -s "$prefix/share/licenses/outcrop/$file" ]
done
soname=liboutcrop.so.${version%.*}
[ "$(readlink "$lib/liboutcrop.so")" = "$soname" ]
[ "$(readlink "$lib/$soname")" = "liboutcrop.so.$version" ]
readelf -d "$lib/$soname" | grep -q "soname: \[$soname\]"
