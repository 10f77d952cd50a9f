#!/bin/sh
# Makes sure that everything `make demo` and `make test` need is there.
#
# On Debian and its kin the missing packages are installed when root, and named when not.
# Rust itself is never downloaded: its absence is an error that says what is needed.
set -eu

need_rust=1.89

say() { printf 'setup: %s\n' "$*"; }
fail() { printf 'setup: %s\n' "$*" >&2; exit 1; }

rust=$(rustc --version 2>/dev/null | cut -d ' ' -f 2 || true)
[ -n "$rust" ] && command -v cargo >/dev/null ||
    fail "no Rust toolchain found; install Rust $need_rust or later (https://rustup.rs)"
oldest=$(printf '%s\n%s\n' "$need_rust" "${rust%%-*}" | sort -V | head -n 1)
[ "$oldest" = "$need_rust" ] || fail "Rust $rust is too old; $need_rust or later is needed"

# command or file that proves it | Debian package
missing=
want() {
    case $1 in
        /*) for f in $1; do [ -e "$f" ] && return 0; done ;;
        *) command -v "$1" >/dev/null && return 0 ;;
    esac
    missing="$missing $2"
}
want cc gcc
want c++ g++
want ld binutils
want make make
want cmake cmake
want pkg-config pkg-config
want python3 python3
# The Python package and its tests. The modules may also come from elsewhere, e.g. from pip.
want_module() {
    python3 -c "import $1" 2>/dev/null || [ -e "/usr/lib/python3/dist-packages/$1" ] || missing="$missing $2"
}
want_module numpy python3-numpy
want_module pytest python3-pytest
want_module ensurepip python3-venv
want '/usr/include/embree[34]/rtcore.h' libembree-dev
# The oracle of the header test is two compilers, not one.
want clang clang

# The tests of the Python package run in an environment of their own, with packages that Debian does not have.
finish() {
    sh "$(dirname "$0")/../bindings/python/tests/venv.sh" >/dev/null
    exit
}
[ -n "$missing" ] || { say "all there (Rust $rust)"; finish; }
if command -v apt-get >/dev/null && [ "$(id -u)" = 0 ]; then
    say "installing$missing"
    export DEBIAN_FRONTEND=noninteractive
    # shellcheck disable=SC2086 # a list of packages
    apt-get install -y -qq --no-install-recommends $missing ||
        { apt-get update -qq && apt-get install -y -qq --no-install-recommends $missing; }
else
    fail "please install:$missing (Debian: sudo apt-get install$missing)"
fi
finish
