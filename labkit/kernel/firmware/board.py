"""The fixed parts of the application's files; `{{` and `}}` are braces of C."""

CONFIG_H = """\
/* What the scenario asks of the kernel. Ports add what they need: interrupt priorities, the names of handlers. */
#ifndef FREERTOS_CONFIG_H
#define FREERTOS_CONFIG_H

#define configCPU_CLOCK_HZ                      {cpu_hz}UL
#define configTICK_RATE_HZ                      {tick_hz}
#define configMAX_PRIORITIES                    {priorities}
#define configUSE_PREEMPTION                    1
#define configUSE_TIME_SLICING                  {time_slicing}
#define configIDLE_SHOULD_YIELD                 {idle_should_yield}
#define configUSE_TICKLESS_IDLE                 0
#define configTICK_TYPE_WIDTH_IN_BITS           TICK_TYPE_WIDTH_32_BITS
#define configMINIMAL_STACK_SIZE                128
#define configTOTAL_HEAP_SIZE                   (64 * 1024)
#define configMAX_TASK_NAME_LEN                 16
#define configSUPPORT_DYNAMIC_ALLOCATION        1
#define configSUPPORT_STATIC_ALLOCATION         0
#define configUSE_IDLE_HOOK                     0
#define configUSE_TICK_HOOK                     1

#define configUSE_MUTEXES                       1
#define configUSE_RECURSIVE_MUTEXES             1
#define configUSE_COUNTING_SEMAPHORES           1
#define configUSE_QUEUE_SETS                    1
#define configUSE_TASK_NOTIFICATIONS            1
#define configTASK_NOTIFICATION_ARRAY_ENTRIES   3
#define configUSE_EVENT_GROUPS                  1
#define configUSE_STREAM_BUFFERS                1
#define configMESSAGE_BUFFER_LENGTH_TYPE        uint32_t
#define configUSE_TIMERS                        {timers}
#define configTIMER_TASK_PRIORITY               {timer_priority}
#define configTIMER_QUEUE_LENGTH                {timer_queue}
#define configTIMER_TASK_STACK_DEPTH            256

#define INCLUDE_vTaskDelete                     1
#define INCLUDE_vTaskSuspend                    1
#define INCLUDE_vTaskDelay                      1
#define INCLUDE_xTaskDelayUntil                 1
#define INCLUDE_xTaskAbortDelay                 1
#define INCLUDE_vTaskPrioritySet                1
#define INCLUDE_uxTaskPriorityGet               1
#define INCLUDE_xTimerPendFunctionCall          {timers}

#endif
"""

BOARD_H = """\
/* What the application needs of the board. */
#ifndef BOARD_H
#define BOARD_H

#include <stdint.h>

void board_start(void);          /* clocks, and the counter below */
uint32_t board_cycles(void);     /* a counter of CPU cycles that wraps around */
void board_finished(void);       /* called once, in the tick interrupt, when the scenario is over */

#endif
"""

BOARD_C = """\
/* A Cortex-M with a cycle counter (M3, M4, M7, M33). For another board, write these three functions anew. */
#include "board.h"

#define DEMCR      (*(volatile uint32_t *) 0xE000EDFCu)
#define DWT_CTRL   (*(volatile uint32_t *) 0xE0001000u)
#define DWT_CYCCNT (*(volatile uint32_t *) 0xE0001004u)

void board_start(void)
{
    DEMCR |= 1u << 24;      /* trace on */
    DWT_CYCCNT = 0;
    DWT_CTRL |= 1u;         /* count */
}

uint32_t board_cycles(void)
{
    return DWT_CYCCNT;
}

void board_finished(void)
{
}
"""

MAIN_C = """\
/* {name}: made from a scenario; does on a board what the scenario does in the model.
 *
 * A step that returned something is noted by NOTE(step, value), which does nothing unless you define it.
 */
{headers}

#include "board.h"

#ifndef NOTE
#define NOTE(step, value) ((void) (value))
#endif

#define STACK_WORDS 256
#define END_TICK {end}u

typedef int64_t item_t;

/* What each task, and once the timer task, keeps for itself. */
typedef struct {{
    TickType_t wake;        /* last wake time of xTaskDelayUntil */
    item_t sequence;        /* next item "seq" */
    item_t last;            /* item "last" */
    QueueSetMemberHandle_t selected;
}} own_t;

{objects}

/* Not all applications use all of these. */
#define MAYBE __attribute__((unused))
static MAYBE own_t daemon;
static MAYBE uint8_t payload[{payload}];
static MAYBE uint8_t received[{payload}];
static uint32_t rounds_per_tick = 1;

static void turn(uint32_t rounds)
{{
    for (volatile uint32_t left = rounds; left > 0; left = left - 1) {{
    }}
}}

/* Use the CPU for some ticks; time in which others run does not count. */
static MAYBE void burn(uint32_t ticks)
{{
    while (ticks-- > 0) {{
        turn(rounds_per_tick);
    }}
}}

/* How many rounds of the loop take a tick; before the scheduler starts, so that nothing interrupts. */
static void calibrate(void)
{{
    const uint32_t rounds = 100000;
    const uint32_t start = board_cycles();
    turn(rounds);
    const uint32_t cycles = board_cycles() - start;
    rounds_per_tick = (uint32_t) ((uint64_t) (configCPU_CLOCK_HZ / configTICK_RATE_HZ) * rounds / (cycles ? cycles : 1));
}}

{prototypes}

{selected}
{functions}
/* The device interrupts of the scenario. */
void vApplicationTickHook(void);
void vApplicationTickHook(void)
{{
    static uint32_t elapsed = 0;
    elapsed = elapsed + 1;
{interrupts}
    if (elapsed == END_TICK) {{
        board_finished();
    }}
}}

int main(void)
{{
    board_start();
    calibrate();
{starts}
    vTaskStartScheduler();
    for (;;) {{
    }}
}}
"""
