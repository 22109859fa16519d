"""Robots that bump into each other, which laws recover, and a picture of them."""

import sys

import matplotlib.image
import numpy as np

import ballbot_rs as bb

seconds = float(sys.argv[1]) if len(sys.argv) > 1 else 4.0
names = ["paper", "kugle", "rezero"]
crowd = bb.Crowd(names, positions=[(-0.5, 0.0), (0.1, 0.05), (0.7, -0.05)], friction=0.3)
laws = [bb.Lqr(params, control_dt=0.01) for params in crowd.params]
places = [state.ball_position[:2] for state in crowd.states]
# One camera for all: pixels show whatever is nearest.
camera = {"target": (0.1, 0.0, 0.5), "distance": 4.0, "azimuth": -1.2, "elevation": 0.25, "follows": False}
renderers = [bb.Renderer(name, width=640, height=400, samples=4, camera=camera) for name in names]

crowd.push(0, (3.0, 0.0, 0.0))
hardest, picture = 0.0, np.zeros(0)
for _ in range(round(seconds / 0.01)):
    torques = [law(state, position=place) for law, state, place in zip(laws, crowd.states, places, strict=True)]
    for _ in range(10):
        crowd.step(torques)
        force = np.linalg.norm(crowd.force_between(0, 1))
        if force > hardest:
            hardest = float(force)
            print(f"{crowd.time:.3f} s: {names[0]} hits {names[1]} with {force:.0f} N")
            seen = list(zip(renderers, crowd.states, strict=True))
            nearest = np.argmin([renderer.depth(state) for renderer, state in seen], axis=0)
            picture = np.choose(nearest[..., None], [renderer.render(state) for renderer, state in seen])
matplotlib.image.imsave("crowd.png", picture)
for name, state in zip(names, crowd.states, strict=True):
    x, y, _ = state.ball_position
    print(f"{name:8} tilt {np.degrees(state.tilt):.1f} deg at ({x:.2f}, {y:.2f}) m")
