"""Notebook 04: is the sink of source 1 correct? Every interleaving of its accesses, and the shortest way to a failure."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Literal

from annotated_types import Interval
from typing_extensions import Doc

from labkit.experiment import Experiment, Feedback, Labels, Metric, View, progress
from labkit.figures import Access, Cell, interleaving
from labkit.sink import VARIANTS, Check, Ring, Step, check_sink, sample_run

BUDGET = 60_000  # states: about two seconds
SHOWN = 40  # steps of a history that can be shown

VariantName = Literal[
    "published-first",
    "published-first-mutex",
    "atomic-push",
    "consumer-mutex",
    "store-first",
    "ready-flag",
    "sequence",
    "interrupts-off",
    "commit-index",
    "ordered",
    "batch-assert",
]
Schedule = Literal["free", "higher", "equal", "lowest"]
SCHEDULE_NAMES = {
    "free": "any order (several cores)",
    "higher": "one core, consumer above",
    "equal": "one core, equal priorities",
    "lowest": "one core, consumer below",
}


@dataclass(frozen=True)
class Told:
    """The answer of the search, and the history to show: the shortest failure, or some run where there is none."""

    check: Check
    steps: tuple[Step, ...]


class SinkStory(Experiment[Told]):
    """Is the trace sink correct, whoever runs when?

    Tasks push messages into a ring, a consumer takes them out. The search tries every order of their accesses; if one fails, the
    shortest such history is told step by step. An arrow leads from the write to who reads its value.
    """

    slow: ClassVar[bool] = True
    step: Annotated[int, Interval(ge=0, le=SHOWN), View(play=True), Doc("how far the history is told")] = SHOWN
    variant: Annotated[
        VariantName, Labels({name: name.replace("-", " ") for name in VARIANTS}), Doc("how a message gets into the ring")
    ] = "published-first"
    schedule: Annotated[Schedule, Labels(SCHEDULE_NAMES), Doc("who may run when")] = "free"
    producers: Annotated[int, Interval(ge=1, le=3), Doc("tasks that push")] = 2
    messages: Annotated[int, Interval(ge=1, le=2), Doc("messages of each of them")] = 2
    bytes: Annotated[int, Interval(ge=1, le=2), Doc("bytes of a message")] = 1
    capacity: Annotated[int, Interval(ge=1, le=4), Doc("slots of the ring")] = 2
    indices: Annotated[
        Literal["multiple", "four_bits"],
        Labels({"multiple": "8 times the capacity", "four_bits": "16, as a counter of 4 bits"}),
        Doc("where the indices wrap to 0; they start one below"),
    ] = "multiple"
    dma: Annotated[
        bool, Doc("a DMA reads the slots and notifies the consumer, as on the board; else the consumer reads them")
    ] = False

    def ring(self) -> Ring:
        """The sizes as the model takes them."""
        modulus = 8 * self.capacity if self.indices == "multiple" else 16
        return Ring(self.producers, self.messages, self.bytes, self.capacity, modulus, self.dma)

    def run(self) -> Told:
        check = check_sink(self.variant, self.ring(), self.schedule, BUDGET, progress)
        return Told(check, check.steps or sample_run(self.variant, self.ring(), self.schedule))

    def figure(self, result: Told) -> dict[str, Any]:
        check, steps = result.check, result.steps[:SHOWN]
        shown = min(self.step, len(steps))
        end = bool(check.steps) and shown == len(result.steps)
        told = f"Step {shown} of {len(result.steps)}: {sentence(steps[shown - 1])}" if shown else "Nothing has happened yet"
        lanes = [f"P{p + 1}" for p in range(self.producers)] + ["consumer"]
        lanes += [who for who in ("DMA", "tick") if any(step.who == who for step in steps)]
        return interleaving(
            lanes,
            [Access(s.who, s.access, str(s).removeprefix(f"{s.who} "), s.source) for s in steps],
            shown,
            memory(check.ring, result.steps, shown),
            told,
            remark(result, shown),
            end,
            f"{VARIANTS[self.variant].title}; {SCHEDULE_NAMES[self.schedule]}",
        )

    def metrics(self, result: Told) -> list[Metric]:
        check = result.check
        good = None if check.verdict == "undecided" else check.verdict == "ok"
        return [
            Metric("verdict", check.verdict, good=good, note=check.reason),
            Metric("states", check.states, note="different situations the search has seen"),
            Metric("steps", len(check.steps), note="of the shortest way to the failure"),
        ]


def remark(told: Told, shown: int) -> str:
    """What the history is, or, at its end, what came of it; a history that is longer than the picture is marked as cut."""
    check, more = told.check, len(told.steps) - SHOWN
    verdict = f"{check.verdict}: {check.reason}"
    cut = f"CUT: {more} more steps do not fit the picture" if more > 0 else ""
    if not check.steps:
        found = f"ok: nothing is wrong in any of {check.states} states" if check.verdict == "ok" else check.reason
        return f"{found}; {f'the first {SHOWN} steps of ' if cut else ''}one run of many"
    if shown < min(len(told.steps), SHOWN):
        return f"on the shortest way to a failure of {len(told.steps)} steps"
    return f"{cut}; in the end {verdict}" if cut else verdict


def sentence(step: Step) -> str:
    """The step, and where the value comes from."""
    if step.source is None:
        return str(step)
    return f"{step} (from step {step.source})" if step.source else f"{step} (as at the start)"


def memory(ring: Ring, steps: tuple[Step, ...], shown: int) -> list[Cell]:
    """The slots, the indices and whatever else the history names, after its first `shown` steps."""
    now: dict[str, int | str | None] = {f"buf[{i}]": "never written" for i in range(ring.capacity)}
    now |= {"write": ring.start, "read": ring.start}
    for step in steps:  # what a variable held at the start is what its first access saw
        if step.variable and step.who != "tick" and step.variable not in now:
            now[step.variable] = step.before if step.before is not None else step.value
    for step in steps[:shown]:
        if step.variable in now:
            now[step.variable] = step.value
    touched = steps[shown - 1].variable if shown else ""
    write, read = (int(now[name] or 0) for name in ("write", "read"))
    remarks = {"write": f"slot {ring.slot(write)}", "read": f"slot {ring.slot(read)}"}
    for name, index in (("write", write), ("read", read)):
        if not any(step.variable == name for step in steps):
            del now[name]  # this variant does without
            continue
        slot = f"buf[{ring.slot(index)}]"
        remarks[slot] = f"{remarks.get(slot, '')} ◀ {name}".strip()
    published = {f"buf[{slot}]" for slot in full(ring, now, write, read)}
    return [
        Cell(name, "–" if value == "never written" else str(value), name in published, name == touched, remarks.get(name, ""))
        for name, value in now.items()
    ]


def full(ring: Ring, now: Mapping[str, int | str | None], write: int, read: int) -> set[int]:
    """The slots that the consumer believes to hold a byte: by their flags or sequence numbers where there are some, else by the
    indices."""
    flags = {name: value for name, value in now.items() if name.startswith(("ready[", "seq["))}
    if not flags:
        return {ring.slot(ring.plus(read, i)) for i in range(min(ring.fill(write, read), ring.capacity))}
    found = set()
    for name, value in flags.items():
        slot = int(name[name.index("[") + 1 : -1])
        number = int(value or 0)
        if number == 1 if name.startswith("ready[") else ring.slot(ring.plus(number, -1)) == slot:
            found.add(slot)
    return found


def check_cure(answer: SinkStory) -> Feedback:
    """Exercise: a variant without a failure, for two producers, messages of two bytes, and any order."""
    if answer.producers < 2 or answer.bytes < 2 or answer.messages < 2 or answer.schedule != "free":
        return Feedback(False, "the cure has to stand two producers with two messages of two bytes, in any order")
    found = answer.run().check
    if found.verdict != "ok":
        return Feedback(False, f"{found.verdict}: {found.reason}")
    return Feedback(True, f"{answer.variant}: {found.reason}")


def check_lucky_priorities(answer: SinkStory) -> Feedback:
    """Exercise: the published sink, unchanged, on priorities that hide its race."""
    if answer.variant not in ("published-first", "published-first-mutex"):
        return Feedback(False, "leave the sink as source 1 has it; change who may run when")
    found = answer.run().check
    if found.verdict != "ok":
        return Feedback(False, f"{found.verdict}, after {len(found.steps)} steps: {found.reason}")
    return Feedback(True, f"{found.reason}; in source 1 the consumer has the highest priority of all")
