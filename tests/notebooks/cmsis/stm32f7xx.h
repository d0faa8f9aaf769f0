/* What the C of the notebooks needs of CMSIS-Core and the device header, as declarations. */
#ifndef STM32F7XX_H
#define STM32F7XX_H

#include <stdint.h>

void SCB_CleanDCache_by_Addr(volatile void *addr, int32_t dsize);
void SCB_InvalidateDCache_by_Addr(volatile void *addr, int32_t dsize);
void SCB_CleanInvalidateDCache_by_Addr(volatile void *addr, int32_t dsize);

#endif
