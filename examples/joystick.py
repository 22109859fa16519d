"""Drive a robot on the page by a joystick, or by any other source of velocities."""

import itertools
import math
import sys

import ballbot_rs as bb

SPEED, YAW_RATE, RATE = 0.4, 1.0, 20.0  # m/s, rad/s, Hz


def joystick():
    """Axes forward, left and turn, from -1 to 1, of the first joystick; needs pygame."""
    import pygame

    pygame.init()
    stick = pygame.joystick.Joystick(0)
    while True:
        pygame.event.pump()
        yield -stick.get_axis(1), -stick.get_axis(0), -stick.get_axis(3)


def drive(page, axes):
    """Commands the page at a rate until there are no more axes, then stops the robot."""
    for forward, left, turn in axes:
        speed = SPEED / max(1.0, math.hypot(forward, left))
        page.command(speed * forward, speed * left, yaw_rate=YAW_RATE * turn)
        page.wait(1.0 / RATE)
    page.command(0.0)


if __name__ == "__main__":
    # A number is the number of steps with the stick forward, without a joystick.
    axes = itertools.repeat((1.0, 0.0, 0.0), int(sys.argv[1])) if len(sys.argv) > 1 else joystick()
    with bb.show("lqr", task="velocity") as page:
        print(f"driving at {page.url}, Ctrl-C ends it")
        drive(page, axes)
        print(f"at x = {page.state.ball_position[0]:.2f} m after {page.time:.1f} s")
