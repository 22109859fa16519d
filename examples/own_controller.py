"""Your own controller, compared with a controller of the package: LQR from the linear model, in NumPy."""

import sys

import numpy as np

import ballbot_rs as bb


class MyLqr:
    """Also `ballbot record --controller examples/own_controller.py:MyLqr`."""

    def __init__(self, robot, control_dt):
        a, b = bb.LinearModel(robot).discretize(control_dt)
        q = np.diag([4, 4, 40, 40, 4, 1, 1, 4, 4, 1])  # x, y, tilt, yaw and their rates
        p = q
        for _ in range(2000):  # Riccati recursion
            self.gain = np.linalg.solve(100 * np.eye(3) + b.T @ p @ b, b.T @ p @ a)
            p = q + a.T @ p @ (a - b @ self.gain)
        self.lqr = bb.Lqr(robot, control_dt)  # only for the coordinates of the linear model

    def __call__(self, state, position, yaw):
        return -self.gain @ self.lqr.deviation(state, position=position, yaw=yaw)


if __name__ == "__main__":
    episodes = int(sys.argv[1]) if len(sys.argv) > 1 else 50
    for result in bb.compare([MyLqr, "lqr", "pid"], episodes=episodes):
        print(f"{result.controller:<6} success {result.success_rate:.0%}, settled after {result.settling_time:.2f} s")
