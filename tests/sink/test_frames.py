"""The velocity frame: its bytes, its checksum three ways, and what the receiver makes of damaged lines."""

import json
import math
import random
import struct

import pytest

from labkit.__main__ import main
from labkit.sink import (
    FRAME_BYTES,
    Reception,
    check_frame,
    crc32_mpeg2,
    crc32_mpeg2_bitwise,
    crc32_mpeg2_words,
    encode_frame,
    pieces,
    read_frames,
    read_late,
    receptions,
)
from labkit.sink.frames import VELOCITY_BAUD, byte_ns

FRAME = encode_frame(1.5, -0.25, 3.0)


# ------------------------------------------------------------------------------------------------------------------- CRC


@pytest.mark.parametrize("crc", [crc32_mpeg2, crc32_mpeg2_bitwise])
def test_check_value(crc):
    assert crc(b"123456789") == 0x0376E6E7
    assert crc(b"") == 0xFFFFFFFF


def test_the_lesson_and_the_library_agree():
    rng = random.Random(1)
    for length in range(70):
        data = rng.randbytes(length)
        assert crc32_mpeg2_bitwise(data) == crc32_mpeg2(data)


def test_bytes_followed_by_their_checksum_leave_nothing():
    """The remainder of a long division, put behind the number: zero."""
    assert crc32_mpeg2_bitwise(FRAME[:24] + crc32_mpeg2(FRAME[:24]).to_bytes(4, "big")) == 0


def test_a_unit_that_is_fed_with_words_gives_another_value():
    assert crc32_mpeg2_words(FRAME[:24]) != crc32_mpeg2(FRAME[:24])
    swapped = b"".join(struct.pack(">I", word) for word in struct.unpack("<6I", FRAME[:24]))
    assert crc32_mpeg2_words(FRAME[:24]) == crc32_mpeg2_bitwise(swapped)
    palindromes = bytes.fromhex("12343412 00000000 ffffffff")
    assert crc32_mpeg2_words(palindromes) == crc32_mpeg2(palindromes)  # no test with such data finds the trap
    with pytest.raises(ValueError, match=r"^9 bytes are no whole words; the length must be a multiple of 4$"):
        crc32_mpeg2_words(b"123456789")


# ----------------------------------------------------------------------------------------------------------------- frame


def test_a_frame_byte_by_byte():
    """Doubles by hand: 1.5 is 0x3ff8 and zeros, lowest byte first; the checksum lowest byte first, too."""
    assert FRAME_BYTES == len(FRAME) == 28
    assert FRAME[:24].hex() == "000000000000f83f000000000000d0bf0000000000000840"
    assert int.from_bytes(FRAME[24:], "little") == crc32_mpeg2_bitwise(FRAME[:24])
    assert check_frame(FRAME) == Reception("ok", 1.5, -0.25, 3.0)


@pytest.mark.parametrize("length", [0, 1, 24, 27, 29, 56])
def test_another_length_is_refused_before_the_checksum(length):
    assert check_frame((FRAME * 2)[:length]).verdict == ("short" if length < 28 else "long")


def test_every_single_bit_counts():
    for bit in range(8 * FRAME_BYTES):
        flipped = bytearray(FRAME)
        flipped[bit // 8] ^= 1 << bit % 8
        assert check_frame(bytes(flipped)).verdict == "crc"


def test_a_checksum_in_the_other_byte_order_or_over_words_is_refused():
    assert check_frame(FRAME[:24] + FRAME[:23:-1]).verdict == "crc"
    assert check_frame(FRAME[:24] + crc32_mpeg2_words(FRAME[:24]).to_bytes(4, "little")).verdict == "crc"


def test_ten_thousand_damaged_frames_are_never_taken_for_good():
    """Cut, doubled, flipped, glued, exchanged: whatever is not a frame as it was sent is refused, with the right word."""
    rng, verdicts = random.Random(28), {"ok": 0, "short": 0, "long": 0, "crc": 0}
    for _ in range(10_000):
        sent = encode_frame(*(rng.choice((0.0, -0.0, rng.gauss(0, 1), 1e308, math.inf)) for _ in "xyz"))
        data = bytearray(sent)
        for _ in range(rng.randint(0, 3)):
            at, length = rng.randrange(len(data) + 1), rng.randint(1, 9)
            match rng.randrange(6):
                case 0 if data:
                    data[at % len(data)] ^= 1 << rng.randrange(8)
                case 1:
                    del data[at : at + length]
                case 2:
                    data[at:at] = data[at : at + length]
                case 3:
                    data += sent
                case 4:
                    data[at : at + length] = rng.randbytes(len(data[at : at + length]))
                case 5:
                    data[at:at] = rng.randbytes(length)
        found = check_frame(bytes(data))
        verdicts[found.verdict] += 1
        if found.verdict == "ok":
            assert data == sent and struct.pack("<3d", found.x, found.y, found.z) == sent[:24]
        else:
            assert data != sent
            assert found.verdict == ("crc" if len(data) == 28 else "short" if len(data) < 28 else "long")
    assert min(verdicts.values()) > 1000, verdicts


# ------------------------------------------------------------------------------------------------------------- reception


def line(frames: list[bytes], gap_ns: int = 5_000_000) -> tuple[list[int], bytes]:
    """Bytes back to back, `gap_ns` of silence after each frame."""
    times, now = [], 0
    for frame in frames:
        for _ in frame:
            times.append(now)
            now += byte_ns(VELOCITY_BAUD)
        now += gap_ns
    return times, b"".join(frames)


def test_a_byte_takes_ten_bits():
    assert byte_ns(115_200) == 86_806 and byte_ns(10**9) == 10


def test_silence_brings_the_receiver_back_into_step():
    """After a frame that lost a byte the next one is received; a receiver that counts bytes is lost for good."""
    damaged = [FRAME, FRAME[:10] + FRAME[11:], FRAME, FRAME]
    verdicts = [check_frame(data).verdict for data in receptions(*line(damaged))]
    assert verdicts == ["ok", "short", "ok", "ok"]
    assert [check_frame(data).verdict for data in pieces(b"".join(damaged))] == ["ok", "crc", "crc", "short"]


def test_frames_without_silence_between_them():
    """The buffer holds one frame: the reception ends when it is full. After a lost byte glued frames stay out of step."""
    assert [check_frame(d).verdict for d in receptions(*line([FRAME] * 3, gap_ns=0))] == ["ok"] * 3
    assert [check_frame(d).verdict for d in receptions(*line([FRAME[1:], FRAME, FRAME], gap_ns=0))] == ["crc", "crc", "short"]
    assert [len(d) for d in receptions(*line([FRAME] * 3, gap_ns=0), most=None)] == [84]


def test_a_pause_shorter_than_a_byte_is_no_silence():
    length = byte_ns(VELOCITY_BAUD)
    for pause, found in ((length - 1, [28]), (length, [10, 18])):
        times = [i * length + (pause if i >= 10 else 0) for i in range(28)]
        assert [len(data) for data in receptions(times, FRAME)] == found


def test_a_buffer_armed_too_early_tears_frames_and_the_checksum_sees_it():
    rng = random.Random(5)
    first, second = (encode_frame(*(rng.gauss(0, 1) for _ in "xyz")) for _ in range(2))
    verdicts = [check_frame(read_late(first, second, arrived)).verdict for arrived in range(29)]
    assert verdicts == ["ok", *["crc"] * 27, "ok"]
    assert check_frame(read_late(first, second, 28)) == check_frame(second) != check_frame(first)  # the first is lost
    with pytest.raises(
        ValueError, match=r"^the number of bytes that have arrived is 29; a whole number from 0 to 28 is allowed$"
    ):
        read_late(first, second, 29)


@pytest.mark.parametrize(
    ("ask", "sentence"),
    [
        (lambda: receptions([0], b"ab"), "1 times for 2 bytes; one for each is allowed"),
        (lambda: receptions([0], b"a", baud=0), "the baud rate is 0; a whole number from 1 to 1000000000 is allowed"),
        (lambda: receptions([0], b"a", most=0), "the length of the buffer is 0; a whole number of at least 1 is allowed"),
        (lambda: list(receptions([5, 3], b"ab")), "byte 1 comes at 3 ns, before the one in front of it; times go up"),
        (lambda: pieces(b"a", 0), "the length of a piece is 0; a whole number of at least 1 is allowed"),
    ],
)
def test_what_is_no_line_is_told(ask, sentence):
    with pytest.raises(ValueError, match=f"^{sentence}$"):
        ask()


# --------------------------------------------------------------------------------------------------------------- command


def told(path, data: bytes, capsys) -> list[dict]:
    path.write_bytes(data)
    assert main(["frames", str(path), "--json"]) == 0

    def no_number(word):
        raise AssertionError(f"{word} is no JSON")

    return json.loads(capsys.readouterr().out, parse_constant=no_number)


def test_each_line_has_its_verdict(tmp_path, capsys):
    text = FRAME.hex().encode()
    lines = {
        text: {"verdict": "ok", "x": 1.5, "y": -0.25, "z": 3.0},
        text.upper() + b"\r": {"verdict": "ok", "x": 1.5, "y": -0.25, "z": 3.0},
        FRAME.hex(" ").encode(): {"verdict": "ok", "x": 1.5, "y": -0.25, "z": 3.0},
        text[:-2]: {"verdict": "short"},
        b"": {"verdict": "short"},
        text + b"00": {"verdict": "long"},
        b"01" + text[2:]: {"verdict": "crc"},
        text[:-1]: {"verdict": "hex"},
        b"0x" + text: {"verdict": "hex"},
        b"\xff\xfe\x00": {"verdict": "hex"},
        "\uff10\uff10".encode(): {"verdict": "hex"},  # digits, but not those
    }
    for end in (b"", b"\n"):
        assert told(tmp_path / "bursts.txt", b"\n".join(lines) + end, capsys) == list(lines.values())
    assert told(tmp_path / "bursts.txt", b"\xef\xbb\xbf" + text, capsys) == [lines[text]]
    assert told(tmp_path / "bursts.txt", b"", capsys) == []


def test_numbers_that_json_has_not_are_null(tmp_path, capsys):
    frame = encode_frame(math.nan, -math.inf, 1e300)
    assert told(tmp_path / "bursts.txt", frame.hex().encode(), capsys) == [{"verdict": "ok", "x": None, "y": None, "z": 1e300}]


def test_frames_for_the_eye(tmp_path, capsys):
    path = tmp_path / "bursts.txt"
    path.write_text(f"{FRAME.hex()}\nzz\n")
    assert main(["frames", str(path)]) == 0
    assert capsys.readouterr().out == "1: ok x=1.5 y=-0.25 z=3.0\n2: hex\n"


def test_files_have_a_limit(tmp_path, monkeypatch):
    path = tmp_path / "bursts.txt"
    path.write_bytes(b"00\n" * 11)
    monkeypatch.setattr("labkit.sink.frames.MOST_LINES", 10)
    with pytest.raises(ValueError, match=r"bursts.txt has 11 lines; at most 10 are read$"):
        read_frames(path)
    with open(path, "wb") as file:
        file.truncate((8 << 20) + 1)
    with pytest.raises(ValueError, match=r"bursts.txt is longer than 8 MiB, the largest file that is read$"):
        read_frames(path)
    assert main(["frames", str(path)]) == 1 and main(["frames", str(tmp_path)]) == 1


# ------------------------------------------------------------------------------------------------------------ check-sink


def test_check_sink_as_json_and_for_the_eye(capsys):
    question = ["check-sink", "--variant", "published-first", "--producers", "1", "--messages", "1", "--capacity", "2"]
    assert main([*question, "--bytes", "1", "--modulus", "4", "--schedule", "free", "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert (answer["verdict"], answer["states"], answer["steps"]) == ("stale", 14, 5)
    assert [step["access"] for step in answer["counterexample"]] == ["read", "read", "cas", "read", "read"]
    assert main(question) == 0
    assert "published-first, free: stale (14 states)" in capsys.readouterr().out


def test_check_sink_may_stay_undecided(capsys):
    assert main(["check-sink", "--variant", "sequence", "--budget", "100", "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert (answer["verdict"], answer["states"], answer["counterexample"]) == ("undecided", 100, [])


def test_check_sink_takes_the_dma(capsys):
    assert main(["check-sink", "--variant", "published-first", "--dma", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["counterexample"][-1]["who"] == "DMA"


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["--variant", "none"], "there is no variant 'none'; there are published-first"),
        (["--variant", "sequence", "--schedule", "none"], "there is no schedule 'none'; there are free, higher, equal, lowest"),
        (["--variant", "sequence", "--capacity", "0"], "the capacity of the ring is 0; a whole number from 1 to 64 is allowed"),
        (["--variant", "sequence", "--messages", "-3"], "the number of messages of each producer is -3"),
        (["--variant", "sequence", "--budget", "0"], "the budget of states is 0"),
    ],
)
def test_check_sink_says_what_is_wrong(arguments, sentence, capsys):
    assert main(["check-sink", *arguments]) == 1
    error = capsys.readouterr().err
    assert error.startswith(f"labkit check-sink: {sentence}") and error.count("\n") == 1
