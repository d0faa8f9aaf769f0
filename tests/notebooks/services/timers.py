"""Every call is a command in the queue of the timer task, which carries it out, and calls back, at its own priority."""

from labkit.kernel import Kernel


# %% One shot, put off for as long as somebody resets it; and again and again, until it is stopped.
def task(os):
    yield os.timer_start(once)
    yield os.timer_start(often)
    yield os.delay(3)
    yield os.timer_reset(once)
    yield os.delay(3)
    print("tick", os.ticks, "active:", (yield os.timer_active(once)), (yield os.timer_active(often)))
    yield os.timer_change_period(often, 1)
    yield os.delay(3)
    yield os.timer_stop(often)


# %%
k = Kernel(timer_priority=3)
once = k.timer("once", 4, lambda os: print("tick", os.ticks, "once"))
often = k.timer("often", 2, lambda os: print("tick", os.ticks, "often"), auto_reload=True)
k.task("task", task, priority=1)
k.advance(until=20 * k.ms)


# %% The same from an interrupt; and any function can be left to the timer task.
def task(os):
    yield os.pend_call(lambda os: print("tick", os.ticks, "called by the timer task"))
    yield os.compute(20 * os.ms)


k = Kernel(timer_priority=3)
timer = k.timer("timer", 4, lambda os: print("tick", os.ticks, "expired"), auto_reload=True)
k.task("task", task, priority=1)
k.interrupt(1 * k.ms, lambda isr: isr.timer_start(timer))
k.interrupt(3 * k.ms, lambda isr: isr.timer_reset(timer))
k.interrupt(8 * k.ms, lambda isr: isr.timer_change_period(timer, 2))
k.interrupt(13 * k.ms, lambda isr: isr.timer_stop(timer))
k.advance(until=20 * k.ms)
