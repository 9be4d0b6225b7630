#!/bin/sh
# Prints python=<interpreter> when everything is there that a build needs, or one line that says what to install.
# An argument is the interpreter to use; without one, the first that is new enough.
for python in ${1:-python3 python3.14 python3.13 python3.12 python3.11} ""; do
  [ -n "$python" ] || break
  version=$("$python" -c 'import sys; print(sys.version.split()[0]); sys.exit(sys.version_info < (3, 11))' \
    2>/dev/null) && break
  found=${found:-$version}
done
cargo=$(cargo --version 2>/dev/null | cut -d' ' -f2)
if [ -z "$python" ]; then
  echo "trihedral needs Python 3.11 or newer${found:+ (found $found)}: install python3," \
    "or name one with make PYTHON=/path/to/python3"
elif ! "$python" -c 'import venv, ensurepip' 2>/dev/null; then
  echo "trihedral needs the venv module of Python $version: install python3-venv"
elif [ -z "$cargo" ]; then
  echo "trihedral needs a Rust toolchain, 1.88 or newer: install it with rustup from https://rustup.rs"
elif [ "$(printf '%s\n' 1.88.0 "$cargo" | sort -V | head -n 1)" != 1.88.0 ]; then
  echo "trihedral needs Rust 1.88 or newer (found $cargo): run rustup update stable"
elif ! command -v cc >/dev/null; then
  echo "trihedral needs a C compiler for Rust to link with: install gcc or clang"
else
  echo "python=$python"
fi
