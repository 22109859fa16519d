"""The reference firmware of the folder `firmware` in QEMU: built, linked to a simulated robot, and counted."""
