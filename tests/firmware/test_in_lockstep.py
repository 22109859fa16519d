"""The firmware in QEMU drives the simulated robot for a minute, with the torques of this process."""

import pytest

from validation.firmware import episode, qemu

#: Largest difference of a torque, N·m; docs/firmware.md has what was measured.
TOLERANCE = {"double": 1e-6, "float": 1e-5}


@pytest.mark.slow("60 s of simulation in lockstep with QEMU")
@pytest.mark.parametrize("real", TOLERANCE)
@pytest.mark.parametrize("name", episode.CONTROLLERS)
def test_a_robot_drives_for_a_minute_with_our_torques(name, real, built):
    # The simulation may pause for longer than a robot may.
    elf = built(CONTROLLER=episode.CONTROLLERS[name], REAL=real, WATCHDOG_MS=5000)
    run = episode.run(name, qemu.address(elf, "netduinoplus2"), seconds=60.0)
    print(f"{name} in {real}: {run.difference:.1e} N·m, {run.metrics['velocity_error']:.3f} m/s")
    assert run.statuses == {"running": 6000}
    assert run.difference < TOLERANCE[real]
    # It drives: commands are up to 0.5 m/s and 1 rad/s.
    assert run.metrics["velocity_error"] < 0.02
    assert run.metrics["yaw_rate_error"] < 0.05


@pytest.mark.slow("60 s of simulation in lockstep with QEMU")
def test_single_precision_throughout_is_enough_with_coarse_encoders(built):
    options = {"REAL": "float", "ESTIMATOR_REAL": "float", "SENSORS": qemu.COARSE_SENSORS}
    elf = built(CONTROLLER="lqr", WATCHDOG_MS=5000, **options)
    run = episode.run("lqr", qemu.address(elf, "netduinoplus2"), seconds=60.0, sensors=qemu.COARSE_SENSORS)
    print(f"lqr in float throughout: {run.difference:.1e} N·m")
    assert run.statuses == {"running": 6000}
    assert 1e-7 < run.difference < 1e-4


@pytest.mark.slow("runs QEMU")
def test_a_board_with_double_precision_in_hardware_has_our_torques(built):
    elf = built(BOARD="mps2-an500", WATCHDOG_MS=5000)
    run = episode.run("lqr", qemu.address(elf, "mps2-an500"), seconds=5.0)
    assert run.statuses == {"running": 500}
    assert run.difference < TOLERANCE["double"]


def test_the_estimator_of_fine_encoders_in_single_precision_does_not_compile(built):
    with pytest.raises(RuntimeError, match="ballbot_estimator_of_these_sensors_needs_double"):
        built(ESTIMATOR_REAL="float")


def test_a_policy_at_another_rate_does_not_compile(built):
    with pytest.raises(RuntimeError, match="the controller has another rate than the firmware"):
        built(CONTROLLER=episode.POLICY, RATE=200)
