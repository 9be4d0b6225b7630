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

.PHONY: help setup demo test bench bench-peers lint format wheel clean

help:
	@echo "make demo    simulate a small site, register it, show how close the result is to the truth"
	@echo "make test    every test"
	@echo "make setup   .venv with the trihedral command in it"
	@echo "make bench   time each stage beside the nearest library"
	@echo "make bench-peers  the best open programs and ours on the same pairs"
	@echo "make lint    formatting, types, lints, import layers"
	@echo "make wheel   one abi3 wheel in dist/, which installs without Rust"

setup: $(VENV)/.built

# pip is the last thing that venv puts there: without it, an earlier attempt was cut short.
$(BIN)/pip:
	$(patsubst python=%,%,$(TOOLS)) -m venv --clear $(VENV)

$(VENV)/.installed: pyproject.toml constraints.txt | $(BIN)/pip
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --constraint constraints.txt pip maturin
	PIP_CONSTRAINT= $(BIN)/python -m pip install --quiet --disable-pip-version-check --constraint constraints.txt --editable '.[test,lint]'
	@touch $@

$(VENV)/.built: $(VENV)/.installed $(RUST_SOURCES)
	$(BIN)/maturin develop --release --quiet --skip-install
	@touch $@

demo: setup
	$(BIN)/trihedral demo --out demo-out

test: setup
	cargo test --release --quiet -p trihedral-core
	$(BIN)/python -m pytest -n 2 --dist loadfile

bench: setup
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --constraint constraints.txt --requirement benchmarks/requirements.txt
	$(BIN)/python -m benchmarks.stages

bench-peers: setup
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --constraint constraints.txt --requirement benchmarks/requirements.txt
	$(BIN)/python -m benchmarks.peers

lint: setup
	cargo fmt --all --check
	cargo clippy --release --workspace --all-targets --quiet -- -D warnings
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/lint-imports

format: setup
	cargo fmt --all
	$(BIN)/ruff format .
	$(BIN)/ruff check --fix .

wheel: setup
	$(BIN)/maturin build --release --out dist

clean:
	rm -rf $(VENV) target dist demo-out core/fuzz/target
