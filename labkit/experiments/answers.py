"""What every exercise asks of an answer before it asks the model: the right kind of thing, and only that moved which may move."""

from __future__ import annotations

from typing import Any

from labkit.checks import shown
from labkit.experiment import Experiment, Feedback


def refused(answer: Any, given: Experiment[Any], *movable: str) -> Feedback | None:
    """A sentence if an answer is no experiment of the kind given, or moves what has to stay; None if it may be judged.

    Args:
        answer: whatever was typed.
        given: the experiment of the exercise; parameters that only change its view never count.
        movable: names of the parameters that are the reader's.
    """
    kind = type(given).__name__
    if not isinstance(answer, type(given)):
        line = f"{kind}({movable[0]}={getattr(given, movable[0])!r})"
        return Feedback(
            False, f"the answer is {shown(answer)}; it has to be a setting of the bench, without quotes, like {line}."
        )
    fixed = [p for p in given.parameters() if not p.view and p.name not in movable]
    moved = [f"{p.name}={getattr(given, p.name)!r}" for p in fixed if getattr(answer, p.name) != getattr(given, p.name)]
    if moved:
        return Feedback(False, f"move {' and '.join(movable)} only; leave {', '.join(moved)}.")
    return None


def called(answer: Any, like: str, *arguments: Any) -> Any:
    """What a function of the reader's returns, or a sentence (Feedback) where it is none or breaks off.

    Args:
        answer: whatever was typed.
        like: what it should look like.
        arguments: what it is called with.
    """
    if not callable(answer):
        return Feedback(False, f"the answer is {shown(answer)}; it has to be a function, like {like}.")
    try:
        return answer(*arguments)
    except Exception as error:  # the reader's own code may break in any way
        return Feedback(False, f"your function breaks off with {type(error).__name__}: {str(error).rstrip('.')}.")
