#!/bin/sh
# Stops early, with what to do, where the machine lacks something that the build needs.
PYTHON="${PYTHON:-python3}"
failed=0

missing() {
    echo "missing: $1" >&2
    failed=1
}

if ! command -v cargo >/dev/null 2>&1; then
    missing "cargo 1.89 or newer; install Rust with rustup"
else
    minor=$(cargo --version | sed -n 's/^cargo 1\.\([0-9]*\)\..*/\1/p')
    if [ -n "$minor" ] && [ "$minor" -lt 89 ]; then
        missing "cargo 1.89 or newer (found 1.$minor); run 'rustup update'"
    fi
fi

command -v cc >/dev/null 2>&1 || missing "a C compiler named cc; on Debian 'apt install build-essential'"

if ! command -v "$PYTHON" >/dev/null 2>&1; then
    missing "$PYTHON; install Python 3.10 or newer"
elif ! "$PYTHON" -c 'import sys; sys.exit(sys.version_info < (3, 10))'; then
    missing "Python 3.10 or newer ($PYTHON is $("$PYTHON" --version 2>&1)); set PYTHON to another one"
elif ! "$PYTHON" -c 'import ensurepip, venv' 2>/dev/null; then
    missing "Python's venv module; on Debian 'apt install python3-venv'"
fi

exit "$failed"
