"""Bytes from one writer to one reader: a stream without borders, or messages, each of which takes 4 bytes more. Counts only."""

from labkit.kernel import Kernel


# %% A reader that waits is woken when the trigger level is reached; a writer waits for room, or sends what there is room for.
def reader(os):
    for _ in range(2):
        got = yield os.buffer_receive(stream, 100)
        print("tick", os.ticks, "received", got, "left", (yield os.buffer_available(stream)))


def writer(os):
    for count in (4, 12, 50):
        yield os.delay(2)
        sent = yield os.buffer_send(stream, count, timeout=0)
        print("tick", os.ticks, "sent", sent, "of", count, "room for", (yield os.buffer_spaces(stream)))


# %%
k = Kernel()
stream = k.stream_buffer("stream", length=32, trigger=10)
k.task("reader", reader, priority=1)
k.task("writer", writer, priority=2)
k.advance(until=10 * k.ms)


# %% A message goes in whole or not at all, and comes out whole: 20 bytes have room for one of 10, but not for another.
def reader(os):
    yield os.delay(2)
    for most in (5, 20):
        print("of at most", most, "received", (yield os.buffer_receive(messages, most, timeout=0)))


k = Kernel()
messages = k.message_buffer("messages", length=20)
k.task("reader", reader, priority=1)
k.interrupt(1 * k.ms, lambda isr: print("sent", isr.buffer_send(messages, 10), isr.buffer_send(messages, 10)))
k.advance(until=10 * k.ms)
