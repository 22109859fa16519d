"""Uneven ground in MuJoCo: a plane that follows it."""

import numpy as np
import pytest

import ballbot_rs as bb
from ballbot_rs.engines.moving_floor import contact_plane

mujoco = pytest.importorskip("mujoco")


def test_the_plane_touches_ground_and_ball():
    terrain = bb.Terrain.generate("noise", seed=1, slope=0.2)
    robot = bb.Ballbot(terrain=terrain)
    radius = robot.params.ball_radius
    for x, y in [(0.0, 0.0), (1.2, -0.7), (-2.0, 3.0)]:
        robot.place_on_ground(x, y)
        center = robot.state.ball_position
        point, quaternion = contact_plane(terrain, center, radius)
        assert np.linalg.norm(center - point) == pytest.approx(radius, abs=2e-6)
        assert point[2] == pytest.approx(terrain.height(*point[:2]))
        w, u, v, _ = quaternion
        upright = np.array([2 * v * w, -2 * u * w, 1 - 2 * (u * u + v * v)])
        np.testing.assert_allclose(upright, terrain.normal(*point[:2]), atol=1e-12)


def test_a_diverged_state_has_a_plane_too():
    contact_plane(bb.Terrain.generate("noise"), np.full(3, np.nan), 0.1)


@pytest.mark.slow("another engine")
def test_a_regulator_behaves_alike_in_both_engines_on_hills():
    ground = {"kind": "noise", "slope": 0.08, "wavelength": 0.8, "seed": 2}
    options = {"max_episode_steps": 200, "terrain": ground}
    here, there = (bb.compare(["lqr"], episodes=2, seed=7, **options, engine=engine)[0] for engine in (None, "mujoco"))
    assert there.survival_rate == here.survival_rate == 1.0
    assert there.tilt_rms == pytest.approx(here.tilt_rms, rel=0.02)
    assert there.mean_reward == pytest.approx(here.mean_reward, rel=0.02)
