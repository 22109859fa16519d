"""Units of fitted numbers."""

from ballbot_rs.identification.parameters import known_fields, unit_of

#: Numbers without a unit.
PURE = {
    "strength",
    "roller_friction",
    *(f"{pair}_{kind}_friction" for pair in ("wheel", "floor") for kind in ("static", "dynamic")),
}


def test_every_fitted_number_has_its_unit():
    assert {field for field in known_fields() if not unit_of(field)} == PURE
    assert unit_of("floor_rolling_friction") == unit_of("floor_spinning_friction") == "m"
    assert unit_of("roller_friction_slope") == "s/m"
    assert (unit_of("delay"), unit_of("gyro_bias"), unit_of("body_inertia")) == ("s", "rad/s", "kg·m²")
