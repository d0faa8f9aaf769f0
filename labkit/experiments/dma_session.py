"""Notebook 03, second half: the micro-ROS session that broke when the data cache went on (source 1, 3.3, figures 6 and 7)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Literal

from annotated_types import Interval, Unit
from typing_extensions import Doc

from labkit.cache import SOURCE1_MPU, MpuRegion, stm32f767
from labkit.experiment import Experiment, Labels, Metric, View
from labkit.experiments.byte_story import LINE, Stage, Story
from labkit.experiments.dma_coherence import known, picture
from labkit.figures import YELLOW, Span

HEAP_SIZE = 16 * 1024  # of lwIP, as in source 1
HEAPS = {"sram1": 0x2002_4000, "dtcm": 0x2000_4000}
NORMAL_UNCACHED = MpuRegion(1, HEAPS["sram1"], HEAP_SIZE, tex=1, c=0, b=0)
REGIONS: dict[str, tuple[MpuRegion, ...]] = {"none": (), "source1": SOURCE1_MPU, "heap": (NORMAL_UNCACHED,)}
ELSEWHERE = 0x2004_0000  # SRAM1, far from the heap: what other work reads

#: CREATE_CLIENT as the agent logged it (source 1, figure 7; the print lost one zero of the first eight bytes, the submessage's
#: length tells which): header, submessage (id, flags, length), cookie XRCE, version, vendor, key, session, properties, mtu.
CREATE_CLIENT = bytes.fromhex("80000000 00011000 58524345 0100 010F 00C93570 81 00 FC01")
KEY = slice(16, 20)


def agent(message: bytes) -> str:
    """What an agent makes of a message (DDS-XRCE 1.0, 8.3): a session id below 80h brings a client key of 4 bytes in the header.

    Submessage 0 is CREATE_CLIENT. A key of zeros is invalid, which is what the agent of source 1 reported.
    """
    start = 8 if message[0] < 0x80 else 4
    submessage, body = message[start], message[start + 4 :]
    if submessage != 0:
        return "no CREATE_CLIENT"
    if not any(body[8:12]):
        return "invalid client key"
    return "session established" if body[:4] == b"XRCE" else "cookie is not XRCE"


@dataclass(frozen=True)
class Sent:
    """A message on its way: the stages, and what the agent received."""

    stages: list[Stage]
    received: bytes


def send(mpu: Sequence[MpuRegion], driver: str, address: int, other_work: int = 0) -> Sent:
    """The CPU writes CREATE_CLIENT to `address`, the driver does its part, other work reads `other_work` KiB, the DMA sends.

    `driver` is "generated" (no cache operation), "size_only" or "with_offset" (clean, by the two rules for the size). ValueError
    where the memory does not allow it.
    """
    story = Story(stm32f767(mpu), address, len(CREATE_CLIENT), hexadecimal=True)
    cache = story.cache
    with story.stage("start", "Memory of the packet buffer: zeros."):
        pass
    with story.stage("CPU writes", "micro-ROS writes the message CREATE_CLIENT into a packet buffer of lwIP."):
        cache.write(address, CREATE_CLIENT)
    cleans = "without any cache operation" if driver == "generated" else "after it has cleaned the buffer's lines"
    with story.stage("driver", f"low_level_output() hands the buffer to the DMA {cleans}."):
        if driver != "generated":
            cache.clean(address, len(CREATE_CLIENT), round_size=driver == "with_offset")
    with story.stage("other work", f"Before the DMA gets to it, the CPU reads {other_work} KiB of something else."):
        for at in range(ELSEWHERE, ELSEWHERE + 1024 * other_work, LINE):
            cache.read(at, 4)
    with story.stage("DMA sends", "The Ethernet DMA reads the message from memory and sends it to the agent."):
        received = story.dma.read(address, len(CREATE_CLIENT)).data
    return Sent(story.stages(), received)


class UrosSession(Experiment[Sent]):
    """Why does the agent receive zeros?

    micro-ROS opens a session: the message CREATE_CLIENT goes through lwIP and the Ethernet DMA to the agent. It worked until the
    data cache was switched on.
    """

    step: Annotated[int, Interval(ge=0, le=4), View(play=True), Doc("how far the story is told")] = 4
    driver: Annotated[
        Literal["generated", "size_only", "with_offset"],
        Labels({"generated": "no clean (as generated)", "size_only": "clean, size only", "with_offset": "clean, size + offset"}),
        Doc("what the Ethernet driver does before it starts the DMA"),
    ] = "generated"
    mpu: Annotated[
        Literal["none", "source1", "heap"],
        Labels({"none": "none", "source1": "source 1's two", "heap": "heap not cacheable"}),
        Doc("MPU regions"),
    ] = "source1"
    heap: Annotated[
        Literal["sram1", "dtcm"],
        Labels({"sram1": "SRAM1, 0x2002 4000", "dtcm": "DTCM, 0x2000 4000"}),
        Doc("where lwIP's packet buffers lie"),
    ] = "sram1"
    offset: Annotated[
        int,
        Interval(ge=0, le=31),
        Unit("bytes"),
        Doc("where in its cache line the message begins; 42 bytes of headers before it make 10"),
    ] = 10
    other_work: Annotated[
        int, Interval(ge=0, le=20), Unit("KiB"), Doc("what the CPU reads between the driver's call and the DMA's access")
    ] = 0

    def run(self) -> Sent:
        return send(REGIONS[self.mpu], self.driver, HEAPS[self.heap] + self.offset, self.other_work)

    def figure(self, result: Sent) -> dict[str, Any]:
        spans = [
            Span("header", 0, 4),
            Span("submessage", 4, 8),
            Span("cookie", 8, 12),
            Span("version, vendor", 12, 16),
            Span("client_key", KEY.start, KEY.stop, colour=YELLOW),
            Span("session, mtu", 20, 24),
        ]
        return picture(result.stages, self.step, HEAPS[self.heap] + self.offset, spans)

    def metrics(self, result: Sent) -> list[Metric]:
        stale = sum(v.size for stage in result.stages for v in stage.wrong)
        said, key = agent(result.received), result.received[KEY]
        made = [
            Metric("the agent says", said, good=said == "session established"),
            Metric("client_key on the wire", key.hex(" ").upper(), good=key == CREATE_CLIENT[KEY]),
            Metric("stale bytes sent", stale, f"of {len(CREATE_CLIENT)}", good=not stale),
        ]
        return [known(metric, self.step == len(result.stages) - 1) for metric in made]

    def without_effect(self) -> Mapping[str, str]:
        return {"mpu": "with the heap in SRAM1"} if self.heap == "dtcm" else {}
