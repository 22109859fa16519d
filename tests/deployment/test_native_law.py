"""`NativeLaw`: laws in C through a function pointer."""

import copy
import os
import shutil

import numpy as np
import pytest

import ballbot_rs as bb
from ballbot_rs.deployment import controller_header
from tests.support.c_code import compiled
from tests.support.paths import ROOT

pytestmark = pytest.mark.skipif(shutil.which("cc") is None, reason="needs a C compiler")

#: The program of the documentation.
SOURCE = (
    (ROOT / "docs" / "deployment.md")
    .read_text(encoding="utf-8")
    .partition("```c\n/* law.c */\n")[2]
    .partition("```")[0]
)
DECLARATIONS = """
int law_memory(void);
void law_reset(void *memory);
void law(int count, const ballbot_state *states, const ballbot_setpoint *setpoints, double *torques, void *memory);
"""

COUNTER = """
void count(int n, const double *states, const double *setpoints, double *torques, void *memory);
int count_memory(void);
int negative_memory(void);
void negative(void);
void negative(void) {}
int negative_memory(void) { return -1; }
int count_memory(void) { return sizeof(double); }
void count(int n, const double *states, const double *setpoints, double *torques, void *memory)
{
    int i, k;
    double *calls = memory;
    for (i = 0; i < n; i++) {
        calls[i] += 1.0;
        torques[3 * i] = calls[i];
        torques[3 * i + 1] = 0.0;
        torques[3 * i + 2] = 0.0;
        for (k = 0; k < 17; k++) torques[3 * i + 1] += (k + 1) * states[17 * i + k];
        for (k = 0; k < 14; k++) torques[3 * i + 2] += (k + 1) * setpoints[14 * i + k];
    }
}
"""


@pytest.fixture
def library(tmp_path):
    def build(name, **options):
        (tmp_path / "gains.h").write_text(controller_header(name, "kugle", **options), encoding="ascii")
        source = SOURCE.replace('#include "gains.h"', f'#include "{tmp_path / "gains.h"}"\n{DECLARATIONS}')
        compiled(tmp_path, source)
        return tmp_path / "code.so"

    return build


@pytest.mark.parametrize("name", ["lqr", "lqi"])
def test_an_exported_law_moves_robots_as_the_law_of_the_core(name, library):
    law = bb.NativeLaw(library(name))
    options = {"robot": "kugle", "tilt": (0.05, 0.02), "yaw": 0.4, "reference": {"position": (0.2, 0.1), "yaw": 0.3}}
    found, expected = bb.simulate(law, **options), bb.simulate(name, **options)
    np.testing.assert_allclose(found.to_array(), expected.to_array(), atol=1e-9)
    results = bb.compare([law, name], episodes=5, robot="kugle", max_episode_steps=200)
    assert results[0].tilt_rms == pytest.approx(results[1].tilt_rms, rel=1e-9)
    # Each robot has its own memory, and each episode begins without.
    again = bb.simulate(copy.deepcopy(law), **options)
    np.testing.assert_array_equal(again.to_array(), found.to_array())


def test_states_setpoints_and_memory_arrive(tmp_path):
    compiled(tmp_path, COUNTER)
    law = bb.NativeLaw(tmp_path / "code.so", "count", control_dt=0.02)
    assert (law.name, law.control_dt) == ("count", 0.02)
    state = bb.State.at_equilibrium(bb.Params.paper(), tilt=(0.1, -0.2), yaw=0.3).replace(
        ball_position=[1.0, 2.0, 0.1], ball_velocity=[3.0, 4.0, 0.0], wheel_angles=[50.0, 60.0, 70.0]
    )
    state = state.replace(ball_angular_velocity=[5.0, 6.0, 7.0], body_angular_velocity=[8.0, 9.0, 10.0])
    parts = (state.body_quaternion, [8.0, 9.0, 10.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0], state.wheel_speeds)
    rows = np.array([state.to_array(), 2.0 * state.to_array()])
    setpoint = {"position": (1, 2), "velocity": (3, 4), "acceleration": (6, 7), "jerk": (8, 9), "snap": (10, 11)}
    given = {name: np.array([value, value]) for name, value in {**setpoint, "yaw": 5.0, "yaw_rate": 12.0}.items()}
    torques = law(rows, given)
    expected = np.arange(1, 18) @ np.concatenate(parts)
    assert torques[:, 1] == pytest.approx([expected, 2.0 * expected])
    # Between yaw and acceleration is the tilt.
    assert torques[0, 2] == pytest.approx(np.arange(1, 15) @ [1, 2, 3, 4, 5, 0, 0, 6, 7, 8, 9, 10, 11, 12])
    assert law(rows, {})[:, 0].tolist() == [2.0, 2.0]
    law.reset(np.array([True, False]))
    assert law(rows, {})[:, 0].tolist() == [1.0, 3.0]


def test_bad_input_is_named(tmp_path):
    library = compiled(tmp_path, COUNTER)
    with pytest.raises(ValueError, match=r"code.so has no function 'law'"):
        bb.NativeLaw(library)
    with pytest.raises(ValueError, match=r"negative_memory\(\) returned -1 bytes"):
        bb.NativeLaw(library, "negative")
    with pytest.raises(ValueError, match=r"control_dt = -1\.0 is out of range"):
        bb.NativeLaw(library, "count", -1.0)
    with pytest.raises(OSError, match=r"nowhere\.so"):
        bb.NativeLaw(tmp_path / "nowhere.so")
    os.mkfifo(tmp_path / "pipe.so")
    with pytest.raises(ValueError, match=r"pipe\.so is not a regular file"):
        bb.NativeLaw(tmp_path / "pipe.so")
