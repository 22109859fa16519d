"""A served page, and clients that are not browsers."""

import functools
import importlib.metadata

import msgspec
import websockets.sync.client

from tests.support.waiting import wait_until

CAMERA = {
    "type": "ViewerCameraMessage",
    "wxyz": [1.0, 0.0, 0.0, 0.0],
    "position": [1.0, 1.0, 1.0],
    "fov": 1.0,
    "near": 0.1,
    "far": 10.0,
    "image_height": 400,
    "image_width": 600,
    "look_at": [0, 0, 0],
    "up_direction": [0.0, 0.0, 1.0],
}

CLICK = {
    "type": "SceneNodeClickMessage",
    "name": "/sheet",
    "instance_index": None,
    "ray_origin": [0.0, 0.0, 0.0],
    "ray_direction": [1.0, 0.0, 0.0],
    "screen_pos": [0.5, 0.9],
}
DRAG = {
    "type": "SceneNodeDragMessage",
    "phase": "update",
    "name": "/world/robot_0_0/body/piece_0",
    "start_position": [0.0, 0.0, 0.3],
    "start_screen_pos": [0.5, 0.4],
    "end_position": [0.1, 0.0, 0.3],
    "end_screen_pos": [0.6, 0.4],
    "button": "left",
}

#: The subprotocol, which the page of another version would not request.
PROTOCOL = f"viser-v{importlib.metadata.version('viser')}"
connect = functools.partial(websockets.sync.client.connect, subprotocols=[PROTOCOL])


def packed(**message):
    return msgspec.msgpack.encode(message)


def query(view, function):
    """The result of a function of the session, in the thread that owns it."""
    answers = []
    assert view.runner.submit(lambda session: answers.append(function(session)))
    wait_until(lambda: answers)
    return answers[0]
