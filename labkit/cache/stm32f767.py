"""The STM32F767's memory map and the two MPU regions of source 1.

Addresses and sizes: source 1, figures 4 and 5 (RM0410). Attributes: the default map of Armv7-M (DUI0646, table 2.12): code
region write-through, SRAM write-back with write-allocate, peripherals device; TCM is never cached (DDI0489 5.9).
"""

from __future__ import annotations

from collections.abc import Sequence

from labkit.cache.memory import DEVICE, TCM, WRITE_BACK, WRITE_THROUGH, Memory, MpuRegion, Region

KIB = 1024

REGIONS = (
    Region("ITCM-RAM", 0x0000_0000, 16 * KIB, TCM, "ITCM 64-bit", dma=False),
    Region("FLASH-ITCM", 0x0020_0000, 2048 * KIB, TCM, "ITCM 64-bit", writable=False, dma=False),
    Region("FLASH-AXIM", 0x0800_0000, 2048 * KIB, WRITE_THROUGH, "AXI/AHB 64-bit", writable=False),
    Region("DTCM-RAM", 0x2000_0000, 128 * KIB, TCM, "DTCM 64-bit"),
    Region("SRAM1", 0x2002_0000, 368 * KIB, WRITE_BACK, "AHB 32-bit"),
    Region("SRAM2", 0x2007_C000, 16 * KIB, WRITE_BACK, "AHB 32-bit"),
    Region("PERIPHERALS", 0x4000_0000, 512 * KIB, DEVICE, "AHB/APB 32-bit"),
)

#: Source 1, figure 6, as configured there with TEX level 0. C = B = 0 makes region 1 strongly ordered, B = 1 region 2 device
#: memory. Region 1 (heap of lwIP) lies at an address at which the STM32F767 has no memory: it protects nothing.
SOURCE1_MPU = (MpuRegion(1, 0x3000_4000, 16 * KIB, tex=0, c=0, b=0, s=0), MpuRegion(2, 0x2007_C000, 512, tex=0, c=0, b=1, s=1))


def stm32f767(mpu: Sequence[MpuRegion] = ()) -> Memory:
    """Memory of an STM32F767, all bytes 0, with these MPU regions over the default map.

    Both flash regions hold their own bytes here, although on the chip they are two views of one flash.
    """
    return Memory(REGIONS, mpu)
