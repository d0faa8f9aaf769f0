#ifndef SEMPHR_H
#define SEMPHR_H

#include "FreeRTOS.h"

typedef struct QueueDefinition *SemaphoreHandle_t;

SemaphoreHandle_t xSemaphoreCreateMutex(void);
SemaphoreHandle_t xSemaphoreCreateBinary(void);
BaseType_t xSemaphoreTake(SemaphoreHandle_t lock, TickType_t timeout);
BaseType_t xSemaphoreGive(SemaphoreHandle_t lock);
BaseType_t xSemaphoreGiveFromISR(SemaphoreHandle_t lock, BaseType_t *woken);

#endif
