#!/bin/sh
# The README names the native libraries of a static link; here is whether rustc and pkg-config say the same.
#
#   check_native_libs.sh PACKAGE_CMAKE_DIR README.md
set -eu
from_rustc=$(sed -n 's/^set(outcrop_NATIVE_LIBS "\(.*\)")$/\1/p' "$1/outcropNativeLibs.cmake" |
    sed 's/;/ -l/g; s/^/-l/')
from_pc=$(sed -n 's/^Libs.private: -Wl,--gc-sections //p' "$1/../../pkgconfig/outcrop.pc")
from_readme=$(grep -o -- '-lgcc_s[-a-z_ ]*' "$2" | head -n 1 | sed 's/ *$//')
echo "rustc:      $from_rustc"
echo "pkg-config: $from_pc"
echo "README:     $from_readme"
[ -n "$from_rustc" ] && [ "$from_rustc" = "$from_pc" ] && [ "$from_rustc" = "$from_readme" ]
