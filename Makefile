# `make demo` and `make test` do all their set-up; see README.md.
.DEFAULT_GOAL := help
SHELL := /bin/bash
.SHELLFLAGS := -eu -o pipefail -c
VENV := .venv
BIN := $(VENV)/bin
# Another environment that is active must not leak into ours.
unexport PYTHONPATH PYTHONHOME VIRTUAL_ENV CONDA_PREFIX
# Where rustup puts cargo, for shells that were open before.
export PATH := $(PATH):$(HOME)/.cargo/bin

RUST_SOURCES := $(shell find core/src bindings/src -name '*.rs') Cargo.toml Cargo.lock core/Cargo.toml bindings/Cargo.toml

# The tools that must be there, looked for before anything is begun; what is missing is said in one line.
ifneq ($(filter-out help clean,$(MAKECMDGOALS)),)
TOOLS := $(shell tools/find.sh $(PYTHON))
ifeq ($(filter python=%,$(TOOLS)),)
$(error $(TOOLS))
endif
# The interpreter below the environment may have been removed or upgraded since.
ifneq ($(shell $(BIN)/python -c 'print("runs")' 2>/dev/null),runs)
$(shell rm -f $(BIN)/pip $(VENV)/.installed)
endif
endif

.PHONY: help setup demo test docs coverage bench bench-peers bench-exports bench-real bench-places bench-belief bench-damaged fuzz lint format wheel clean

help:
	@echo "make demo    simulate a small site, register it, show how close the result is to the truth"
	@echo "make test    every test"
	@echo "make docs    figures and an HTML site of all pages"
	@echo "make setup   .venv with the trihedral command in it"
	@echo "make bench   time each stage beside the nearest library"
	@echo "make bench-peers  the best open programs and ours on the same pairs"
	@echo "make bench-exports  the same scans without grid, thinned, cropped, turned, as LAZ and XYZ"
	@echo "make bench-real  real pairs: the best open programs and ours"
	@echo "make bench-belief  evidence of right and wrong poses, and the weights fitted to it"
	@echo "make bench-places  where the scanner stood, found from points of every form"
	@echo "make fuzz    damaged files for all parsers and readers, FUZZ_SECONDS each (60)"
	@echo "make bench-damaged  jobs with one damaged file among four good ones"
	@echo "make coverage  which lines and branches the tests reach, of Python and of Rust"
	@echo "make lint    formatting, types, lints, import layers"
	@echo "make wheel   one abi3 wheel in dist/, which installs without Rust"

setup: $(VENV)/.built

# pip is the last thing that venv puts there: without it, an earlier attempt was cut short.
$(BIN)/pip:
	$(patsubst python=%,%,$(TOOLS)) -m venv --clear $(VENV)

$(VENV)/.installed: pyproject.toml constraints.txt | $(BIN)/pip
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --constraint constraints.txt pip maturin
	PIP_CONSTRAINT= $(BIN)/python -m pip install --quiet --disable-pip-version-check --constraint constraints.txt --editable '.[simulate,test,lint]'
	@touch $@

$(VENV)/.built: $(VENV)/.installed $(RUST_SOURCES)
	$(BIN)/maturin develop --release --quiet --skip-install
	@touch $@

# What an extra of pyproject.toml names, without building the package once more.
$(VENV)/.extra-%: pyproject.toml constraints.txt | $(VENV)/.installed
	$(BIN)/python -c 'import sys, tomllib; print(*tomllib.load(open("pyproject.toml", "rb"))["project"]["optional-dependencies"][sys.argv[1]], sep="\n")' $* > $@.txt
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --constraint constraints.txt --requirement $@.txt
	@touch $@

demo: setup
	$(BIN)/trihedral demo --out demo-out

test: setup
	cargo test --release --quiet -p trihedral-core
	$(BIN)/python -m pytest -n 2 --dist loadfile

# Warnings are errors; links between pages are checked, links to the network are not.
docs: setup $(VENV)/.extra-docs
	$(BIN)/python docs/figures
	rm -rf docs/api build/docs/site
	$(BIN)/python -m sphinx -W --keep-going --quiet -c docs -d build/docs/doctrees . build/docs/site
	@echo "Open $(CURDIR)/build/docs/site/docs/index.html"

# The tests run on a build that counts, in a folder of its own; `make setup` afterwards brings back the fast one.
coverage: export CARGO_TARGET_DIR := $(CURDIR)/build/coverage
coverage: setup $(VENV)/.extra-coverage
	@cargo llvm-cov --version >/dev/null 2>&1 || { echo "make coverage needs cargo-llvm-cov:" \
	  "cargo install cargo-llvm-cov --locked && rustup component add llvm-tools" >&2; exit 2; }
	rm -f .coverage .coverage.* $(VENV)/.built
	cargo llvm-cov clean --workspace
	source <(cargo llvm-cov show-env --sh) && cargo test --release --quiet -p trihedral-core && \
	  $(BIN)/maturin develop --release --quiet --skip-install
	source <(cargo llvm-cov show-env --sh) && status=0 && \
	  { $(BIN)/python -m coverage run -m pytest -n 2 --dist loadfile || status=$$?; } && \
	  $(BIN)/python -m coverage combine --quiet && $(BIN)/python -m coverage report && \
	  cargo llvm-cov report --release --summary-only && exit $$status

bench: setup
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --constraint constraints.txt --requirement benchmarks/requirements.txt
	$(BIN)/python -m benchmarks.stages

bench-peers: setup
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --constraint constraints.txt --requirement benchmarks/requirements.txt
	$(BIN)/python -m benchmarks.peers

bench-exports: setup
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --constraint constraints.txt psutil
	$(BIN)/python -m benchmarks.exports

bench-real: setup
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --constraint constraints.txt --requirement benchmarks/requirements.txt
	$(BIN)/python -m benchmarks.real

bench-belief: setup
	$(BIN)/python -m benchmarks.belief

bench-places: setup
	$(BIN)/python -m benchmarks.places

bench-damaged: setup
	$(BIN)/python -m benchmarks.damaged

# Parsers in Rust under libFuzzer, from the kept corpus, with overflow checks; then readers in Python. What is new goes
# into core/fuzz/found, what fails into core/fuzz/artifacts. The flags let libFuzzer see which code is reached.
FUZZ_SECONDS ?= 60
# Of libFuzzer; 0 is another one every time.
FUZZ_SEED ?= 0
FUZZ_FLAGS := --cfg fuzzing -Cpasses=sancov-module -Cllvm-args=-sanitizer-coverage-level=4 \
  -Cllvm-args=-sanitizer-coverage-inline-8bit-counters -Cllvm-args=-sanitizer-coverage-pc-table \
  -Clink-dead-code -Coverflow-checks -Cdebug-assertions
fuzz: setup
	cd core/fuzz && RUSTFLAGS='$(FUZZ_FLAGS)' cargo build --release --quiet --locked --target $(shell rustc -vV | sed -n 's/^host: //p')
	cd core/fuzz && for target in $$(ls fuzz_targets | sed 's/[.]rs$$//'); do \
	  mkdir -p found/$$target artifacts/$$target corpus/$$target; \
	  dictionary=$$(test -e $$target.dict && echo -dict=$$target.dict || true); \
	  target/*/release/$$target found/$$target corpus/$$target -seed=$(FUZZ_SEED) -max_total_time=$(FUZZ_SECONDS) -max_len=20000 \
	    -timeout=10 -rss_limit_mb=600 -artifact_prefix=artifacts/$$target/ -print_final_stats=1 -verbosity=0 \
	    $$dictionary; done
	cd tests && ../$(BIN)/python -m fuzz --seconds $(FUZZ_SECONDS)

lint: setup
	cargo fmt --all --check
	cargo clippy --release --workspace --all-targets --quiet -- -D warnings
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(BIN)/python -m pip check --quiet --disable-pip-version-check
	cargo metadata --locked --offline --format-version 1 >/dev/null

format: setup
	cargo fmt --all
	$(BIN)/ruff format .
	$(BIN)/ruff check --fix .

wheel: setup
	$(BIN)/maturin build --release --out dist

clean:
	rm -rf $(VENV) target build dist demo-out core/fuzz/target core/fuzz/found docs/api docs/figures/made
