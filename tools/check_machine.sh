#!/bin/sh
# Stops early, with what to do, where the machine lacks something that the build needs.
PYTHON="${PYTHON:-python3}"
# Free disk space that is needed, GB.
DISK="${DISK:-1}"
# Memory that the compiler takes at most, GB, swap included.
COMPILE_MEMORY="${COMPILE_MEMORY:-4}"
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

# Of the machine and of the container, in kB; nothing where neither reports it.
memory=$(awk '/^(MemTotal|SwapTotal):/ { sum += $2 } END { print sum }' /proc/meminfo 2>/dev/null)
container=$(cat /sys/fs/cgroup/memory.max 2>/dev/null)
case "$container" in
    '' | *[!0-9]*) ;;
    *) [ "$((container / 1024))" -lt "${memory:-0}" ] && memory=$((container / 1024)) ;;
esac
if [ -n "$memory" ] && [ "$memory" -lt "$((COMPILE_MEMORY * 1000 * 1000))" ]; then
    missing "$COMPILE_MEMORY GB of memory to compile (found $((memory / 1000 / 1000)) GB with swap); add swap, or set COMPILE_MEMORY to less to try"
fi
free=$(df -Pk . 2>/dev/null | awk 'NR == 2 { print $4 }')
if [ -n "$free" ] && [ "$free" -lt "$((DISK * 1000 * 1000))" ]; then
    missing "$DISK GB of free disk space in $PWD (found $((free / 1000 / 1000)) GB); make room, or clone to another disk"
fi

exit "$failed"
