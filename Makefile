# make demo   pictures of an airliner of two million triangles (or of MODEL=file), the first and the last, and a pick
# make test   runs every check
# make contact-sheet   every mesh of the models folder in one picture, target/contact-sheet.png, and a table
# make figures  level of detail on 10 and 40 million triangles: first pictures, bytes, times, a flight in 64 MB (as root it empties the file cache)
# make flights  memory beside the budget over flights in 4 to 256 MiB: 10 million triangles, 300,000 parts, 100,000 instances
# make bench    speed and accuracy of outcrop, Embree, obvhs and parry3d, in some 25 minutes: target/bench/results.jsonl; FULL=1: all benchmarks, far longer
# make charts   draws the results into tests/bench/charts; measures the benchmarks that have no result of this version (some 25 minutes for all);
#               FULL=1: all benchmarks; KEEP=1: uses results of other versions too
# make bench-expect  writes the expected answers of the benchmarks, after an intended change; ONLY=name: of one benchmark
# make fuzz MINUTES=n  runs each fuzz target n minutes under AddressSanitizer (a nightly toolchain is needed); ONLY="names": only these
# make notices writes THIRD_PARTY.txt, the licences of the crates that are linked, after a change of Cargo.lock
# make header generates include/outcrop.h from src/capi
#
# All set themselves up: on a fresh Debian 12 with Rust 1.89 or later nothing else is needed.

CARGO  ?= cargo
CMAKE  ?= cmake
BUILD  := build
PREFIX := $(CURDIR)/$(BUILD)/prefix
# Triangles of the demo's airliner.
TRIANGLES ?= 2000000

.PHONY: help setup test lint unit package examples ctest demo contact-sheet figures flights bench bench-expect charts fuzz header notices clean

help:
	@sed -n 's/^# \(make .*\)/\1/p' Makefile

setup:
	@sh cmake/setup.sh

test: setup lint unit ctest
	@echo "make test: all passed"

lint: setup
	$(CARGO) fmt --all --check
	$(CARGO) clippy --locked --workspace --all-targets -- -D warnings

unit: setup
	$(CARGO) test --locked --workspace

# Installed to one place and moved to another: the package must not depend on its path.
package: setup
	$(CMAKE) -S cmake -B $(BUILD)/package
	$(CMAKE) --build $(BUILD)/package
	rm -rf $(BUILD)/first-prefix $(PREFIX)
	$(CMAKE) --install $(BUILD)/package --prefix $(CURDIR)/$(BUILD)/first-prefix
	mv $(BUILD)/first-prefix $(PREFIX)

examples: package
	$(CMAKE) -S examples_c -B $(BUILD)/examples -DCMAKE_BUILD_TYPE=Release -DCMAKE_PREFIX_PATH=$(PREFIX)
	$(CMAKE) --build $(BUILD)/examples

ctest: examples
	ctest --test-dir $(BUILD)/examples --output-on-failure

demo: examples
	@MODEL="$(MODEL)" TRIANGLES="$(TRIANGLES)" sh examples_c/demo.sh $(BUILD)

contact-sheet: setup
	$(CARGO) test --locked --test files -- --ignored --nocapture contact_sheet::

figures: setup
	$(CARGO) test --locked --release --test pictures -- --ignored --nocapture figures:: --test-threads 1

flights: setup
	$(CARGO) test --locked --release --test flight_memory -- --ignored --nocapture --exact large_flights

# Peers may choose their vector instructions when they are compiled: they get this machine's. outcrop chooses when it runs.
BENCH = RUSTFLAGS="-C target-cpu=native" $(CARGO) run --locked --release -p outcrop-bench --
ALL   = $(if $(FULL),--full)

bench: setup
	$(BENCH) run $(ALL)

charts: setup
	$(BENCH) charts $(ALL) $(if $(KEEP),--keep)

bench-expect: setup
	$(BENCH) expect $(if $(ONLY),--only $(ONLY),--full)

MINUTES ?= 1
fuzz: setup
	@sh tests/fuzz/run.sh $(MINUTES) $(ONLY)

header:
	OUTCROP_WRITE_HEADER=1 $(CARGO) test --locked --test c_abi -- --exact abi_header::header_is_up_to_date

notices:
	OUTCROP_WRITE_NOTICES=1 $(CARGO) test --locked --test house notices

clean:
	rm -rf $(BUILD) target first.png converged.png
