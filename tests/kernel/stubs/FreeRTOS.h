/* Prototypes only, in the shape of FreeRTOS's documented interface: enough to compile an application against, nothing to link. */
#ifndef FREERTOS_H
#define FREERTOS_H
#include <stddef.h>
#include <stdint.h>
#define TICK_TYPE_WIDTH_32_BITS 1
#include "FreeRTOSConfig.h"

typedef long BaseType_t;
typedef unsigned long UBaseType_t;
typedef uint32_t TickType_t;
#define pdFALSE ((BaseType_t) 0)
#define pdTRUE ((BaseType_t) 1)
#define pdFAIL pdFALSE
#define pdPASS pdTRUE
#define portMAX_DELAY ((TickType_t) 0xffffffffUL)

#if configUSE_TICK_HOOK != 1 || configMAX_PRIORITIES < 2 || configTICK_RATE_HZ < 1
#error "the configuration is not what the application needs"
#endif
#endif
