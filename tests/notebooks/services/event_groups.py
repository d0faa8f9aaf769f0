"""24 bits that any number of tasks can wait for, for one of some or for all of them."""

from labkit.kernel import Kernel


# %% One `set_bits` releases everybody whom it satisfies; then the bits are cleared that one of them clears.
def waiter(os, bits, every):
    print("tick", os.ticks, f"{(yield os.wait_bits(group, bits, every=every, clear=True)):03b} at tick", os.ticks)


def setter(os):
    for bits in (0b001, 0b110):
        yield os.delay(2)
        print(f"set, and then there are {(yield os.set_bits(group, bits)):03b}")


k = Kernel()
group = k.event_group("group")
k.task("any", lambda os: waiter(os, 0b011, False), priority=1)
k.task("all", lambda os: waiter(os, 0b110, True), priority=1)
k.task("setter", setter, priority=2)
k.advance(until=10 * k.ms)


# %% Interrupts leave bits to the timer task, which has its own priority.
def reader(os):
    for _ in range(2):
        yield os.delay(2)
        print(f"tick {os.ticks}: {(yield os.get_bits(group)):03b}")
    print(f"cleared, there were {(yield os.clear_bits(group, 0b010)):03b}")


k = Kernel(timer_priority=3)
group = k.event_group("group")
k.task("reader", reader, priority=1)
k.interrupt(1 * k.ms, lambda isr: isr.set_bits(group, 0b111))
k.interrupt(3 * k.ms, lambda isr: isr.clear_bits(group, 0b001))
k.advance(until=10 * k.ms)


# %% A rendezvous: each sets its bit and waits for those of all.
def runner(os, mine, work):
    yield os.compute(work * os.ms)
    yield os.sync(group, mine, 0b11)
    print("together at tick", os.ticks)


k = Kernel()
group = k.event_group("group")
k.task("first", lambda os: runner(os, 0b01, 2), priority=1)
k.task("second", lambda os: runner(os, 0b10, 5), priority=1)
k.advance(until=10 * k.ms)
