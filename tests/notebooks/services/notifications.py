"""Each task has three notifications of its own, numbered from 0: a value of 32 bits, and whether one is pending."""

from labkit.kernel import Kernel


# %% As a counting semaphore of the task itself: `notify_take` looks at the value only.
def handler(os):
    print("tick", os.ticks, "count", (yield os.notify_take(clear=False)))
    print("tick", os.ticks, "count", (yield os.notify_take()))
    print("tick", os.ticks, "count", (yield os.notify_take(timeout=2)), "at tick", os.ticks)


def giver(os):
    yield os.delay(2)
    yield os.notify_give(task)
    yield os.notify_give(task)


# %%
k = Kernel()
task = k.task("handler", handler, priority=1)
k.task("giver", giver, priority=2)
k.interrupt(2 * k.ms, lambda isr: isr.notify_give(task))
k.advance(until=10 * k.ms)


# %% As a mailbox of bits or a number: `notify_wait` looks at whether one is pending only. Action "keep" overwrites nothing.
def receiver(os):
    for _ in range(3):
        print("tick", os.ticks, (yield os.notify_wait(clear_last=0xFF, timeout=4, index=1)), "at tick", os.ticks)


def sender(os):
    for action in ("set_bits", "increment", "keep"):
        print(action, (yield os.notify(task, action, 5, index=1)))


k = Kernel()
task = k.task("receiver", receiver, priority=1)
k.task("sender", sender, priority=2)
k.interrupt(2 * k.ms, lambda isr: isr.notify(task, "overwrite", 0x1234, index=1))
k.advance(until=10 * k.ms)


# %% Taking back: the pending mark, or bits of the value. Action "none" leaves the value as it is.
def careful(os):
    yield os.delay(2)
    print("was pending:", (yield os.notify_state_clear()), (yield os.notify_state_clear()))
    print(f"value was {(yield os.notify_value_clear(None, 0xF)):#x}, wait answers", (yield os.notify_wait(timeout=0)))


k = Kernel()
task = k.task("careful", careful, priority=1)
k.interrupt(1 * k.ms, lambda isr: print(isr.notify(task, "overwrite", 0xAB), isr.notify(task, "none")))
k.advance(until=10 * k.ms)
