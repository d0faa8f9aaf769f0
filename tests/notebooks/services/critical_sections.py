"""Both hold up every task. A critical section holds interrupts, too, and with them the tick; of its ticks one is kept."""

from labkit.kernel import Kernel


# %% Interrupts come at 1.5 ms, in the critical section, and at 7.5 ms, while the scheduler is suspended: only that one is let in
# at once. Of three ticks in the critical section one is counted, of those during the suspension all. Both nest.
def task(os):
    yield os.enter_critical()
    yield os.enter_critical()
    yield os.compute(3 * os.ms)
    yield os.exit_critical()
    yield os.exit_critical()
    print(f"at {os.now / os.ms:g} ms the tick count is", os.ticks)
    yield os.delay(3)
    yield os.suspend_all()
    yield os.compute(3 * os.ms)
    before, _ = os.ticks, (yield os.resume_all())
    print(f"at {os.now / os.ms:g} ms the tick count was", before, "and is", os.ticks)


# %%
k = Kernel()
k.task("task", task, priority=1)
k.interrupt(3 * k.ms // 2, lambda isr: print(f"at {isr.now / k.ms:g} ms an interrupt"), every=6 * k.ms)
k.advance(until=10 * k.ms)
