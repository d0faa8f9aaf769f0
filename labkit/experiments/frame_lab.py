"""Notebook 04: the velocity frame, what damages it on its way, and in which order its checksum is fed (source 1, 3.1.2)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any, Literal

from annotated_types import Interval, MultipleOf, Unit
from typing_extensions import Doc

from labkit.experiment import Experiment, Feedback, Labels, Metric
from labkit.figures import BLUE, FONT, GREEN, INK, PALE, VERMILION, Panel, axis, stack
from labkit.sink import FRAME_BYTES, Reception, check_frame, crc32_mpeg2, crc32_mpeg2_words, encode_frame

FIELDS = (("x", 0, 8), ("y", 8, 16), ("z", 16, 24), ("CRC", 24, 28))

Damage = Literal["none", "bit", "cut", "doubled", "exchanged", "glued"]
DAMAGES = {
    "none": "nothing",
    "bit": "a bit is flipped",
    "cut": "the byte is lost",
    "doubled": "the byte comes twice",
    "exchanged": "changes places with the next",
    "glued": "no silence before the next frame",
}


@dataclass(frozen=True)
class Arrival:
    """A frame as sent and as received, the robot's verdict, and its checksum computed byte by byte and word by word."""

    sent: bytes
    received: bytes
    reception: Reception
    by_bytes: int
    by_words: int


class FrameLab(Experiment[Arrival]):
    """What does the robot make of a damaged frame?

    28 bytes: three doubles and their CRC-32/MPEG-2. A frame ends where the line is silent. The host feeds its library with bytes;
    a checksum unit that is fed with 32-bit words, as the processor loads them, gives another value.
    """

    damage: Annotated[Damage, Labels(DAMAGES), Doc("what happens on the line")] = "bit"
    byte: Annotated[int, Interval(ge=0, le=FRAME_BYTES - 1), Doc("to which byte of the frame")] = 6
    bit: Annotated[int, Interval(ge=0, le=7), Doc("which bit of it is flipped; 0 is the lowest")] = 4
    unit: Annotated[
        Literal["bytes", "words"],
        Labels({"bytes": "bytes (as published)", "words": "32-bit words"}),
        Doc("what the robot's checksum unit is fed with"),
    ] = "bytes"
    x: Annotated[float, Interval(ge=-1, le=1), MultipleOf(0.25), Unit("m/s"), Doc("velocity ahead")] = 0.5
    y: Annotated[float, Interval(ge=-1, le=1), MultipleOf(0.25), Unit("m/s"), Doc("velocity to the left")] = 0.0
    z: Annotated[float, Interval(ge=-1, le=1), MultipleOf(0.25), Unit("rad/s"), Doc("rate of turn")] = 0.25

    def run(self) -> Arrival:
        sent = encode_frame(self.x, self.y, self.z)
        received = damaged(sent, self.damage, self.byte, self.bit)
        by_bytes, by_words = crc32_mpeg2(sent[:24]), crc32_mpeg2_words(sent[:24])
        judged = check_frame(received)
        if self.unit == "words" and len(received) == FRAME_BYTES:
            fits = crc32_mpeg2_words(received[:24]) == int.from_bytes(received[24:], "little")
            judged = check_frame(received[:24] + crc32_mpeg2(received[:24]).to_bytes(4, "little")) if fits else Reception("crc")
        return Arrival(sent, received, judged, by_bytes, by_words)

    def figure(self, result: Arrival) -> dict[str, Any]:
        heard = result.reception
        took = f"x = {heard.x:g}, y = {heard.y:g}, z = {heard.z:g}" if heard.verdict == "ok" else "the robot drops it"
        rows = {"sent": result.sent, "received": result.received}
        return stack(frame_panel(rows, title=heard.verdict, caption=took), height=290, legend=False)

    def metrics(self, result: Arrival) -> list[Metric]:
        heard = result.reception
        lost = None if heard.verdict != "ok" else (heard.x, heard.y, heard.z) == (self.x, self.y, self.z)
        return [
            Metric("verdict", heard.verdict, good=heard.verdict == "ok"),
            Metric("bytes received", len(result.received)),
            Metric("taken as sent", lost, good=lost, note="" if heard.verdict == "ok" else "nothing is taken"),
            Metric("checksum by bytes", f"0x{result.by_bytes:08X}"),
            Metric(
                "checksum by words",
                f"0x{result.by_words:08X}",
                good=result.by_words == result.by_bytes,
                note="the same bytes, loaded as little-endian words",
            ),
        ]


def damaged(frame: bytes, damage: str, byte: int, bit: int) -> bytes:
    """The frame as it arrives."""
    before, here, behind = frame[:byte], frame[byte : byte + 1], frame[byte + 1 :]
    match damage:
        case "bit":
            return before + bytes([here[0] ^ (1 << bit)]) + behind
        case "cut":
            return before + behind
        case "doubled":
            return before + here * 2 + behind
        case "exchanged":
            return before + behind[:1] + here + behind[1:]
        case "glued":
            return frame + frame
    return frame


def frame_panel(rows: Mapping[str, bytes], **more: Any) -> Panel:
    """Two frames, one below the other, byte by byte; of the second those that differ from the first have the colour of an alarm.

    `more` are other attributes of the `Panel`.
    """
    (upper, wanted), (lower, data) = rows.items()
    cells = [_cell(at, 0, True) for at in range(len(wanted))]
    cells += [_cell(at, -1, at < len(wanted) and value == wanted[at]) for at, value in enumerate(data)]
    fields = [
        {"text": f"<b>{name}</b>", "x": (first + last) / 2 - 0.5, "y": 0.55, "yanchor": "bottom"} for name, first, last in FIELDS
    ]
    width = max(FRAME_BYTES, len(data))
    words = {
        "type": "scatter",
        "mode": "text",
        "x": [*range(len(wanted)), *range(len(data))],
        "y": [0] * len(wanted) + [-1] * len(data),
        "text": [f"{value:02X}" for value in wanted + data],
        "textfont": {"size": FONT if width < 30 else FONT - 4, "color": INK},
        "showlegend": False,
        "hoverinfo": "skip",
    }
    y = axis(
        "",
        range=[-1.6, 1.1],
        tickvals=[0, -1],
        ticktext=[f"<b>{upper}</b>", f"<b>{lower}</b>"],
        showgrid=False,
        ticks="",
        fixedrange=True,
    )
    x = axis("byte", range=[-0.6, width - 0.4], fixedrange=True, showgrid=False)
    return Panel([words], y, x, shapes=cells, notes=fields, left=110, **more)


def _cell(at: int, row: int, right: bool) -> dict[str, Any]:
    """A box: coloured by its field where it is right, in the colour of an alarm where it is not."""
    own = PALE if at < 24 else "#cfe3f1"
    return {
        "type": "rect",
        "layer": "below",
        "x0": at - 0.46,
        "x1": at + 0.46,
        "y0": row - 0.4,
        "y1": row + 0.4,
        "fillcolor": own if right else "#f6cdb4",
        "line": {"color": (GREEN if at // 8 % 2 else BLUE) if right else VERMILION, "width": 1.5},
    }


def check_word_proof(answer: tuple[float, float, float]) -> Feedback:
    """Exercise: a velocity for which byte-fed and word-fed checksums agree, and not all three of it zero."""
    try:
        x, y, z = map(float, answer)
    except (TypeError, ValueError):
        return Feedback(False, "three numbers are needed: (x, y, z)")
    payload = encode_frame(x, y, z)[:24]
    if not any(payload):
        return Feedback(False, "standing still is too easy: give one of them another value than 0")
    if crc32_mpeg2(payload) != crc32_mpeg2_words(payload):
        hexed = payload.hex(" ", 4)
        return Feedback(False, f"the words are {hexed}: not each of them reads the same from both ends")
    return Feedback(True, f"{payload.hex(' ', 4)}: each word reads the same from both ends")
