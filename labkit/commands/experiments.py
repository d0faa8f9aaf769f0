"""Every experiment without a notebook."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from labkit.commands.command import Add, print_json

if TYPE_CHECKING:
    from labkit.experiment import Parameter


def _list(args: argparse.Namespace) -> None:
    from labkit.experiments import experiments, find

    known = {args.name: find(args.name)} if args.name else experiments()
    if args.json:
        print_json(
            {
                name: {
                    "title": cls.title(),
                    "parameters": {
                        p.name: {"default": p.default, "unit": p.unit, "allowed": p.allowed(), "doc": p.doc}
                        for p in cls.parameters()
                    },
                }
                for name, cls in known.items()
            }
        )
        return
    width = max(map(len, known))
    for name, cls in known.items():
        print(f"{name:{width}}  {cls.title()}")
    if args.name:
        for p in known[args.name].parameters():
            print(f"    {p.name} = {p.default}   {p.doc} ({p.allowed()})")


def _run(args: argparse.Namespace) -> None:
    from labkit.experiment import ParameterError
    from labkit.experiments import find

    cls = find(args.name)
    types = {p.name: p for p in cls.parameters()}
    values = {}
    for item in args.set:
        key, equals, text = item.partition("=")
        if not equals:
            raise ParameterError(f"--set {item!r} has no '='; write --set name=value")
        values[key] = _value(text, types[key]) if key in types else text
    experiment = cls(**values)
    with _progress():
        result = experiment.run()
    metrics = experiment.metrics(result)
    if args.json:
        print_json({"experiment": cls.name(), "parameters": experiment.model_dump(), "metrics": [asdict(m) for m in metrics]})
        return
    print(experiment.code())
    for m in metrics:
        beside = "".join(
            f"   ({word}: {value} {m.unit})"
            for word, value in (("bound", m.bound), ("published", m.published))
            if value is not None
        )
        print(f"    {m.name}: {m.text()}{beside}{'   ' + m.note if m.note else ''}")


@contextmanager
def _progress() -> Iterator[None]:
    """Shows on standard error how far a slow run is, if someone is watching."""
    from labkit.experiment import progress_listener

    if sys.stderr is None or not sys.stderr.isatty():
        yield
        return
    token = progress_listener.set(lambda done: print(f"\r{done:4.0%}", end="", file=sys.stderr, flush=True))
    try:
        yield
    finally:
        progress_listener.reset(token)
        print("\r    \r", end="", file=sys.stderr, flush=True)


def _value(text: str, parameter: Parameter) -> Any:
    """Text of the command line as the parameter's type; what does not fit is left for the validation to name."""
    if parameter.type is bool:
        return {"true": True, "yes": True, "1": True, "false": False, "no": False, "0": False}.get(text.lower(), text)
    if parameter.type in (int, float):
        try:
            return parameter.type(text)
        except ValueError:
            return text
    return text


def add_to(add: Add) -> None:
    """The commands of this module with their options."""
    c = add("list", _list, "list the experiments, or the parameters of one")
    c.add_argument("name", nargs="?")
    c.add_argument("--json", action="store_true")
    c = add("run", _run, "run one experiment and print its numbers")
    c.add_argument("name")
    c.add_argument("--set", action="append", default=[], metavar="NAME=VALUE", help="a parameter; may be repeated")
    c.add_argument("--json", action="store_true")
