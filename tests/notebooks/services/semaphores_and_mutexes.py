"""A semaphore counts and has no owner; a mutex has one, who inherits the priority of whoever waits for it."""

from labkit.kernel import Kernel


# %% A recursive mutex is free again after as many gives as takes. Who waits too long goes on without it.
def owner(os):
    yield os.take(lock)
    yield os.take(lock)
    yield os.compute(3 * os.ms)
    yield os.give(lock)
    yield os.compute(3 * os.ms)
    yield os.give(lock)


def impatient(os):
    yield os.delay(1)
    print("tick", os.ticks, (yield os.take(lock, timeout=2)), "at tick", os.ticks)
    print("tick", os.ticks, (yield os.take(lock)), "at tick", os.ticks)


# %%
k = Kernel()
lock = k.recursive_mutex("lock")
k.task("owner", owner, priority=1)
k.task("impatient", impatient, priority=2)
k.advance(until=10 * k.ms)


# %% Interrupts count a semaphore up, to its length, and can count it down, without waiting. A mutex is no business of theirs.
def handler(os):
    while True:
        yield os.take(signal)
        print("tick", os.ticks, "one event served")
        yield os.compute(2 * os.ms)


def burst(isr):
    print(f"{isr.now / k.ms:g} ms", [isr.give(signal) for _ in range(4)], isr.take(signal))


k = Kernel()
signal = k.counting("signal", length=3)
k.task("handler", handler, priority=1)
k.interrupt(3 * k.ms, burst)
k.advance(until=20 * k.ms)
