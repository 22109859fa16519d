"""How long a test waits for another process or thread."""

import time

#: Seconds after which a start, a response or an awaited state counts as missing. Other tests and compilers may occupy
#: every core at the same time.
LIMIT = 120.0


def wait_until(condition):
    ends = time.monotonic() + LIMIT
    while not condition():
        assert time.monotonic() < ends
        time.sleep(0.01)
