"""Long messages in short packets: whatever happens to the packets, a message comes out whole, once, or not at all."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from labkit.network.fragments import HEADER, MOST_BYTES, OPEN, ROOM, Message, Reassembly, fragment_count, fragments
from tests.network.many import many


def together(packets) -> list[Message]:
    reassembly = Reassembly()
    return [message for message in map(reassembly.add, packets) if message is not None]


@pytest.mark.parametrize("size, count", [(0, 1), (1, 1), (722, 1), (ROOM, 1), (ROOM + 1, 2), (5776, 4), (1_000_000, 675)])
def test_there_and_back(size, count):
    message = Message(7, 123, bytes(i % 251 for i in range(size)))
    packets = fragments(message)
    assert len(packets) == fragment_count(size) == count
    assert max(map(len, packets)) <= MOST_BYTES
    assert together(packets) == [message] == together(packets[::-1])


def drawn_texts(rng):
    return [rng.randbytes(rng.choice([0, 1, rng.randint(2, 59), 60])) for _ in range(rng.randint(1, 4))], rng


@many(drawn_texts)
def test_lost_doubled_and_shuffled_packets_tear_nothing(texts, rng):
    losses, doubles = rng.randint(0, 8), rng.randint(0, 8)
    messages = [Message(n, 1000 + n, text * 100) for n, text in enumerate(texts)]
    packets = [packet for message in messages for packet in fragments(message)]
    kept = packets.copy()
    for _ in range(min(losses, len(kept))):
        kept.remove(rng.choice(kept))
    sent = kept + [rng.choice(kept) for _ in range(doubles if kept else 0)]
    rng.shuffle(sent)
    found = together(sent)
    whole = [m for m in messages if all(packet in kept for packet in fragments(m))]
    assert sorted(found, key=lambda m: m.number) == whole


def test_a_fragment_of_another_message_is_refused_and_harms_nothing():
    message, other = (Message(3, stamp, bytes(4000)) for stamp in (10, 11))
    first, second, third = fragments(message)
    reassembly = Reassembly()
    assert reassembly.add(first) is None
    with pytest.raises(ValueError, match="fragment 1 of message 3 has count 3, timestamp 11 ns"):
        reassembly.add(fragments(other)[1])
    with pytest.raises(ValueError, match="came before with other bytes"):
        reassembly.add(first[:-1] + b"x")
    assert reassembly.add(third) is None and reassembly.add(second) == message


@pytest.mark.parametrize(
    "packet, words",
    [
        (b"", "has 0 bytes; 16 to 1499"),
        (bytes(1500), "has 1500 bytes"),
        (HEADER.pack(1, 0, 0, 0), "has count 0"),
        (HEADER.pack(1, 2, 2, 0) + b"x", "its number has to be below"),
        (HEADER.pack(1, 0, 2, 0) + b"x", "carries 1 bytes"),
        (HEADER.pack(1, 1, 2, 0), "is empty"),
    ],
)
def test_what_is_no_fragment_is_refused_by_name(packet, words):
    with pytest.raises(ValueError, match=words):
        Reassembly().add(packet)


@given(st.one_of(st.binary(max_size=40), st.binary(max_size=9).map(lambda piece: HEADER.pack(1, 0, 1, 5) + piece)))
def test_what_is_taken_for_a_message_is_one(packet):
    try:
        message = Reassembly().add(packet)
    except ValueError:
        return
    assert message is None or fragments(message) == [packet]


def test_messages_that_stay_incomplete_do_not_pile_up():
    reassembly = Reassembly()
    for n in range(OPEN + 3):
        assert reassembly.add(fragments(Message(n, n, bytes(2000)))[0]) is None
    assert reassembly.given_up == [0, 1, 2] and reassembly.incomplete() == list(range(3, OPEN + 3))


@pytest.mark.parametrize("number, stamp", [(-1, 0), (1 << 32, 0), (0, 1 << 63), (True, 0), (0, 0.5)])
def test_numbers_that_do_not_fit_are_refused(number, stamp):
    with pytest.raises(ValueError, match="whole number"):
        fragments(Message(number, stamp, b""))


def test_a_message_that_is_too_long_is_refused():
    with pytest.raises(ValueError, match="bytes; at most"):
        fragments(Message(0, 0, bytes(ROOM * 65535 + 1)))
