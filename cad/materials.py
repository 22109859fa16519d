"""What the parts are made of: density in kg/m³."""

from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True)
class Material:
    """A name for the table and a density."""

    name: str
    density: float


ALUMINIUM: Final = Material("aluminium 6061", 2700.0)
STEEL: Final = Material("steel", 7850.0)
POLYCARBONATE: Final = Material("polycarbonate sheet", 1200.0)
ABS: Final = Material("ABS", 1050.0)
PETG: Final = Material("PETG", 1270.0)
RUBBER: Final = Material("natural rubber, filled", 1150.0)
#: Windings, magnets, steel gears and air: mass over the volume of the envelope.
GEARMOTOR: Final = Material("gearmotor, effective", 2450.0)
