"""Builds of the firmware, each once, and a board."""

import pytest

from validation.firmware import qemu


@pytest.fixture(scope="session")
def built(tmp_path_factory):
    """Builds the firmware with variables of its Makefile, each set of them once; returns the path of the ELF file."""
    if absent := qemu.missing():
        pytest.skip(f"not installed: {', '.join(absent)} (tools/install_firmware_tools.sh)")
    builds = {}

    def build(**options):
        key = tuple(sorted(options.items()))
        if key not in builds:
            builds[key] = qemu.build(tmp_path_factory.mktemp("firmware"), **options)
        return builds[key]

    return build
