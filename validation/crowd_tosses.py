"""Robots tossed at each other: `python -m validation.crowd_tosses [TIME_STEP [COUNT]]`.

Prints how much energy robots without torque gain after their least energy, how deep their balls enter each other, and
how far the forces of two robots on each other are from opposite.
"""

import itertools
import sys

import numpy as np

import ballbot_rs as bb

#: Simulated time of a toss, s.
SECONDS = 1.0


def toss(count: int, seed: int, sim_dt: float) -> tuple[float, float, float, int] | None:
    """Gain of energy, of the first energy, depth of balls, m, relative error of opposite forces, and unsolved steps.

    None if robots overlap where they start.
    """
    random = np.random.default_rng(seed)
    robots = [bb.Params.preset(random.choice(bb.Params.preset_names())) for _ in range(count)]
    radii = np.array([robot.ball_radius for robot in robots])
    spread = 1.2 * (radii.max() + radii.mean()) * np.sqrt(count)
    places = random.uniform(-spread, spread, (count, 2))
    friction, restitution = random.choice([0.0, 0.3, 1.0, 10.0]), random.choice([0.0, 0.0, 0.3, 0.5])
    try:
        crowd = bb.Crowd(robots, places, friction=friction, restitution=restitution, sim_dt=sim_dt)
        states = []
        for robot, place, at_rest in zip(robots, places, crowd.states, strict=True):
            inward = -place * random.uniform(0.0, 6.0)
            tilted = bb.State.at_rest(robot, tilt=0.2 * random.normal(size=2))
            state = bb.State.rolling(
                robot,
                inward,
                body_quaternion=tilted.body_quaternion,
                body_angular_velocity=2.0 * random.normal(size=3),
            )
            shift = at_rest.ball_position - state.ball_position
            states.append(state.replace(ball_position=at_rest.ball_position, body_position=state.body_position + shift))
        crowd.reset(states)
    except ValueError:
        return None
    first = least = crowd.energy.sum()
    gain = depth = unlike = 0.0
    pairs = list(itertools.combinations(range(count), 2))
    torques = np.zeros((count, 3))
    for _ in range(round(SECONDS / sim_dt)):
        crowd.step(torques)
        energy = crowd.energy.sum()
        least = min(least, energy)
        gain = max(gain, (energy - least) / abs(first))
        balls = np.array([state.ball_position for state in crowd.states])
        for i, j in pairs:
            depth = max(depth, radii[i] + radii[j] - float(np.linalg.norm(balls[i] - balls[j])))
            force = crowd.force_between(i, j)
            if force.any():
                error = np.linalg.norm(force + crowd.force_between(j, i)) / np.linalg.norm(force)
                unlike = max(unlike, float(error))
    return gain, depth, unlike, sum(contacts.unsolved_steps for contacts in crowd.contacts)


def main(sim_dt: float = 1e-3, count: int = 100) -> None:
    """Prints the worst of `count` tosses of two robots, and of as many of five."""
    for robots in (2, 5):
        found = [(*result, seed) for seed in range(count) if (result := toss(robots, seed, sim_dt)) is not None]
        gains, depths, unlike = (np.array([one[i] for one in found]) for i in range(3))
        steps = len(found) * robots * round(SECONDS / sim_dt)
        unsolved = sum(one[3] for one in found) / steps
        print(f"{len(found)} tosses of {robots} robots at {1e3 * sim_dt:g} ms; {100.0 * unsolved:.1f} % unsolved steps")
        print(f"energy: {np.sum(gains > 0.01)} gain more than 1 %, at most {100.0 * gains.max():.2f} %,", end=" ")
        print(f"seed {found[int(gains.argmax())][4]}")
        print(f"balls: at most {1e3 * depths.max():.2f} mm in each other, seed {found[int(depths.argmax())][4]}")
        print(f"forces on each other: opposite within {unlike.max():.1e}")


if __name__ == "__main__":
    main(*(kind(text) for kind, text in zip((float, int), sys.argv[1:], strict=False)))
