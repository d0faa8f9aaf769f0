"""Items go in at the back, or at the front, and come out at the front. Who finds it full, or empty, waits."""

from labkit.kernel import Kernel


# %% A queue of two.
def task(os):
    print((yield os.send(queue, "a")), (yield os.send_front(queue, "b")), (yield os.send(queue, "c", timeout=0)))
    print((yield os.messages_waiting(queue)), "waiting, room for", (yield os.spaces_available(queue)))
    print("peek", (yield os.peek(queue)), "receive", (yield os.receive(queue)))
    yield os.reset(queue)
    print("empty:", (yield os.receive(queue, timeout=3)), "at tick", os.ticks)


k = Kernel()
queue = k.queue("queue", length=2)
k.task("task", task, priority=1)
k.advance(until=10 * k.ms)


# %% A mailbox is a queue of one whose item is replaced. Interrupts never wait.
def reader(os):
    yield os.delay(2)
    print("the newest value is", (yield os.peek(mailbox)))
    yield os.overwrite(mailbox, 4)


def device(isr):
    print(isr.send(mailbox, 1), isr.send_front(mailbox, 2), isr.overwrite(mailbox, 3))


k = Kernel()
mailbox = k.queue("mailbox", length=1)
k.task("reader", reader, priority=1)
k.interrupt(1 * k.ms, device)
k.interrupt(3 * k.ms, lambda isr: print("received by an interrupt:", isr.receive(mailbox), isr.receive(mailbox)))
k.advance(until=10 * k.ms)


# %% A queue set tells which of its members something was sent to, the earliest first.
def either(os):
    for _ in range(2):
        member = yield os.select(group)
        print("tick", os.ticks, member.name, (yield os.take(member) if member is button else os.receive(member)))
    print("tick", os.ticks, (yield os.select(group, timeout=2)))


k = Kernel()
button, bytes_in = k.binary("button"), k.queue("bytes", length=4)
group = k.queue_set("inputs", [button, bytes_in])
k.task("either", either, priority=1)
k.interrupt(2 * k.ms, lambda isr: isr.send(bytes_in, 65))
k.interrupt(4 * k.ms, lambda isr: isr.give(button))
k.advance(until=10 * k.ms)
