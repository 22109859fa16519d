"""Solids with materials, and their mass properties."""

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace

import cadquery as cq
import numpy as np
import numpy.typing as npt
from OCP.BRepGProp import BRepGProp
from OCP.GProp import GProp_GProps

from cad.materials import Material
from cad.parameters import BALL, WHEEL

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Part:
    """A solid in the frame of its link. Parts of one `mesh` share a material, a color and an STL file."""

    name: str
    mesh: str
    material: Material
    solid: cq.Shape

    def moved(self, location: cq.Location) -> "Part":
        """The part moved by a location."""
        return replace(self, solid=self.solid.moved(location))


@dataclass(frozen=True)
class Mass:
    """Mass (kg), center of mass (m) and inertia about it (kg·m²)."""

    mass: float
    center: Array
    inertia: Array


def part(name: str, mesh: str, material: Material, work: cq.Workplane) -> Part:
    """Part of the only solid of a workplane."""
    solids = work.solids().vals()
    if len(solids) != 1:
        raise ValueError(f"{name} is {len(solids)} solids, expected 1")
    return Part(name, mesh, material, solids[0])


def mass_of(parts: Iterable[Part]) -> Mass:
    """Mass properties of all parts together."""
    found = []
    for each in parts:
        properties = GProp_GProps()
        BRepGProp.VolumeProperties_s(each.solid.wrapped, properties)
        at, matrix = properties.CentreOfMass(), properties.MatrixOfInertia()
        inertia = np.array([[matrix.Value(i, j) for j in (1, 2, 3)] for i in (1, 2, 3)])
        density = each.material.density
        center = np.array([at.X(), at.Y(), at.Z()]) * 1e-3
        found.append(Mass(properties.Mass() * 1e-9 * density, center, inertia * 1e-15 * density))
    return combined(found)


def combined(masses: Iterable[Mass]) -> Mass:
    """Mass properties of several parts as one rigid body."""
    masses = list(masses)
    total = sum(m.mass for m in masses)
    center = sum((m.mass * m.center for m in masses), np.zeros(3)) / total
    inertia = np.zeros((3, 3))
    for m in masses:
        d = m.center - center
        inertia += m.inertia + m.mass * (d @ d * np.eye(3) - np.outer(d, d))
    return Mass(total, center, inertia)


def wheel_location(azimuth: float) -> cq.Location:
    """The wheel frame in the body frame: x towards the ball center, y along the drive direction, z along the axle."""
    a, b = math.radians(WHEEL.zenith), math.radians(azimuth)
    towards = (math.sin(a) * math.cos(b), math.sin(a) * math.sin(b), math.cos(a))
    axle = (math.cos(a) * math.cos(b), math.cos(a) * math.sin(b), -math.sin(a))
    reach = BALL.radius + WHEEL.radius
    origin = tuple(reach * x for x in towards)
    return cq.Location(cq.Plane(origin=origin, xDir=tuple(-x for x in towards), normal=axle))


def turned(azimuth: float) -> cq.Location:
    """Rotation about the mast by an azimuth (deg)."""
    return cq.Location(cq.Vector(), cq.Vector(0.0, 0.0, 1.0), azimuth)
