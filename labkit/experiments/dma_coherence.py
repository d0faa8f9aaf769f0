"""Notebook 03: who has the newest bytes, CPU, cache, memory or DMA (source 1, 2.2 and 3.3; failures: `coherence.CAUSES`)."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Any, Literal

from annotated_types import Interval, MultipleOf, Unit
from typing_extensions import Doc

from labkit.cache import CAUSES, MpuRegion, Operation, Transfer, evict, stm32f767
from labkit.experiment import Experiment, Labels, Metric, View
from labkit.experiments.byte_story import LINE, Stage, Story
from labkit.figures import ORANGE, SKY, YELLOW, Span, lanes

WINDOW = 2 * LINE
SIZE = 32  # of the buffer in `DmaCoherence`
SENT, READ, LAST = 6, 8, 9  # its steps after which a device has got all, the CPU has read the buffer, all is told
SRAM, DTCM = 0x2002_0100, 0x2000_0100  # where the window begins
PLACES: dict[str, tuple[int, tuple[MpuRegion, ...]]] = {
    "cached": (SRAM, ()),
    "write_through": (SRAM, (MpuRegion(0, 0x2002_0000, 4096, tex=0, c=1, b=0),)),
    "non_cacheable": (SRAM, (MpuRegion(0, 0x2002_0000, 4096, tex=1, c=0, b=0),)),
    "dtcm": (DTCM, ()),
}
PACKET, OLD, NEW = (b"hello,agent,here_is_a_new_packet", b"the-old-frame-nobody-needs-again", b"NEW.FRAME.STRAIGHT.FROM.THE.WIRE")
BEFORE, AFTER = b"1stvalue", b"2NDVALUE"  # of the neighbour, a variable right behind the buffer
HIT, DROPPED = "invalidate hit a dirty neighbour", "invalidate dropped the packet"
REASONS = CAUSES | {DROPPED: "the packet was in a dirty line that was not written back; clean it, do not invalidate it"}

SHORT = {HIT: "dirty neighbour dropped", DROPPED: "packet dropped"}  # what has no room on a card

DriverStep = Literal["none", "clean", "invalidate", "clean+invalidate"]
STEPS = Labels({"none": "nothing", "clean+invalidate": "clean and invalidate"})


@dataclass(frozen=True)
class Outcome:
    """A told story and how it ended.

    Attributes:
        stages: what stood where after each stage.
        arrived: per byte of the buffer whether the receiver (the device, or the CPU) got the newest one.
        neighbour: whether the CPU reads back what it last wrote into the neighbour.
        causes: what went wrong, the most frequent byte first; empty if nothing did.
    """

    stages: list[Stage]
    arrived: tuple[bool, ...]
    neighbour: bool
    causes: tuple[str, ...]


def causes_of(stages: Sequence[Stage]) -> tuple[str, ...]:
    """The causes of all wrong reads, the one that hit most bytes first."""
    count: Counter[str] = Counter()
    for stage in stages:
        for v in stage.wrong:
            count[v.cause] += v.size
    return tuple(cause for cause, _ in count.most_common())


def wrong(causes: Sequence[str], good: bool | None) -> Metric:
    """The card that names the causes, or how many there are."""
    told = "nothing" if not causes else SHORT.get(causes[0], causes[0]) if len(causes) == 1 else f"{len(causes)} failures"
    return Metric("what went wrong", told, good=good, note="; ".join(f"{cause}: {REASONS[cause]}" for cause in causes))


def known(metric: Metric, now: bool) -> Metric:
    """The metric, or as long as the story is not told so far, its place."""
    return metric if now else Metric(metric.name, None, note="the story is not told so far")


def remark(stage: Stage) -> str:
    """What went wrong in a stage, in a line; nothing if nothing did."""
    if not stage.wrong:
        return f"dirty lines dropped: {stage.lost}; what the CPU wrote there is gone" if stage.lost else ""
    size = sum(v.size for v in stage.wrong)
    causes = ", ".join(dict.fromkeys(v.cause for v in stage.wrong))
    return f"the {stage.wrong[0].reader} gets {size} stale byte{'s' * (size != 1)}: {causes}"


def picture(stages: Sequence[Stage], shown: int, first: int, spans: Sequence[Span], more: str = "") -> dict[str, Any]:
    """The lanes after stage number `shown`, with `more` behind the sentence that says what happens in it."""
    stage = stages[shown]
    return lanes(
        stage.lanes,
        first,
        LINE,
        spans=spans,
        moves=stage.moves,
        says=f"Step {shown} of {len(stages) - 1}: {stage.text}{more and f' {more}'}",
        remark=remark(stage),
        stages=[s.label for s in stages],
        stage=shown,
        alarms=[n for n, s in enumerate(stages[: shown + 1]) if s.wrong],
    )


class DmaCoherence(Experiment[Outcome]):
    """Who has the newest bytes: the CPU, the cache, the memory or the DMA?

    A driver hands a buffer of 32 bytes to a DMA master, which reads and writes memory and knows nothing of the cache. Step
    through the story; change what the driver does, what happens meanwhile, and where the buffer lies.
    """

    step: Annotated[int, Interval(ge=0, le=9), View(play=True), Doc("how far the story is told")] = 9
    direction: Annotated[
        Literal["transmit", "receive"],
        Labels({"transmit": "transmit (DMA reads)", "receive": "receive (DMA writes)"}),
        Doc("which way the DMA copies"),
    ] = "transmit"
    before: Annotated[DriverStep, STEPS, Doc("what the driver does with the buffer's lines before the transfer")] = "none"
    after: Annotated[DriverStep, STEPS, Doc("what the driver does with the buffer's lines after the transfer")] = "none"
    meanwhile: Annotated[
        Literal["nothing", "speculation", "eviction"],
        Labels({"nothing": "nothing", "speculation": "prefetch by the CPU", "eviction": "eviction by other work"}),
        Doc("what happens in the middle of the transfer"),
    ] = "nothing"
    neighbour: Annotated[
        Literal["alone", "before", "during"],
        Labels({"alone": "left alone", "before": "written before", "during": "written during"}),
        Doc("when the CPU writes the variable behind the buffer: before the transfer or while it runs"),
    ] = "alone"
    offset: Annotated[
        int, Interval(ge=0, le=24), MultipleOf(4), Unit("bytes"), Doc("where in its first line the buffer begins")
    ] = 0
    place: Annotated[
        Literal["cached", "write_through", "non_cacheable", "dtcm"],
        Labels(
            {
                "cached": "write-back (default)",
                "write_through": "write-through (MPU)",
                "non_cacheable": "not cacheable (MPU)",
                "dtcm": "DTCM, never cached",
            }
        ),
        Doc("where the buffer lies and how that memory is cached"),
    ] = "cached"

    def run(self) -> Outcome:
        first, mpu = PLACES[self.place]
        buffer, neighbour, half = first + self.offset, first + self.offset + SIZE, SIZE // 2
        memory = stm32f767(mpu)
        memory.write(neighbour, BEFORE)
        story = Story(memory, first, WINDOW)
        cache, dma, transmit = story.cache, story.dma, self.direction == "transmit"
        kept = {"cached": "The bytes stay in the cache", "write_through": "Write-through: memory has them, too"}.get(
            self.place, "They go past the cache"
        )
        operations = {"clean": cache.clean, "invalidate": cache.invalidate, "clean+invalidate": cache.clean_invalidate}

        def operate(op: str) -> None:
            if op in operations:
                operations[op](buffer, SIZE)

        def copy(part: int) -> None:
            at = buffer + part * half
            dma.read(at, half) if transmit else dma.write(at, NEW[part * half : (part + 1) * half])

        with story.stage("start", "The cache is empty, the buffer holds zeros."):
            pass
        with story.stage(
            "CPU<br>works",
            f"The CPU writes the packet into the buffer. {kept}."
            if transmit
            else f"The CPU has worked on the last frame in this buffer: wrote it, read it. {kept}.",
        ):
            cache.write(buffer, PACKET if transmit else OLD)
            if not transmit:
                cache.read(buffer, SIZE)
            if self.neighbour == "before":
                cache.write(neighbour, AFTER)
        with story.stage("driver:<br>before", f"Driver, before the transfer: {DOES[self.before]}"):
            operate(self.before)
        verb = "reads" if transmit else "writes"
        with story.stage("DMA,<br>first half", f"The DMA {verb} the first half in memory. It does not ask the cache."):
            copy(0)
        with story.stage("meanwhile", MEANWHILE[self.meanwhile]):
            for at in dict.fromkeys(address & -LINE for address in (buffer, buffer + SIZE - 1)):
                if self.meanwhile == "speculation":
                    cache.speculate(at)
                elif self.meanwhile == "eviction":
                    evict(cache, at)
        does = "writes its neighbour" if self.neighbour == "during" else "does not touch its neighbour"
        with story.stage("neighbour", f"The CPU {does}, the variable behind the buffer."):
            if self.neighbour == "during":
                cache.write(neighbour, AFTER)
        with story.stage("DMA,<br>other half", f"The DMA {verb} the other half and reports that it is done."):
            copy(1)
        with story.stage("driver:<br>after", f"Driver, after the transfer: {DOES[self.after]}"):
            operate(self.after)
        with story.stage("read<br>buffer", "The CPU reads the buffer."):
            read = cache.load(buffer, SIZE)
        with story.stage("read<br>neighbour", "The CPU reads the neighbour."):
            value = cache.load(neighbour, len(AFTER))

        sent = b"".join(r.data for r in cache.log if isinstance(r, Transfer) and r.op == "dma read")
        got, wanted = (sent, PACKET) if transmit else (read, NEW)
        stages = [self._named(stage) for stage in story.stages()]
        return Outcome(
            stages,
            tuple(a == b for a, b in zip(got, wanted, strict=True)),
            value == (BEFORE if self.neighbour == "alone" else AFTER),
            causes_of(stages),
        )

    def _named(self, stage: Stage) -> Stage:
        """The stage with the one cause renamed that has another meaning here: the dirty line dropped may be the packet's own."""
        buffer = PLACES[self.place][0] + self.offset
        own = [self.direction == "transmit" and v.cause == HIT and buffer <= v.address < buffer + SIZE for v in stage.wrong]
        return replace(stage, wrong=tuple(replace(v, cause=DROPPED) if mine else v for v, mine in zip(stage.wrong, own)))

    def figure(self, result: Outcome) -> dict[str, Any]:
        spans = [
            Span("buffer", self.offset, self.offset + SIZE, colour=YELLOW),
            Span("neighbour", self.offset + SIZE, self.offset + SIZE + len(AFTER)),
        ]
        return picture(result.stages, self.step, PLACES[self.place][0], spans)

    def metrics(self, result: Outcome) -> list[Metric]:
        halves = all(result.arrived[: SIZE // 2]), all(result.arrived[SIZE // 2 :])
        got = {(True, True): "everything", (True, False): "the first half", (False, True): "the other half"}.get(
            halves, "parts of it" if any(result.arrived) else "nothing of it"
        )
        receiver, done = ("device", SENT) if self.direction == "transmit" else ("CPU", READ)
        told, end = result.stages[: self.step + 1], self.step == LAST
        causes = causes_of(told)
        return [
            known(
                Metric("the receiver got", got, good=all(result.arrived), note=f"the receiver is the {receiver}"),
                self.step >= done,
            ),
            known(Metric("neighbour", "intact" if result.neighbour else "destroyed", good=result.neighbour), end),
            wrong(causes, good=not causes if causes or end else None),
            Metric("lines cleaned or dropped", sum(stage.touched for stage in told), note="by the driver, so far"),
        ]


DOES = {
    "none": "nothing.",
    "clean": "clean. Dirty lines are written back and stay.",
    "invalidate": "invalidate. The lines are dropped, dirty or not.",
    "clean+invalidate": "clean and invalidate. Dirty lines are written back, then all are dropped.",
}
MEANWHILE = {
    "nothing": "Meanwhile, nothing else touches the buffer's lines.",
    "speculation": "Meanwhile, the CPU prefetches the buffer's lines, as a Cortex-M7 may at any time.",
    "eviction": "Meanwhile, other work needs the sets: the buffer's lines leave, dirty ones by way of memory.",
}


class Alignment(Experiment[tuple[list[Stage], Operation, int]]):
    """Which bytes does a cache operation really work on?

    It works on whole lines: `SCB_CleanDCache_by_Addr(addr & ~0x1F, size + (addr & 0x1F))`. The variables before and behind the
    buffer have just been written by the CPU, so they are dirty. Clean is followed by a transmission, the others by a reception.
    """

    step: Annotated[int, Interval(ge=0, le=3), View(play=True), Doc("how far the story is told")] = 3
    operation: Annotated[
        Literal["clean", "invalidate", "clean+invalidate"],
        Labels({"clean": "clean (transmit)", "invalidate": "invalidate (receive)", "clean+invalidate": "clean and invalidate"}),
        Doc("what the driver does with the buffer"),
    ] = "invalidate"
    offset: Annotated[int, Interval(ge=0, le=31), Unit("bytes"), Doc("where in its line the buffer begins: addr & 0x1F")] = 12
    size: Annotated[int, Interval(ge=1, le=32), Unit("bytes"), Doc("length of the buffer")] = 24
    size_rule: Annotated[
        Literal["with_offset", "size_only"],
        Labels({"with_offset": "size + (addr & 0x1F)", "size_only": "size only"}),
        Doc("which size the driver passes on after it has rounded the address down"),
    ] = "with_offset"

    def run(self) -> tuple[list[Stage], Operation, int]:
        """The stages, the record of the operation, and how many stale bytes were read in the end."""
        first, buffer, end = SRAM, SRAM + self.offset, self.offset + self.size
        story = Story(stm32f767(), first, WINDOW)
        cache, transmit = story.cache, self.operation == "clean"
        act = {"clean": cache.clean, "invalidate": cache.invalidate, "clean+invalidate": cache.clean_invalidate}[self.operation]

        def operate() -> Operation:
            return act(buffer, self.size, round_size=self.size_rule == "with_offset")

        with story.stage("CPU writes", "The CPU writes its variables: all of this is dirty now."):
            own = (b"mine" * LINE)[: self.offset] + (b"packet" * LINE)[: self.size] + (b"yours" * LINE)[: WINDOW - end]
            for column, value in enumerate(own):
                if transmit or not self.offset <= column < end:
                    cache.write(first + column, bytes([value]))
        if transmit:
            with story.stage("clean", "The driver cleans the buffer's lines."):
                done = operate()
            with story.stage("DMA reads", "The DMA reads the buffer and sends it."):
                story.dma.read(buffer, self.size)
        else:
            with story.stage("DMA writes", "The DMA writes what it has received into the buffer, in memory."):
                story.dma.write(buffer, (b"FRAME." * LINE)[: self.size])
            act_name = self.operation.replace("+", " and ")
            with story.stage(act_name, f"Driver: {act_name} the buffer's lines."):
                done = operate()
        with story.stage("CPU reads", "The CPU reads all of it."):
            cache.read(first, WINDOW)
        stages = story.stages()
        return stages, done, sum(v.size for stage in stages for v in stage.wrong)

    def figure(self, result: tuple[list[Stage], Operation, int]) -> dict[str, Any]:
        stages, done, _ = result
        worked_on = done.lines or range(0)  # always given, as the operation is by address
        end, worked = self.offset + self.size, len(worked_on) * LINE
        lines = f"{len(worked_on)} line{'s' * (len(worked_on) != 1)}"
        spans = [
            Span("before", 0, self.offset),
            Span("buffer", self.offset, end, colour=YELLOW),
            Span("behind", end, WINDOW),
            Span(f"worked on: {lines}", 0, worked, 1, SKY),
        ]
        if done.missed:
            spans.append(Span("missed", worked, end, 1, ORANGE))
        asked = f"{self.size} + {self.offset} = {self.size + self.offset}" if self.size_rule == "with_offset" else f"{self.size}"
        arithmetic = f"0x{SRAM + self.offset:08X} & ~0x1F = 0x{worked_on.start:08X}, {asked} bytes: {lines}."
        return picture(stages, self.step, SRAM, [span for span in spans if span.stop > span.start], arithmetic)

    def metrics(self, result: tuple[list[Stage], Operation, int]) -> list[Metric]:
        stages, done, stale = result
        missed = done.missed[1] if done.missed else 0
        causes = causes_of(stages)
        others, end = sum(size for _, size in done.neighbours), self.step == len(stages) - 1
        return [
            known(Metric("stale bytes read in the end", stale, good=not stale), end),
            known(wrong(causes, good=not causes), end),
            Metric("bytes of others worked on", others, note="harmless to clean, deadly to invalidate"),
            Metric("bytes of the buffer missed", missed, good=not missed),
        ]
