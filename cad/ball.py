"""The ball: a hollow shell under a skin, centered on the origin."""

import cadquery as cq

from cad.materials import PETG, RUBBER
from cad.parameters import BALL
from cad.part import Part, part


def ball() -> list[Part]:
    """Parts of the ball: skin and shell."""
    outer, middle = BALL.radius, BALL.radius - BALL.skin
    inner = middle - BALL.shell

    def sphere(radius: float) -> cq.Workplane:
        return cq.Workplane("XY").sphere(radius)

    return [
        part("skin", "ball", RUBBER, sphere(outer).cut(sphere(middle))),
        part("shell", "ball_shell", PETG, sphere(middle).cut(sphere(inner))),
    ]
