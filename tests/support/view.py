"""A page that is served, and clients that are no browsers."""

import msgspec

from tests.support.waiting import wait_until

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


def ask(view, function):
    """What a function says of the session, in the thread that owns it."""
    answers = []
    assert view.runner.submit(lambda session: answers.append(function(session)))
    wait_until(lambda: answers)
    return answers[0]
