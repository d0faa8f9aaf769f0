"""Each variant of the sink and what every interleaving of it comes to; judged a second time by running the threads themselves."""

import random
from collections.abc import Iterator

import pytest

from labkit.sink import SCHEDULES, VARIANTS, Ring, check_sink, default_ring
from labkit.sink.accesses import Kind
from labkit.sink.explorer import search
from labkit.sink.machine import Machine
from labkit.sink.variants import consumer, dma, producer

# ------------------------------------------------------------------------------------------------------------- the table

#: Verdicts by schedule: free, higher, equal, lowest.
TABLE = {
    "published-first": ("stale", "stale", "stale", "ok"),
    "published-first-mutex": ("stale", "stale", "stale", "ok"),
    "atomic-push": ("torn", "torn", "torn", "torn"),
    "consumer-mutex": ("deadlock", "deadlock", "deadlock", "deadlock"),
    "store-first": ("overwritten", "overwritten", "overwritten", "overwritten"),
    "ready-flag": ("ok", "ok", "ok", "ok"),
    "sequence": ("ok", "ok", "ok", "ok"),
    "interrupts-off": ("ok", "ok", "ok", "ok"),
    "commit-index": ("ok", "livelock", "ok", "livelock"),
    "ordered": ("ok", "livelock", "ok", "livelock"),
    "batch-assert": ("assert", "assert", "assert", "assert"),
}
assert TABLE.keys() == VARIANTS.keys()


@pytest.mark.parametrize(("modulus", "dma"), [(16, False), (2**32, False), (16, True)])
@pytest.mark.parametrize("variant", TABLE)
def test_verdicts(variant, modulus, dma):
    found = [check_sink(variant, default_ring(variant, modulus=modulus, dma=dma), s).verdict for s in SCHEDULES]
    assert tuple(found) == TABLE[variant]


@pytest.mark.parametrize(
    ("variant", "capacity"),
    [(v, c) for v in ("ready-flag", "sequence", "interrupts-off") for c in (1, 2, 4) if (v, c) != ("sequence", 1)],
)
def test_what_passes_also_passes_with_whole_messages_and_one_producer(variant, capacity):
    for producers, messages, size in ((1, 4, 1), (2, 2, 1), (1, 2, 2), (2, 1, 2)):
        verdict = check_sink(
            variant, default_ring(variant, producers=producers, messages=messages, bytes=size, capacity=capacity)
        ).verdict
        assert verdict == ("ok" if size <= capacity else "deadlock"), (producers, messages, size)


def test_sequence_numbers_need_two_slots():
    """With one, a full slot's number is the one for which it would be free next."""
    assert check_sink("sequence", default_ring("sequence", producers=1, capacity=1)).verdict == "overwritten"


def test_the_shortest_way_to_overwrite_ends_with_a_claimed_element():
    check = check_sink("store-first")
    assert len(check.steps) == 7 and check.reason == "P1/1 is not yet sent when P2/1 is written over it"


@pytest.mark.parametrize(("variant", "steps"), [("published-first", 5), ("published-first-mutex", 6)])
@pytest.mark.parametrize("producers", [1, 2, 3])
def test_the_race_needs_one_producer_and_few_steps(variant, steps, producers):
    check = check_sink(variant, default_ring(variant, producers=producers, messages=1))
    assert (check.verdict, len(check.steps)) == ("stale", steps)
    assert str(check.steps[-2]).startswith("consumer reads write")
    assert check.steps[-1].value == "never written" and check.steps[-1].source == 0
    assert "never written" in check.reason


def test_a_stale_slot_may_hold_what_was_sent_before():
    """One slot: the first byte arrives, the second is read too early, and the first would come twice."""
    machine = Machine("published-first", Ring(producers=1, messages=2, capacity=1, modulus=8))
    state, found = machine.initial, []
    for thread in [0] * 4 + [1] * 3 + [0] * 3 + [1] * 2:  # push, drain, push up to the index, drain
        assert thread in machine.can_step(state)
        state, wrong = machine.step(state, thread)
        found.append(wrong)
    assert found == [""] * 11 + ["stale"]


def held(sent: tuple[int, int], claimed: tuple[int, int], element: int) -> tuple[Machine, tuple[int, ...], int]:
    """Two producers of two messages of two bytes: a state in which a slot holds an element, and that slot."""
    machine = Machine("published-first", Ring(bytes=2))
    slot = next(index for index, name in machine.variables.items() if name == "buf[0]")
    state = list(machine.initial)
    state[slot], state[machine.claimed :] = element, [*claimed, *sent]
    return machine, tuple(state), slot


@pytest.mark.parametrize(
    ("sent", "claimed", "element", "wrong"),
    [
        ((0, 0), (1, 0), 1, ""),
        ((1, 0), (2, 0), 1, "stale"),  # sent before
        ((0, 0), (1, 0), 0, "stale"),  # never written
        ((0, 0), (1, 0), 5, "overwritten"),  # stored by the second producer, who has claimed nothing
        ((0, 0), (2, 0), 2, "lost"),  # the first byte is skipped
        ((1, 0), (2, 1), 2, ""),
        ((1, 0), (2, 1), 5, "torn"),  # in the middle of the first producer's message
        ((2, 0), (2, 1), 5, ""),
    ],
)
def test_what_is_sent_is_judged(sent, claimed, element, wrong):
    machine, state, slot = held(sent, claimed, element)
    assert machine._misread(state, list(state), slot) == wrong


@pytest.mark.parametrize(
    ("sent", "claimed", "element", "wrong"),
    [
        ((0, 0), (1, 0), 1, "overwritten"),
        ((0, 0), (0, 0), 1, ""),  # stored, but never claimed: nobody counts on it
        ((1, 0), (1, 0), 1, ""),  # sent
        ((0, 0), (1, 0), 0, ""),
    ],
)
def test_what_is_stored_over_is_judged(sent, claimed, element, wrong):
    machine, state, slot = held(sent, claimed, element)
    assert machine._overwritten(state, slot) == wrong


@pytest.mark.parametrize("schedule", SCHEDULES)
def test_while_interrupts_are_disabled_only_the_hardware_goes_on(schedule):
    machine = Machine("interrupts-off", Ring(dma=True), schedule)
    state = list(machine.initial)
    memory = {name: index for index, name in machine.variables.items()}
    state[memory["dma_start"]] = 1
    while machine.node(tuple(state), 0).kind != Kind.READ:  # released, interrupts disabled
        state = list(machine.step(tuple(state), 0)[0])
    assert state[machine.irq] == 1
    assert set(machine.can_step(tuple(state))) == {0, machine.hardware}
    state[machine.irq] = 0
    assert len(machine.can_step(tuple(state))) > 2


@pytest.mark.parametrize("producers", [1, 2])
def test_two_producers_are_needed_to_tear_or_to_overwrite(producers):
    for variant, wrong in (("atomic-push", "torn"), ("store-first", "overwritten"), ("batch-assert", "assert")):
        assert check_sink(variant, default_ring(variant, producers=producers)).verdict == (wrong if producers == 2 else "ok")


def test_atomic_pushes_of_single_bytes_are_correct():
    assert check_sink("atomic-push", default_ring("atomic-push", bytes=1)).verdict == "ok"


def test_the_deadlock_needs_a_full_ring():
    assert check_sink("consumer-mutex", default_ring("consumer-mutex", capacity=4)).verdict == "ok"
    check = check_sink("consumer-mutex", default_ring("consumer-mutex", producers=1, messages=3))
    assert check.verdict == "deadlock" and check.steps[-1].variable == "read"


@pytest.mark.parametrize("variant", ["ready-flag", "sequence", "interrupts-off", "commit-index", "ordered"])
def test_a_capacity_that_does_not_divide_the_modulus_corrupts(variant):
    """The index comes around to a slot that is not the next one."""
    assert check_sink(variant, Ring(capacity=3, modulus=8)).verdict not in ("ok", "undecided")
    assert check_sink(variant, Ring(capacity=3, modulus=9)).verdict == "ok"


@pytest.mark.parametrize("variant", ["ready-flag", "sequence", "commit-index"])
def test_claims_fail_after_a_whole_round_of_the_index_during_one_sleep(variant):
    """The compare-and-swap finds the index that it expects, a whole round later."""
    assert check_sink(variant, Ring(messages=5, capacity=2, modulus=4)).verdict == "overwritten"
    assert check_sink(variant, Ring(messages=4, capacity=2, modulus=8)).verdict == "ok"  # four messages are no round of eight
    assert check_sink(variant, Ring(messages=5, capacity=2, modulus=4), "lowest").verdict in ("ok", "livelock")


@pytest.mark.parametrize("variant", ["interrupts-off", "ordered"])
def test_who_is_alone_minds_no_round(variant):
    assert check_sink(variant, Ring(messages=5, capacity=2, modulus=4)).verdict == "ok"


def test_indices_that_count_up_to_the_capacity_take_a_full_ring_for_an_empty_one():
    assert check_sink("interrupts-off", Ring(capacity=4, modulus=4)).verdict == "lost"


# ------------------------------------------------------------------------------- a second judge: the threads as they are


class Run:
    """The generators themselves on a plain dict: no tables, no hashing, no hidden counts. What comes out is compared with
    what went in."""

    def __init__(self, variant: str, ring: Ring) -> None:
        kind = VARIANTS[variant]
        self.ring = ring
        self.memory = {"write": ring.start, "read": ring.start, "irq": 0, **kind.shared(ring)}
        self.memory |= {"dma_from": 0, "dma_count": 0, "dma_start": 0, "dma_done": 0}
        self.memory |= {f"buf[{i}]": 0 for i in range(ring.capacity)}
        threads = [producer(ring, p, kind.push) for p in range(ring.producers)]
        self.threads = [*threads, consumer(ring, kind.drain), *([dma(ring)] if ring.dma else [])]
        self.next = [next(thread) for thread in self.threads]
        self.sent: list[int] = []
        self.failed = False

    def can(self) -> list[int]:
        return [t for t in range(len(self.next)) if self.may(t)]

    def may(self, t: int) -> bool:
        access, off = self.next[t], self.memory["irq"]
        return (
            access is not None
            and not (off and off != t + 1 and t <= self.ring.producers)
            and not (access.kind == Kind.WAIT and self.memory[access.variable] != access.a)
        )

    def step(self, t: int) -> None:
        access, memory = self.next[t], self.memory
        answer = memory.get(access.variable)
        match access.kind:
            case Kind.WRITE | Kind.PUT:
                memory[access.variable] = access.a
            case Kind.WAIT:
                memory[access.variable] = access.b
            case Kind.CAS:
                answer = int(answer == access.a)
                if answer:
                    memory[access.variable] = access.b
            case Kind.ADD:
                memory[access.variable] = (answer + access.a) % access.b
            case Kind.TAKE:
                self.sent.append(answer)
            case Kind.FAIL:
                self.failed = True
                return
        try:
            self.next[t] = self.threads[t].send(answer)
        except StopIteration:
            self.next[t] = None
        while self.next[t] is not None and self.next[t].kind == Kind.RELEASE:
            self.next[t] = self.threads[t].send(None)

    def begin(self) -> "Run":
        for t, access in enumerate(self.next):
            if access.kind == Kind.RELEASE:
                self.next[t] = self.threads[t].send(None)
        return self

    @property
    def right(self) -> bool:
        """What was sent is made of whole messages, one after the other, each producer's in order; the last may be begun."""
        ring, sent = self.ring, list(self.sent)
        told = {
            p: [ring.element(p, m, b) for m in range(ring.messages) for b in range(ring.bytes)] for p in range(ring.producers)
        }
        while sent:
            owner = next((p for p, left in told.items() if left and left[0] == sent[0]), None)
            if owner is None:
                return False
            message, told[owner] = told[owner][: ring.bytes], told[owner][ring.bytes :]
            if sent[: ring.bytes] != message[: len(sent)]:
                return False
            del sent[: ring.bytes]
        return True


def walk(run: Run, steps: int, rng: random.Random) -> Iterator[Run]:
    for _ in range(steps):
        if not (ready := run.can()):
            return
        favourite = rng.choice(ready)
        for _ in range(rng.choice((1, 1, 2, 8))):
            if run.may(favourite) and not run.failed:
                run.step(favourite)
                yield run


def goes_wrong(run: Run, rng: random.Random) -> bool:
    """Whether a walk goes wrong. It is over when all producers are through and a hundred steps of the consumer sent nothing."""
    seen = quiet = 0
    for _ in walk(run, 400, rng):
        if run.failed or (len(run.sent) > seen and not run.right):
            return True
        through = all(access is None for access in run.next[: run.ring.producers])
        quiet = quiet + 1 if through and len(run.sent) == seen else 0
        if quiet == 100:
            break
        seen = len(run.sent)
    return False


@pytest.mark.parametrize("use_dma", [False, True], ids=["", "dma"])
@pytest.mark.parametrize("variant", VARIANTS)
def test_random_walks_of_the_threads_themselves_agree(variant, use_dma):
    ring, rng = default_ring(variant, dma=use_dma), random.Random(variant)
    wrong = ended = 0
    for _ in range(100):
        run = Run(variant, ring).begin()
        if goes_wrong(run, rng):
            wrong += 1
        else:
            ended += len(run.sent) == ring.producers * ring.share
    expected = TABLE[variant][0]
    assert (wrong > 0) == (expected in ("stale", "torn", "overwritten", "assert")), f"{wrong} of 100 walks went wrong"
    assert ended > (80 if expected == "ok" else -1), f"{ended} of 100 walks sent everything"


@pytest.mark.parametrize("variant", [v for v in TABLE if TABLE[v][0] in ("stale", "torn", "assert")])
def test_the_threads_themselves_follow_the_counterexample(variant):
    check = check_sink(variant)
    run = Run(variant, check.ring).begin()
    names = [f"P{p + 1}" for p in range(check.ring.producers)] + ["consumer"]
    for step in check.steps:
        assert run.right and not run.failed
        who = step.variable if step.access == "wake" else step.who
        run.step(names.index(who))
        if step.variable in run.memory and not step.variable.startswith("buf") and step.access != "take":
            assert run.memory[step.variable] == step.value
    assert run.failed if check.verdict == "assert" else not run.right


# -------------------------------------------------------------------------------------------------- the search as a search


@pytest.mark.parametrize("schedule", SCHEDULES)
@pytest.mark.parametrize("variant", VARIANTS)
def test_merging_positions_hides_no_state(variant, schedule):
    """Histories kept apart, level by level, reach the same contents of memory."""

    def levels(merge: bool) -> list[set]:
        machine = Machine(variant, Ring(messages=1, bytes=2, capacity=2), schedule, merge)
        here, found = {machine.initial}, []
        for _ in range(9):
            after = set()
            for state in here:
                for thread in machine.can_step(state):
                    reached, wrong = machine.step(state, thread)
                    after |= set() if wrong else {reached}
            here = after
            found.append({state[len(machine.names) :] for state in here})
        return found

    assert levels(merge=True) == levels(merge=False)


@pytest.mark.parametrize("variant", ["published-first", "published-first-mutex", "store-first"])
def test_no_shorter_way_fails(variant):
    """All schedules of fewer steps, one by one."""
    machine = Machine(variant, default_ring(variant))
    ways, shortest = [machine.initial], len(check_sink(variant).steps)
    for _ in range(shortest - 1):
        steps = [machine.step(state, thread) for state in ways for thread in machine.can_step(state)]
        assert not any(wrong for _, wrong in steps)
        ways = [state for state, _ in steps]
    assert any(machine.step(state, thread)[1] for state in ways for thread in machine.can_step(state))


def test_a_spent_budget_is_no_verdict():
    states = check_sink("sequence").states
    assert check_sink("sequence", budget=states).verdict == "ok"
    short = check_sink("sequence", budget=states - 1)
    assert (short.verdict, short.states, short.steps) == ("undecided", states - 1, ())
    assert str(states - 1) in short.reason


def test_a_failure_found_within_the_budget_is_a_verdict():
    assert check_sink("published-first", budget=60).verdict == "stale"


def test_the_circle_of_a_livelock_closes():
    for variant in ("commit-index", "ordered"):
        for schedule in ("higher", "lowest"):
            machine = Machine(variant, default_ring(variant), schedule)
            found, states = search(machine), [machine.initial]
            for thread in found.schedule:
                assert thread in machine.can_step(states[-1])
                states.append(machine.step(states[-1], thread)[0])
            assert states[found.loop] == states[-1] and found.loop < len(found.schedule)
            assert check_sink(variant, schedule=schedule).loop == found.loop + 1


# --------------------------------------------------------------------------------------------------------------- history


@pytest.mark.parametrize("schedule", SCHEDULES)
@pytest.mark.parametrize("variant", VARIANTS)
def test_every_read_names_the_write_that_it_read_from(variant, schedule):
    steps = check_sink(variant, schedule=schedule).steps
    assert [step.number for step in steps] == list(range(1, len(steps) + 1))
    stored: dict[str, tuple[int, object]] = {}
    for step in steps:
        if step.source is not None and step.access in ("read", "cas", "fetch-add"):
            number, value = stored.get(step.variable, (0, step.value if step.access == "read" else step.before))
            assert step.source == number
            assert (step.value if step.access == "read" or not step.succeeded else step.before) == value or not number
        if step.before is not None:
            stored[step.variable] = (step.number, step.value)
        assert str(step).startswith(step.who) and step.who in ("P1", "P2", "consumer", "tick")


def test_as_dict_has_the_question_and_the_answer():
    told = check_sink("published-first").as_dict()
    assert told["verdict"] == "stale" and told["steps"] == 5 == len(told["counterexample"])
    assert told["counterexample"][3] == {
        "number": 4, "who": "consumer", "access": "read", "variable": "write", "value": 0, "before": None,
        "succeeded": True, "source": 3, "text": "consumer reads write: 0",
    }  # fmt: skip
    assert "5 consumer reads buf[1]: never written" in str(check_sink("published-first"))


@pytest.mark.parametrize(
    ("ask", "sentence"),
    [
        (lambda: check_sink("none"), "there is no variant 'none'; there are published-first, published-first-mutex"),
        (lambda: check_sink("sequence", schedule="fair"), "there is no schedule 'fair'; there are free, higher, equal, lowest"),
        (lambda: check_sink("sequence", budget=0), "the budget of states is 0; a whole number from 1 to 2000000 is allowed"),
        (lambda: Ring(capacity=0), "the capacity of the ring is 0; a whole number from 1 to 64 is allowed"),
        (lambda: Ring(modulus=1), "the modulus of the indices is 1; a whole number from 2 to 4294967296 is allowed"),
        (lambda: Ring(producers=9), "the number of producers is 9; a whole number from 1 to 8 is allowed"),
        (lambda: default_ring("sequence", capacity=-1), "the capacity of the ring is -1; a whole number from 1 to 64"),
    ],
)
def test_a_question_that_is_none(ask, sentence):
    with pytest.raises(ValueError, match="^" + sentence.replace("[", r"\[")):
        ask()
