"""A page that is served, and clients that are no browsers."""

import time

import msgspec

CAMERA = {
    "type": "ViewerCameraMessage",
    "wxyz": [1.0, 0.0, 0.0, 0.0],
    "position": [1.0, 1.0, 1.0],
    "fov": 1.0,
    "near": 0.1,
    "far": 10.0,
    "aspect": 1.5,
    "look_at": [0, 0, 0],
    "up_direction": [0.0, 0.0, 1.0],
}


def packed(**message):
    return msgspec.msgpack.encode(message)


def wait_until(condition, seconds=30.0):
    ends = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < ends
        time.sleep(0.02)


def ask(view, function, seconds=30.0):
    """What a function says of the session, in the thread that owns it."""
    answers = []
    assert view.runner.submit(lambda session: answers.append(function(session)))
    wait_until(lambda: answers, seconds)
    return answers[0]
