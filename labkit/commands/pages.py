"""Notebooks as pages."""

from __future__ import annotations

import argparse

from labkit.commands.command import Add


def _render(args: argparse.Namespace) -> None:
    from labkit.pages import render

    benches = render(args.notebook, args.out)
    print(f"{args.out}: {benches} benches with their default pictures")


def add_to(add: Add) -> None:
    """The commands of this module with their options."""
    c = add("render", _render, "run a notebook and write it as one HTML file that needs neither kernel nor network")
    c.add_argument("notebook", metavar="NOTEBOOK.ipynb", help="its cells are run: render only what you would run")
    c.add_argument("--out", required=True, metavar="FILE.html")
