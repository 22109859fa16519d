#!/bin/sh
# The page of `ballbot view` is tested in Chromium. Installs it in CI on Debian as root; elsewhere
# prints what is missing, and the tests skip. Never fails.
for browser in chromium chromium-browser google-chrome google-chrome-stable chrome; do
    command -v "$browser" >/dev/null 2>&1 && exit 0
done

# Only for a machine that tests and nothing else: others are asked.
if [ -n "${CI:-}" ] && [ "$(id -u)" = 0 ] && command -v apt-get >/dev/null 2>&1; then
    echo "installing chromium for the tests of the page"
    export DEBIAN_FRONTEND=noninteractive
    # Downloads may hang; what unpacks and configures must not be cut short.
    download() { timeout 240 apt-get install -y -qq --no-install-recommends --download-only chromium; }
    { download || { timeout 120 apt-get update -qq && download; }; } >/dev/null 2>&1 &&
        apt-get install -y -qq --no-install-recommends chromium >/dev/null 2>&1
fi

command -v chromium >/dev/null 2>&1 ||
    echo "no chromium: the page of 'ballbot view' is not tested; on Debian 'apt install chromium'" >&2
exit 0
