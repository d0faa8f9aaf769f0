"""The kernel's clock is its tick count. A delay ends with a tick, so that it lasts up to one tick less than it says."""

from labkit.kernel import Kernel


# %% Counted from the call, delays add up to more than the period; counted from the last wake time, they do not.
def drifting(os):
    for _ in range(3):
        yield os.compute(2 * os.ms)
        yield os.delay(5)
        print("delay: tick", os.ticks)


def exact(os):
    for _ in range(3):
        yield os.compute(2 * os.ms)
        yield os.delay_until(5)
        print("delay_until: tick", os.ticks)


# %%
for body in (drifting, exact):
    k = Kernel()
    k.task("task", body, priority=1)
    k.advance(until=30 * k.ms)


# %% Another task ends a delay early, as if its time were over.
def sleeper(os):
    yield os.delay(100)
    print("woken at tick", os.ticks)


def other(os):
    yield os.delay(3)
    print("was blocked:", (yield os.abort_delay(asleep)))
    print("was blocked:", (yield os.abort_delay(asleep)))


k = Kernel()
asleep = k.task("sleeper", sleeper, priority=1)
k.task("other", other, priority=2)
k.advance(until=10 * k.ms)
