"""Robots tossed among random obstacles: `python -m validation.obstacle_tosses [TIME_STEP [COUNT]]`.

Prints how much energy robots without torque gain, and how deep balls enter obstacles that are taller than they are.
"""

import sys

import numpy as np
import numpy.typing as npt

import ballbot_rs as bb

Random = np.random.Generator

#: Simulated time of a toss, s.
SECONDS = 1.5


def obstacle(random: Random, unit: float) -> dict[str, float | str]:
    """An obstacle 6 to 12 ball radii from the origin."""
    angle, distance = random.uniform(-np.pi, np.pi), unit * random.uniform(6.0, 12.0)
    common = {
        "x": distance * np.cos(angle),
        "y": distance * np.sin(angle),
        "friction": random.choice([0.0, 0.3, 1.0, 10.0]),
    }
    common["restitution"] = random.choice([0.0, 0.0, 0.3, 0.5])
    kind = random.choice(["post", "box", "wall"])
    if kind == "wall":
        # It looks about to the origin.
        yaw = angle + random.uniform(-0.3, 0.3)
        return {"kind": kind, "yaw": (yaw + 2.0 * np.pi) % (2.0 * np.pi) - np.pi, **common}
    common["height"] = random.choice([0.01, 0.2 * unit, unit, 5.0 * unit, 2.0])
    if kind == "post":
        return {"kind": kind, "radius": random.choice([1e-3, 0.01, unit]), **common}
    sides = {"length": 3.0 * unit, "width": random.choice([1e-3, unit]), "yaw": random.uniform(-np.pi, np.pi)}
    return {"kind": kind, **sides, **common}


def toss(preset: str, seed: int, sim_dt: float) -> tuple[float, float, int] | None:
    """Gain of energy over the first energy, depth of the ball, m, and unsolved steps of a toss.

    None if an obstacle is where the robot starts.
    """
    random = np.random.default_rng(seed)
    params = bb.Params.preset(preset)
    radius = params.ball_radius
    obstacles = [obstacle(random, radius) for _ in range(6)]
    tall = [one for one in obstacles if float(one.get("height", np.inf)) > 1.5]
    walls = bb.Terrain.plane(0.0).with_obstacles(tall)
    angle, speed = random.uniform(0.0, 2.0 * np.pi), random.uniform(0.0, 4.0)
    tilted = bb.State.at_rest(params, tilt=0.3 * random.normal(size=2))
    rate: npt.NDArray[np.float64] = 2.0 * random.normal(size=3)
    velocity = (speed * np.cos(angle), speed * np.sin(angle))
    start = bb.State.rolling(params, velocity, body_quaternion=tilted.body_quaternion, body_angular_velocity=rate)
    try:
        robot = bb.Ballbot(params, terrain=bb.Terrain.plane(0.0).with_obstacles(obstacles), sim_dt=sim_dt)
        robot.reset(start)
    except ValueError:
        return None
    first = robot.energy
    gain = depth = 0.0
    for _ in range(round(SECONDS / sim_dt)):
        robot.step([0.0, 0.0, 0.0])
        gain = max(gain, (robot.energy - first) / abs(first))
        x, y, _ = robot.state.ball_position
        depth = max(depth, radius - float(walls.obstacle_distance(x, y)))
    return gain, depth, robot.contacts.unsolved_steps


def main(sim_dt: float = 1e-3, count: int = 200) -> None:
    """Prints the worst of `count` tosses of each preset."""
    all_of_them = ((preset, seed) for preset in bb.Params.preset_names() for seed in range(count))
    found = [(*result, *one) for one in all_of_them if (result := toss(*one, sim_dt)) is not None]
    gains = np.array([one[0] for one in found])
    depths = np.array([one[1] for one in found if one[2] == 0])
    print(f"{len(found)} tosses at {1e3 * sim_dt:g} ms; {sum(one[2] > 0 for one in found)} have unsolved steps")
    worst = found[int(gains.argmax())][3:]
    print(f"energy: {np.sum(gains > 0.01)} gain more than 1 %, at most {100.0 * gains.max():.1f} %, {worst}")
    print(f"balls in obstacles: {np.sum(depths > 1e-3)} more than 1 mm, at most {1e3 * depths.max():.2f} mm")
    unsolved = max([one[1] for one in found if one[2] > 0], default=0.0)
    print(f"with unsolved steps: at most {1e3 * unsolved:.2f} mm")


if __name__ == "__main__":
    main(*(kind(text) for kind, text in zip((float, int), sys.argv[1:], strict=False)))
