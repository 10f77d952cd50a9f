# Writes what depends on the native libraries that rustc says a static link needs.
#
# Script: -DNATIVE_LIBS=file with one line "-lgcc_s -lutil ...", -DSTAGE, -DVERSION, -DLIBDIR, -DINCLUDEDIR.
file(STRINGS "${NATIVE_LIBS}" line LIMIT_COUNT 1)
string(STRIP "${line}" flags)
if(flags STREQUAL "")
  message(FATAL_ERROR "${NATIVE_LIBS} is empty: rustc did not say what a static link needs")
endif()

string(REPLACE " " ";" names "${flags}")
list(TRANSFORM names REPLACE "^-l" "")
file(WRITE "${STAGE}/outcropNativeLibs.cmake" "set(outcrop_NATIVE_LIBS \"${names}\")\n")

# pkg-config finds the prefix from where the file lies, so that the package can be moved.
string(REGEX REPLACE "[^/]+" ".." up "${LIBDIR}/pkgconfig")
set(UP "${up}")
set(NATIVE "${flags}")
configure_file("${CMAKE_CURRENT_LIST_DIR}/outcrop.pc.in" "${STAGE}/outcrop.pc" @ONLY)
