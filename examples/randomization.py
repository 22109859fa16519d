"""Sample a robot, a floor and pushes for each episode, and see how much performance each costs a controller."""

import sys

import ballbot_rs as bb

episodes = int(sys.argv[1]) if len(sys.argv) > 1 else 100

friction = {"term": "wheel_dynamic_friction", "range": [0.1, 0.5]}
mass = {"term": "body_mass", "op": "scale", "range": [0.8, 1.2]}
mast = {"term": "body_com_offset", "range": [-0.002, 0.002]}  # m
pushes = {"term": "push", "mode": "interval", "every": [1.0, 3.0], "range": [0.5, 1.5]}  # N·s
delay = {"term": "actuators.delay", "range": [0.0, 0.02]}  # s

batch = bb.Batch(4, events=[friction, mass])
batch.reset()
for term, drawn in batch.draws().items():
    print(term, drawn.round(3))
for name, events in {
    "none": [],
    "friction": [friction],
    "mass": [mass],
    "mast": [mast],
    "pushes": [pushes],
    "delay": [delay],
    "all": [friction, mass, mast, pushes, delay],
}.items():
    results = bb.compare(["lqr", "lqi"], episodes=episodes, events=events, actuators={})
    cells = [f"{one.controller} upright {one.survival_rate:4.0%}, {one.ball_rms:.3f} m off" for one in results]
    print(f"{name:<9}" + "   ".join(cells))
