# One precision in hardware.
CPU := -mcpu=cortex-m4 -mfpu=fpv4-sp-d16
