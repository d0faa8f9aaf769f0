"""From model to board: a scenario as a small FreeRTOS application in C."""

from labkit.kernel.firmware.application import firmware, write_firmware

__all__ = ["firmware", "write_firmware"]
