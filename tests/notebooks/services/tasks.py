"""A task that is ready and of the highest priority runs. Everything here changes who that is."""

from labkit.kernel import Kernel


# %% A task creates another one, stops it, lets it go on, and deletes it.
def worker(os):
    print("tick", os.ticks, "worker begins")
    yield os.compute(20 * os.ms)
    print("never said")


def boss(os):
    task = yield os.create("worker", worker, priority=1)
    yield os.delay(2)
    yield os.suspend(task)
    yield os.delay(2)
    yield os.resume(task)
    yield os.delay(2)
    yield os.delete(task)


# %%
k = Kernel()
k.task("boss", boss, priority=2)
k.advance(until=30 * k.ms)
print(k.trace.frame("suspend", "resume", "delete")[["time", "kind", "task", "other"]].to_string(index=False))


# %% What a task has inherited is its priority; what it was given is its base priority.
def low(os):
    yield os.take(lock)
    yield os.delay(3)
    print("low has", (yield os.get_priority()), "and its own is", (yield os.get_base_priority()))
    yield os.give(lock)
    print("low has", (yield os.get_priority()))


def high(os):
    yield os.set_priority(None, 5)
    yield os.delay(1)
    yield os.take(lock)


# %%
k = Kernel()
lock = k.mutex("lock")
k.task("low", low, priority=1)
k.task("high", high, priority=2)
k.advance(until=10 * k.ms)


# %% Tasks of one priority take turns: at every tick, or when the one that runs says so. An interrupt ends a suspension.
def talker(os, name):
    for turn in (1, 2):
        print(name, turn)
        yield os.yield_cpu()
    yield os.suspend()
    print(name, "is resumed at tick", os.ticks)


k = Kernel()
first = k.task("first", lambda os: talker(os, "first"), priority=1)
k.task("second", lambda os: talker(os, "second"), priority=1)
k.interrupt(4 * k.ms, lambda isr: isr.resume(first))
k.advance(until=10 * k.ms)
