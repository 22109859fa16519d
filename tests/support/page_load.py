"""Loads a page with clients: `python -m tests.support.page_load [minutes]`.

As many clients as the page accepts, and some more, come and go, look around, click on the floor and pull the robot;
some do not read their messages. The page must keep running, and its memory must not grow. Prints its memory.
"""

import argparse
import concurrent.futures
import contextlib
import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

from websockets.exceptions import WebSocketException

from tests.support.commands import command
from tests.support.view import CAMERA, CLICK, DRAG, connect, packed

#: Concurrent clients; the page accepts 16.
CLIENTS = 20
#: How long a client stays, s.
STAY = 3.0
#: Allowed growth of the page's memory without clients, from the first to the last third of the rounds, MB. The smallest
#: counts: what a round leaves for a moment differs by 90 MB.
GROWTH = 60


def resident(process: int) -> int:
    """Memory of a process, MB."""
    pages = int(Path(f"/proc/{process}/statm").read_text(encoding="ascii").split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") // 10**6


def client(url: str, seed: int) -> bool:
    """One visit; False if the page was full."""
    rng = random.Random(seed)
    reads = rng.random() < 0.8
    ends = time.monotonic() + STAY
    # A client that does not read disconnects slowly.
    with contextlib.suppress(TimeoutError):
        try:
            with connect(url, max_size=None, close_timeout=0.1, open_timeout=60) as page:
                page.send(packed(**CAMERA))
                while time.monotonic() < ends:
                    page.send(packed(**rng.choice([CAMERA, CLICK, DRAG])))
                    with contextlib.suppress(TimeoutError):
                        if reads:
                            page.recv(timeout=0.05)
                    time.sleep(0.02)
        except (WebSocketException, OSError):
            return False
    return True


def main() -> int:
    """Loads a page; 1 if it ended or kept memory."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("minutes", type=float, nargs="?", default=1.0)
    minutes = parser.parse_args().minutes
    port = 18_990
    view = ["view", "--no-open", "--port", port]
    with subprocess.Popen(command(*view), stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True) as page:
        url = f"ws://127.0.0.1:{port}"
        ends = time.monotonic() + 60.0
        while True:
            with contextlib.suppress(OSError, WebSocketException), connect(url, open_timeout=5):
                break
            assert page.poll() is None, page.communicate()[1]
            assert time.monotonic() < ends, "the page did not come"
            time.sleep(0.2)
        alone = resident(page.pid)
        ends = time.monotonic() + 60.0 * minutes
        visits, most = 0, 0
        left: list[int] = []
        with concurrent.futures.ThreadPoolExecutor(CLIENTS) as pool:
            while time.monotonic() < ends or len(left) < 3:
                coming = [pool.submit(client, url, CLIENTS * len(left) + i) for i in range(CLIENTS)]
                time.sleep(0.8 * STAY)
                most = max(most, resident(page.pid))
                visits += sum(visit.result() for visit in coming)
                # The memory of closed pages is returned a second later.
                time.sleep(2.5)
                left.append(resident(page.pid))
                if page.poll() is not None:
                    break
        alive = page.poll() is None
        page.send_signal(signal.SIGINT)
        errors = page.communicate()[1].replace("interrupted\n", "")
    third = -(-len(left) // 3)
    first, last = min(left[:third]), min(left[-third:])
    print(f"{visits} visits in {len(left)} rounds; alive: {alive}")
    print(f"memory, MB: {alone} before, {most} at most; left by a round {min(left)} to {max(left)}, at least")
    print(f"{first} in the first third of the rounds and {last} in the last")
    if errors:
        print(errors, file=sys.stderr)
    return int(not alive or bool(errors) or last > first + GROWTH)


if __name__ == "__main__":
    sys.exit(main())
