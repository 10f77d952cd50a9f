#!/bin/sh
# Runs the fuzz targets under AddressSanitizer, with debug assertions and overflow checks: each for so many minutes.
#
#   sh tests/fuzz/run.sh MINUTES [TARGET...]
#
# Builds, corpora and logs go to target/fuzz. Inputs that fail go to tests/fuzz/found, from where `make test` replays
# them. Prints the executions and the covered edges of each target. Fails if an input failed.
set -eu
cd "$(dirname "$0")/../.."

minutes=${1:-1}
[ $# -eq 0 ] || shift
out=$PWD/target/fuzz
toolchain=${FUZZ_TOOLCHAIN:-nightly}
triple=x86_64-unknown-linux-gnu

fail() { printf 'fuzz: %s\n' "$*" >&2; exit 1; }

case $minutes in
    '' | *[!0-9]*) fail "MINUTES is '$minutes'; it must be a whole number" ;;
esac
rustc "+$toolchain" --version >/dev/null 2>&1 ||
    fail "there is no $toolchain toolchain; install it: rustup toolchain install $toolchain"
if ! command -v "$out/tools/bin/cargo-fuzz" >/dev/null; then
    echo "fuzz: installing cargo-fuzz into target/fuzz/tools"
    cargo "+$toolchain" install --quiet --locked --root "$out/tools" cargo-fuzz ||
        fail "cargo-fuzz cannot be installed"
fi

# The manifest's list of targets. cargo-fuzz finds the crate by its folder.
[ $# -gt 0 ] || set -- $(sed -n 's,^path = "fuzz_targets/\(.*\)\.rs"$,\1,p' tests/fuzz/Cargo.toml)
PATH=$out/tools/bin:$PATH cargo "+$toolchain" fuzz build --codegen-units 16 --fuzz-dir tests/fuzz --target-dir "$out/build"

# Input files are in memory where that is possible, and are gone afterwards.
TMPDIR=$(mktemp -d -p /dev/shm outcrop-fuzz.XXXXXX 2>/dev/null || mktemp -d)
export TMPDIR
trap 'rm -rf "$TMPDIR"' EXIT
# A target that asks for more than the system has gets no memory instead of an end.
export ASAN_OPTIONS="allocator_may_return_null=1:detect_leaks=1:${ASAN_OPTIONS:-}"

failed=0
for name in "$@"; do
    bin=$out/build/$triple/release/$name
    corpus=$out/corpus/$name
    found=tests/fuzz/found/$name
    log=$out/$name.log
    mkdir -p "$corpus" "$found"
    OUTCROP_FUZZ_SEEDS=$corpus "$bin" >/dev/null
    words=tests/fuzz/dictionaries/$name.dict
    [ -f "$words" ] && words=-dict=$words || words=
    # shellcheck disable=SC2086 # no word, or one
    if "$bin" $words -max_total_time=$((60 * minutes)) -timeout=60 -report_slow_units=60 -rss_limit_mb=4096 \
        -max_len=16384 -print_final_stats=1 -artifact_prefix="$found/" "$corpus" "$found" >"$log" 2>&1; then
        verdict=clean
    else
        verdict="FAILED, see target/fuzz/$name.log"
        failed=1
    fi
    runs=$(sed -n 's/^stat::number_of_executed_units: *//p' "$log" | tail -n 1)
    edges=$(sed -n 's/.* cov: \([0-9]*\) .*/\1/p' "$log" | tail -n 1)
    printf '%-12s %10s executions %7s edges  %s\n' "$name" "${runs:-?}" "${edges:-?}" "$verdict"
    rmdir "$found" 2>/dev/null || true
done
exit $failed
