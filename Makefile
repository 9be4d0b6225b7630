# `make demo` and `make test` do all their set-up; see README.md.
.DEFAULT_GOAL := help
SHELL := /bin/bash
.SHELLFLAGS := -eu -o pipefail -c
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
unexport PYTHONPATH VIRTUAL_ENV CONDA_PREFIX

RUST_SOURCES := $(shell find core/src bindings/src -name '*.rs') Cargo.toml Cargo.lock core/Cargo.toml bindings/Cargo.toml

.PHONY: help setup check-tools demo test bench lint format wheel clean

help:
	@echo "make demo    simulate a small site, register it, show how close the result is to the truth"
	@echo "make test    every test"
	@echo "make setup   .venv with the trihedral command in it"
	@echo "make bench   time each stage beside the nearest library"
	@echo "make lint    formatting, types, lints, import layers"
	@echo "make wheel   one abi3 wheel in dist/, which installs without Rust"

check-tools:
	@command -v $(PYTHON) >/dev/null || { echo "trihedral needs Python 3.11 or newer: install python3 (or: make PYTHON=/path/to/python3.11)"; exit 1; }
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { echo "trihedral needs Python 3.11 or newer, found $$($(PYTHON) -V): install it (or: make PYTHON=/path/to/python3.11)"; exit 1; }
	@$(PYTHON) -c 'import venv, ensurepip' 2>/dev/null || { echo "trihedral needs Python's venv module: install python3-venv"; exit 1; }
	@command -v cargo >/dev/null || { echo "trihedral needs a Rust toolchain 1.88 or newer: install rustup, then: rustup install stable"; exit 1; }
	@v=$$(cargo --version | cut -d' ' -f2); [ "$$(printf '%s\n1.88.0\n' "$$v" | sort -V | head -n 1)" = 1.88.0 ] || { echo "trihedral needs Rust 1.88 or newer, found $$v: rustup update stable"; exit 1; }

setup: check-tools $(VENV)/.installed $(VENV)/.built

$(VENV)/.installed: pyproject.toml constraints.txt
	@[ -x $(BIN)/python ] || { $(MAKE) --no-print-directory check-tools; $(PYTHON) -m venv $(VENV); }
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --constraint constraints.txt pip maturin
	PIP_CONSTRAINT= $(BIN)/python -m pip install --quiet --disable-pip-version-check --constraint constraints.txt --editable '.[test,lint]'
	@touch $@ $(VENV)/.built

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
