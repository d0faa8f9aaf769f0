"""The exercises of notebook 13: each asks the model."""

from __future__ import annotations

from labkit.experiment import Feedback
from labkit.experiments.distributed_fusion import MS, DistributedFusion
from labkit.experiments.fusion_levels import FusionLevels
from labkit.experiments.one_fast_object import OneFastObject


def check_split(answer: float) -> Feedback:
    """Exercise: the least offset in ms on the slider at which the contours of a ball of 2 m/s become two balls."""
    least = next(ms for ms in range(0, 321, 20) if OneFastObject(speed=2.0, offset=ms).run().later.balls("contours") == 2)
    if isinstance(answer, bool) or not isinstance(answer, int | float):
        return Feedback(False, f"{answer!r} is no number of milliseconds; answer with one, such as 40")
    if answer != least:
        return Feedback(
            False, "not the least one; what is nearer than 25 cm is taken for one: how long does the ball take for that?"
        )
    return Feedback(True, f"in {least} ms it rolls {2 * least / 10:.0f} cm, more than the 25 cm that two elements may be apart")


def check_ghost(answer: object) -> Feedback:
    """Exercise: a scene of two stations that look at once and know where they stand: with elements fused there is a ghost, with
    contours there is none, and nothing is missed.
    """
    if not isinstance(answer, FusionLevels):
        return Feedback(False, "answer with a bench's position, such as FusionLevels(seed=1)")
    if answer.seed == FusionLevels().seed:
        return Feedback(False, "that is the scene of the bench as it stands; find another one")
    if answer.stations != 2 or answer.offset or answer.pose_error:
        return Feedback(False, "two stations, without an offset and without a pose error, are to see the ghost")
    team = answer.run()
    late, early = team.verdicts["elements"], team.verdicts["contours"]
    if not late.ghosts:
        return Feedback(False, "no ghost here when elements are fused; try other seeds")
    if early.ghosts or early.missed:
        return Feedback(False, "contours do not get everything right here, either; try other seeds")
    ghost = late.ghosts[0]
    return Feedback(True, f"a {ghost.kind} at {ghost.x:.1f}, {ghost.y:.1f} m that is none, and contours know better")


def check_threshold(answer: float) -> Feedback:
    """Exercise: the least threshold SW in ms with which all fusions of the bench are coherent if mirrors take up to 20 ms."""
    result = DistributedFusion(mirror=20).run()
    least = next((ms for ms in range(101) if result.coherent(ms * MS) == 1), None)
    if isinstance(answer, bool) or not isinstance(answer, int | float):
        return Feedback(False, f"{answer!r} is no number of milliseconds; answer with one, such as 40")
    if answer != least:
        share = result.coherent(round(answer * MS))
        return Feedback(False, f"{100 * share:.0f} % of the fusions are coherent by it; look for the least one with all of them")
    return Feedback(True, f"{least} ms is enough here; (5.1) asks for 20 ms and the clocks' error, as another seed may draw more")
