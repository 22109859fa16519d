"""C headers, compiled and called."""

import ctypes
import re
import subprocess
import tempfile
from pathlib import Path

import numpy as np

import ballbot_rs as bb
from tests.support.paths import ROOT

STRICT = ("-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic")

#: A state from an array of doubles.
READ_STATE = """
static ballbot_state read_state(const double *row)
{
    ballbot_state state;
    int i;
    for (i = 0; i < 4; i++) {
        state.quaternion[i] = (ballbot_real)row[i];
    }
    for (i = 0; i < 3; i++) {
        state.rate[i] = (ballbot_real)row[4 + i];
        state.ball_rate[i] = (ballbot_real)row[11 + i];
        state.wheel_speeds[i] = (ballbot_real)row[14 + i];
    }
    for (i = 0; i < 2; i++) {
        state.ball_position[i] = (ballbot_real)row[7 + i];
        state.ball_velocity[i] = (ballbot_real)row[9 + i];
    }
    return state;
}
"""

#: A controller behind arrays of doubles: one state per row, its setpoint, the torques, the remaining fractions.
CONTROLLER = """
#include "{header}"

static ballbot_controller controller;

void reset(void);
void step(int count, const double *states, const double *setpoints, double *torques, double *shares);
void roll(const double *from, double *to);

{read_state}

void reset(void)
{{
    ballbot_reset(&controller);
}}

void step(int count, const double *states, const double *setpoints, double *torques, double *shares)
{{
    int k, i;
    for (k = 0; k < count; k++) {{
        const double *row = setpoints + 14 * k;
        const ballbot_state state = read_state(states + 17 * k);
        ballbot_setpoint setpoint = {{0}};
        ballbot_real found[3];
        for (i = 0; i < 2; i++) {{
            setpoint.position[i] = (ballbot_real)row[i];
            setpoint.velocity[i] = (ballbot_real)row[2 + i];
            setpoint.tilt[i] = (ballbot_real)row[5 + i];
            setpoint.acceleration[i] = (ballbot_real)row[7 + i];
            setpoint.jerk[i] = (ballbot_real)row[9 + i];
            setpoint.snap[i] = (ballbot_real)row[11 + i];
        }}
        setpoint.yaw = (ballbot_real)row[4];
        setpoint.yaw_rate = (ballbot_real)row[13];
        ballbot_step(&controller, &state, &setpoint, found);
        for (i = 0; i < 3; i++) {{
            torques[3 * k + i] = (double)found[i];
        }}
        shares[2 * k] = (double)controller.last.share;
        shares[2 * k + 1] = (double)controller.last.yaw_share;
    }}
}}

void roll(const double *from, double *to)
{{
    ballbot_state state = read_state(from);
    int i;
    ballbot_roll(&state);
    for (i = 0; i < 3; i++) {{
        to[i] = (double)state.ball_rate[i];
    }}
    to[3] = (double)state.ball_velocity[0];
    to[4] = (double)state.ball_velocity[1];
}}
"""


def compiled(folder, source, flags=()):
    """A library from a C file, compiled without warnings. The folder is new: a path is loaded only once."""
    file = folder / "code.c"
    file.write_text(source, encoding="utf-8")
    library = folder / "code.so"
    command = ["cc", *STRICT, "-O1", *flags, "-shared", "-fPIC", "-o", library, file, "-lm"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, done.stderr
    return ctypes.CDLL(str(library))


def pointer(cells):
    """The address of an array of doubles."""
    assert cells.dtype == np.float64
    assert cells.flags.c_contiguous
    return cells.ctypes.data_as(ctypes.POINTER(ctypes.c_double))


def state_row(state):
    """A state in the format of the C."""
    return np.concatenate(
        (
            state.body_quaternion,
            state.body_angular_velocity,
            state.ball_position[:2],
            state.ball_velocity[:2],
            state.ball_angular_velocity,
            state.wheel_speeds,
        )
    )


class CController:
    """A controller in C."""

    def __init__(self, folder, header, real="double"):
        folder = Path(tempfile.mkdtemp(dir=folder))
        (folder / "controller.h").write_text(header, encoding="utf-8")
        source = CONTROLLER.format(header=folder / "controller.h", read_state=READ_STATE)
        self._library = compiled(folder, source, flags=[f"-DBALLBOT_REAL={real}"])
        self._library.reset()

    def reset(self):
        """Forgets the past."""
        self._library.reset()

    def torques(self, states, setpoints):
        """Torques (n, 3) and fractions (n, 2) of a sequence of states with setpoints (`PLACES`)."""
        rows = np.ascontiguousarray([state_row(state) for state in states])
        targets = np.ascontiguousarray(setpoints, dtype=float)
        torques, shares = np.zeros((len(rows), 3)), np.zeros((len(rows), 2))
        self._library.step(len(rows), pointer(rows), pointer(targets), pointer(torques), pointer(shares))
        return torques, shares

    def rolled(self, state):
        """Rate of the ball (3) and its velocity (2), from attitude, body rate and wheel speeds."""
        row, found = np.ascontiguousarray(state_row(state)), np.zeros(5)
        # The expected result is not given.
        row[7:14] = np.nan
        self._library.roll(pointer(row), pointer(found))
        return found[:3], found[3:]


def random_states(params, rng, count):
    """States of all kinds: near equilibrium or anywhere, rolling or with slipping wheels."""
    states = []
    for i in range(count):
        size = (0.02, 0.3, 1.0)[i % 3]
        # More than half a turn is an error.
        tilt = np.clip(rng.normal(0.0, size, 2), -np.pi, np.pi)
        upright = bb.State.at_equilibrium(params, tilt=tilt, yaw=rng.uniform(-np.pi, np.pi))
        quaternion = upright.body_quaternion if i % 10 else unit(rng.normal(size=4))
        state = bb.State.rolling(params, rng.normal(0.0, size, 2), quaternion, rng.normal(0.0, size, 3), size)
        slip = (0.0, 0.0, 0.3)[i // 3 % 3]
        states.append(
            bb.State(
                [*rng.normal(0.0, 3.0 * size, 2), params.ball_radius],
                state.ball_velocity,
                state.ball_angular_velocity + slip * rng.normal(size=3) / params.ball_radius,
                quaternion,
                state.body_angular_velocity,
                state.wheel_speeds + slip * rng.normal(size=3) / params.wheel_radius,
            )
        )
    return states


def random_setpoints(states, rng):
    """Setpoints (`PLACES`) near the states and far from them, half of them from motions."""
    rows = []
    for i, state in enumerate(states):
        size = (0.02, 0.3, 100.0)[i // 2 % 3]
        place = state.ball_position[:2] + rng.normal(0.0, size, 2)
        held = [*place, *rng.normal(0.0, min(size, 1.0), 2), rng.uniform(-10, 10), *rng.normal(0.0, 0.1, 2)]
        motion = rng.normal(0.0, [0.3, 0.3, 1.0, 1.0, 3.0, 3.0, 1.0]) * (i // 6 % 2)
        rows.append([*held, *motion])
    return np.array(rows)


def unit(vector):
    """A vector of length 1."""
    return np.asarray(vector) / np.linalg.norm(vector)


#: Positions of the parts of a setpoint in a row of the tests.
PLACES = {
    "position": slice(0, 2),
    "velocity": slice(2, 4),
    "yaw": 4,
    "tilt": slice(5, 7),
    "acceleration": slice(7, 9),
    "jerk": slice(9, 11),
    "snap": slice(11, 13),
    "yaw_rate": 13,
}


def own_torques(law, states, setpoints):
    """Torques (n, 3) of a `Controller` for the same sequence."""
    found = []
    for state, row in zip(states, setpoints, strict=True):
        found.append(law(state, **{part: row[PLACES[part]] for part in law.setpoint_parts}))
    return np.array(found)


#: A policy behind arrays of doubles.
POLICY = """
#include "{header}"

static ballbot_policy policy;

void reset(void);
void act(int count, const double *observations, double *actions);
void step(const double *rows, double *torques);
void observe(const double *from, const double *target, double *to);

{read_state}

void reset(void)
{{
    ballbot_policy_reset(&policy);
}}

void act(int count, const double *observations, double *actions)
{{
    enum {{ SIZE = BALLBOT_POLICY_HISTORY * BALLBOT_POLICY_ROWS }};
    int k, i;
    for (k = 0; k < count; k++) {{
        ballbot_real observation[SIZE];
        ballbot_real action[3];
        for (i = 0; i < SIZE; i++) {{
            observation[i] = (ballbot_real)observations[SIZE * k + i];
        }}
#ifdef BALLBOT_POLICY_STATE
        ballbot_policy_act(observation, policy.state, action);
#else
        ballbot_policy_act(observation, action);
#endif
        for (i = 0; i < 3; i++) {{
            actions[3 * k + i] = (double)action[i];
        }}
    }}
}}

void step(const double *rows, double *torques)
{{
    ballbot_real given[BALLBOT_POLICY_ROWS];
    ballbot_real found[3];
    int i;
    for (i = 0; i < BALLBOT_POLICY_ROWS; i++) {{
        given[i] = (ballbot_real)rows[i];
    }}
    ballbot_policy_step(&policy, given, found);
    for (i = 0; i < 3; i++) {{
        torques[i] = (double)found[i];
    }}
}}

void observe(const double *from, const double *target, double *to)
{{
    const ballbot_state state = read_state(from);
    ballbot_setpoint setpoint = {{0}};
    ballbot_real rows[BALLBOT_POLICY_ROWS];
    int i;
    for (i = 0; i < 2; i++) {{
        setpoint.position[i] = (ballbot_real)target[i];
        setpoint.velocity[i] = (ballbot_real)target[2 + i];
    }}
    setpoint.yaw_rate = (ballbot_real)target[4];
    ballbot_policy_observe(&policy, &state, &setpoint, rows);
    for (i = 0; i < BALLBOT_POLICY_ROWS; i++) {{
        to[i] = (double)rows[i];
    }}
}}
"""


class CPolicy:
    """A policy in C."""

    def __init__(self, folder, header, real="double"):
        folder = Path(tempfile.mkdtemp(dir=folder))
        (folder / "policy.h").write_text(header, encoding="utf-8")
        self._rows = int(re.search(r"#define BALLBOT_POLICY_ROWS (\d+)", header)[1])
        source = POLICY.format(header=folder / "policy.h", read_state=READ_STATE)
        self._library = compiled(folder, source, flags=[f"-DBALLBOT_REAL={real}"])
        self._library.reset()

    def reset(self):
        """Forgets the past."""
        self._library.reset()

    def act(self, observations):
        """Actions (n, 3) for observations from the environment; of a recurrent policy one after the other."""
        rows = np.ascontiguousarray(observations, dtype=float)
        actions = np.zeros((len(rows), 3))
        self._library.act(len(rows), pointer(rows), pointer(actions))
        return actions

    def step(self, rows):
        """Torques (3) from rows in their units."""
        given, torques = np.ascontiguousarray(rows, dtype=float), np.zeros(3)
        self._library.step(pointer(given), pointer(torques))
        return torques

    def observe(self, state, position=(0.0, 0.0), velocity=(0.0, 0.0), yaw_rate=0.0):
        """Rows of an observation in their units, from a state and a setpoint."""
        given, target = np.ascontiguousarray(state_row(state)), np.array([*position, *velocity, yaw_rate])
        rows = np.zeros(self._rows)
        self._library.observe(pointer(given), pointer(target), pointer(rows))
        return rows


#: An estimator behind arrays of doubles: a state, readings of gyroscope, accelerometer and wheels, and the results.
ESTIMATOR = """
#include "{header}"

static ballbot_estimator estimator;

void begin(const double *start);
void update(const double *readings, double *out, double *balanced);
void covariance(double *out);

{read_state}

void begin(const double *start)
{{
    const ballbot_state state = read_state(start);
    ballbot_estimator_begin(&estimator, &state);
}}

void update(const double *readings, double *out, double *balanced)
{{
    ballbot_real read[9];
    ballbot_state state;
    int i;
    for (i = 0; i < 9; i++) {{
        read[i] = (ballbot_real)readings[i];
    }}
    ballbot_estimator_update(&estimator, read, read + 3, read + 6, &state);
    for (i = 0; i < 4; i++) {{
        out[i] = (double)state.quaternion[i];
    }}
    for (i = 0; i < 3; i++) {{
        out[4 + i] = (double)state.rate[i];
        out[11 + i] = (double)state.ball_rate[i];
        out[14 + i] = (double)state.wheel_speeds[i];
        out[17 + i] = estimator.slipping[i];
    }}
    for (i = 0; i < 2; i++) {{
        out[7 + i] = (double)state.ball_position[i];
        out[9 + i] = (double)state.ball_velocity[i];
        out[20 + i] = (double)estimator.lean_bias[i];
    }}
    ballbot_estimator_balance(&estimator, &state);
    for (i = 0; i < 4; i++) {{
        balanced[i] = (double)state.quaternion[i];
    }}
}}

void covariance(double *out)
{{
    int i;
    for (i = 0; i < 81; i++) {{
        out[i] = (double)estimator.covariance[i / 9][i % 9];
    }}
}}
"""


class CEstimator:
    """An estimator in C."""

    def __init__(self, folder, header, real="double"):
        folder = Path(tempfile.mkdtemp(dir=folder))
        (folder / "estimator.h").write_text(header, encoding="utf-8")
        source = ESTIMATOR.format(header=folder / "estimator.h", read_state=READ_STATE)
        self._library = compiled(folder, source, flags=[f"-DBALLBOT_REAL={real}"])

    def begin(self, state):
        """Begins in a state."""
        self._library.begin(pointer(np.ascontiguousarray(state_row(state))))

    def update(self, readings):
        """The state's row (17), slipping wheels (3), the lean bias (2), and the balanced attitude (4)."""
        parts = [readings[name] for name in ("gyro", "specific_force", "wheel_rates")]
        read, out, balanced = np.concatenate(parts).astype(float), np.zeros(22), np.zeros(4)
        self._library.update(pointer(read), pointer(out), pointer(balanced))
        return out[:17], out[17:20], out[20:], balanced

    def covariance(self):
        """The covariance of its nine errors, shape (9, 9)."""
        out = np.zeros(81)
        self._library.covariance(pointer(out))
        return out.reshape(9, 9)


#: A supervisor behind arrays of doubles: a state, whether it is fresh, and torques, which it replaces; then its memory.
SUPERVISOR = """
#include "{header}"

static ballbot_supervisor supervisor;

void reset(void);
int supervise(const double *row, int fresh, double *torques, double *memory);

{read_state}

void reset(void)
{{
    static const ballbot_supervisor cold = {{{{0}}, {{0}}, 0, 0, 0, 0}};
    supervisor = cold;
    ballbot_supervisor_reset(&supervisor);
}}

int supervise(const double *row, int fresh, double *torques, double *memory)
{{
    const ballbot_state state = read_state(row);
    ballbot_real given[3];
    int status, i;
    for (i = 0; i < 3; i++) {{
        given[i] = (ballbot_real)torques[i];
    }}
    status = ballbot_supervise(&supervisor, &state, fresh, given);
    for (i = 0; i < 3; i++) {{
        torques[i] = (double)given[i];
        memory[i] = (double)supervisor.heat[i];
    }}
    memory[3] = (double)supervisor.share;
    return status;
}}
"""


class CSupervisor:
    """A supervisor in C."""

    def __init__(self, folder, header, real="double"):
        folder = Path(tempfile.mkdtemp(dir=folder))
        (folder / "supervisor.h").write_text(header, encoding="utf-8")
        source = SUPERVISOR.format(header=folder / "supervisor.h", read_state=READ_STATE)
        self._library = compiled(folder, source, flags=[f"-DBALLBOT_REAL={real}"])
        self._library.reset()

    def reset(self):
        """Begins with cold motors."""
        self._library.reset()

    def supervise(self, row, torques, fresh=True):
        """The status, torques (3), heat (3) and share after a state's row (17) and the controller's torques."""
        given, found, memory = np.array(row, dtype=float), np.array(torques, dtype=float), np.zeros(4)
        status = self._library.supervise(pointer(given), int(fresh), pointer(found), pointer(memory))
        return status, found, memory[:3], memory[3]
