#!/bin/sh
# Compiles and runs a program with what pkg-config says, shared and static.
#
#   check_pkg_config.sh PACKAGE_CMAKE_DIR PROGRAM.c
set -eu
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT INT TERM
PKG_CONFIG_PATH=$(cd "$1/../../pkgconfig" && pwd)
export PKG_CONFIG_PATH
lib=$(pkg-config --variable=libdir outcrop)

# shellcheck disable=SC2046 # lists of flags
cc "$2" $(pkg-config --cflags --libs outcrop) -o "$work/shared"
LD_LIBRARY_PATH=$lib "$work/shared"
# shellcheck disable=SC2046
cc -DOC_STATIC "$2" $(pkg-config --cflags outcrop) "$lib/liboutcrop.a" \
    $(pkg-config --libs-only-l --libs-only-other --static outcrop | sed 's/-loutcrop//') -o "$work/static"
"$work/static"
# It has only what it uses: without --gc-sections it would have all of the library, more than 12 MB.
[ "$(wc -c < "$work/static")" -lt 1000000 ]
