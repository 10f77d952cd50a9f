#!/bin/sh
# Turns cargo's static library into one that shows nothing but oc_ symbols.
#
# cargo's archive carries the Rust standard library and every dependency with global symbols, so
# that a program with two Rust libraries does not link. Here all of it becomes one object file in
# which everything but the C ABI is local.
#
#   isolate.sh IN.a OUT.a
#
# LD, OBJCOPY and AR may name other tools (GNU binutils or LLVM's of the same names).
set -eu

in=$1
out=$2
ld=${LD:-ld}
objcopy=${OBJCOPY:-objcopy}
ar=${AR:-ar}

work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT INT TERM
object=$work/outcrop.o

# Groups (COMDAT) are resolved now, or the linker of the program would merge ours with others'.
"$ld" -r --force-group-allocation --whole-archive "$in" -o "$object"
# The archive carries bitcode for link-time optimisation that other tools stumble over.
"$objcopy" --strip-debug --remove-section .llvmbc --remove-section .llvmcmd \
    --wildcard --keep-global-symbol='oc_*' "$object"
rm -f "$work/out.a"
"$ar" rcsD "$work/out.a" "$object"
mv "$work/out.a" "$out"
