"""FreeRTOS on one core, rule by rule: the kernel model, scenarios, and the tables the real kernel prints.

The services, by the name they have in FreeRTOS, in a task body (`os.`, to be yielded) or an interrupt handler (`isr.`), and what
differs. Everywhere: handles are Python objects, a time-out of None waits for ever, and each call can have a price (`Costs`).

    FreeRTOS                                here                     differs
    Tasks:
    xTaskCreate                             os.create                Kernel.task before the start
    vTaskDelete                             os.delete                mutexes stay taken, as there
    vTaskSuspend                            os.suspend
    vTaskResume, xTaskResumeFromISR         os.resume, isr.resume    no answer
    vTaskPrioritySet                        os.set_priority
    uxTaskPriorityGet                       os.get_priority
    uxTaskBasePriorityGet                   os.get_base_priority
    taskYIELD                               os.yield_cpu
    Time:
    vTaskDelay                              os.delay
    xTaskDelayUntil                         os.delay_until           keeps the last wake time; also ends a job and begins one
    xTaskAbortDelay                         os.abort_delay
    xTaskGetTickCount                       os.ticks                 an attribute; os.now and isr.now are CPU cycles
    Memory:
    pvPortMalloc                            os.allocate              as heap_4 does, if the kernel is given a Heap
    vPortFree                               os.free
    Critical sections:
    taskENTER_CRITICAL                      os.enter_critical        interrupts below max_syscall_priority are not held
    taskEXIT_CRITICAL                       os.exit_critical
    vTaskSuspendAll                         os.suspend_all
    xTaskResumeAll                          os.resume_all
    Semaphores and mutexes:
    xSemaphoreTake, ..FromISR               os.take, isr.take        of a mutex, too; recursive ones need no call of their own
    xSemaphoreGive, ..FromISR               os.give, isr.give        a mutex given by another than its holder is an error
    Queues:
    xQueueSendToBack, ..FromISR             os.send, isr.send        items are Python objects, not copied
    xQueueSendToFront, ..FromISR            os.send_front, isr.send_front
    xQueueOverwrite, ..FromISR              os.overwrite, isr.overwrite
    xQueueReceive, ..FromISR                os.receive, isr.receive  None if there is nothing
    xQueuePeek                              os.peek
    xQueueReset                             os.reset
    uxQueueMessagesWaiting                  os.messages_waiting
    uxQueueSpacesAvailable                  os.spaces_available
    xQueueSelectFromSet                     os.select                a full set takes no more entries; there it is an error
    Notifications:
    xTaskNotifyGiveIndexed, ..FromISR       os.notify_give, isr.notify_give
    ulTaskNotifyTakeIndexed                 os.notify_take
    xTaskNotifyIndexed, ..FromISR           os.notify, isr.notify    actions none, set_bits, increment, overwrite, keep
    xTaskNotifyWaitIndexed                  os.notify_wait           answers (whether notified, value)
    xTaskNotifyStateClearIndexed            os.notify_state_clear
    ulTaskNotifyValueClearIndexed           os.notify_value_clear
    Event groups:
    xEventGroupSetBits, ..FromISR           os.set_bits, isr.set_bits
    xEventGroupClearBits, ..FromISR         os.clear_bits, isr.clear_bits
    xEventGroupGetBits                      os.get_bits
    xEventGroupWaitBits                     os.wait_bits
    xEventGroupSync                         os.sync
    Buffers:
    xStreamBufferSend, ..FromISR            os.buffer_send, isr.buffer_send         counts bytes; xMessageBufferSend alike
    xStreamBufferReceive                    os.buffer_receive        counts bytes; xMessageBufferReceive alike
    xStreamBufferBytesAvailable             os.buffer_available
    xStreamBufferSpacesAvailable            os.buffer_spaces
    Timers:
    xTimerStart, ..FromISR                  os.timer_start, isr.timer_start
    xTimerStop, ..FromISR                   os.timer_stop, isr.timer_stop
    xTimerReset, ..FromISR                  os.timer_reset, isr.timer_reset
    xTimerChangePeriod, ..FromISR           os.timer_change_period, isr.timer_change_period
    xTimerIsTimerActive                     os.timer_active
    xTimerPendFunctionCall                  os.pend_call             the function may make requests; arguments by closure

Beside these, for the trace alone: os.compute (use the CPU), os.release and os.complete (jobs), os.begin and os.end (scopes),
os.mark and isr.mark.
"""

from labkit.kernel.costs import Costs
from labkit.kernel.firmware import firmware, write_firmware
from labkit.kernel.heap import Heap, Sizes
from labkit.kernel.kernel import Kernel
from labkit.kernel.objects import FOREVER
from labkit.kernel.report import HeapStats, RuntimeStats, TaskList, heap_stats, runtime_stats, task_list
from labkit.kernel.run import Run, TaskInfo, Wait
from labkit.kernel.scenario import Scenario, read_scenario, run_scenario, write_events, write_timeline

__all__ = [
    "FOREVER",
    "Costs",
    "Heap",
    "HeapStats",
    "Kernel",
    "Run",
    "RuntimeStats",
    "Scenario",
    "Sizes",
    "TaskInfo",
    "TaskList",
    "Wait",
    "firmware",
    "heap_stats",
    "read_scenario",
    "run_scenario",
    "runtime_stats",
    "task_list",
    "write_events",
    "write_firmware",
    "write_timeline",
]
