# Both precisions in hardware.
CPU := -mcpu=cortex-m7 -mfpu=fpv5-d16
