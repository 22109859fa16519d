"""Materials of the parts, with densities in kg/m³."""

from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True)
class Material:
    """Name and density (kg/m³) of a material."""

    name: str
    density: float


ALUMINIUM: Final = Material("aluminium 6061", 2700.0)
STEEL: Final = Material("steel", 7850.0)
POLYCARBONATE: Final = Material("polycarbonate sheet", 1200.0)
ABS: Final = Material("ABS", 1050.0)
PETG: Final = Material("PETG", 1270.0)
RUBBER: Final = Material("natural rubber, filled", 1150.0)
#: Effective density: mass of windings, magnets, steel gears and air over the volume of the envelope.
GEARMOTOR: Final = Material("gearmotor, effective", 2450.0)
