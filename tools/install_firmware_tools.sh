#!/bin/sh
# The firmware is tested in QEMU. Installs QEMU and the compiler in CI on Debian as root; elsewhere prints what is
# missing, and the tests skip. Never fails.
PACKAGES="qemu-system-arm gcc-arm-none-eabi libnewlib-arm-none-eabi"

are_installed() { command -v qemu-system-arm >/dev/null 2>&1 && command -v arm-none-eabi-gcc >/dev/null 2>&1; }

are_installed && exit 0

# Only for a machine that tests and nothing else: others are asked.
if [ -n "${CI:-}" ] && [ "$(id -u)" = 0 ] && command -v apt-get >/dev/null 2>&1; then
    echo "installing $PACKAGES for the tests of the firmware"
    export DEBIAN_FRONTEND=noninteractive
    # Downloads may hang; what unpacks and configures must not be cut short.
    download() { timeout 400 apt-get install -y -qq --no-install-recommends --download-only $PACKAGES; }
    { download || { timeout 120 apt-get update -qq && download; }; } >/dev/null 2>&1 &&
        apt-get install -y -qq --no-install-recommends $PACKAGES >/dev/null 2>&1
fi

are_installed || echo "the firmware is not tested; on Debian 'apt install $PACKAGES'" >&2
exit 0
