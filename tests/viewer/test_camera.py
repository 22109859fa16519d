"""What of the floor is clicked, against a projection by hand."""

import math

import numpy as np
import pytest

viser = pytest.importorskip("viser", reason="the page is not tested: install 'ballbot-rs[view]'")

from ballbot_rs.viewer.scene.cameras import screen_ray  # noqa: E402
from ballbot_rs.viewer.scene.ground import ray_meets  # noqa: E402

EYE, FOV, ASPECT = np.array([1.0, -2.0, 1.5]), 0.9, 1.6


def attitude(look_at):
    """Columns: right, down, and the direction of view."""
    forward = (look_at - EYE) / np.linalg.norm(look_at - EYE)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    return np.stack([right, np.cross(forward, right), forward], axis=1)


def floor_point(eye, attitude, fov, aspect, screen):
    return ray_meets(None, eye, screen_ray(attitude, fov, aspect, screen))


def wxyz(rotation):
    return viser.transforms.SO3.from_matrix(rotation).wxyz


@pytest.mark.parametrize("point", [(0.0, 0.0), (0.7, 0.4), (-1.5, 2.0), (1.0, -0.5)])
def test_a_point_of_the_floor_is_found_where_it_is_seen(point):
    rotation = attitude(np.array([0.2, 0.1, 0.0]))
    x, y, depth = rotation.T @ (np.array([*point, 0.0]) - EYE)
    half = math.tan(0.5 * FOV)
    screen = (0.5 + 0.5 * x / (depth * half * ASPECT), 0.5 + 0.5 * y / (depth * half))
    np.testing.assert_allclose(floor_point(EYE, wxyz(rotation), FOV, ASPECT, screen), point, atol=1e-9)


def test_above_the_horizon_and_below_the_floor_there_is_none():
    level = attitude(EYE + np.array([0.0, 1.0, 0.0]))
    assert floor_point(EYE, wxyz(level), FOV, ASPECT, (0.5, 0.5)) is None
    assert floor_point(EYE, wxyz(level), FOV, ASPECT, (0.5, 0.1)) is None
    assert floor_point(EYE, wxyz(level), FOV, ASPECT, (0.5, 0.9)) is not None
    assert floor_point(EYE * [1, 1, -1], wxyz(level), FOV, ASPECT, (0.5, 0.9)) is None
