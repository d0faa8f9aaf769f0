"""The trace sink and the frames it may meet."""

from __future__ import annotations

import argparse

from labkit.commands.command import Add, print_json


def _check_sink(args: argparse.Namespace) -> None:
    from labkit.sink import check_sink, default_ring

    sizes = {name: getattr(args, name) for name in ("producers", "messages", "bytes", "capacity", "modulus", "dma")}
    check = check_sink(args.variant, default_ring(args.variant, **sizes), args.schedule, args.budget)
    if args.json:
        print_json(check.as_dict())
    else:
        print(check)


def _frames(args: argparse.Namespace) -> None:
    from labkit.sink import read_frames

    found = [reception.as_dict() for reception in read_frames(args.bursts)]
    if args.json:
        print_json(found)
        return
    for number, reception in enumerate(found, 1):
        values = "".join(f" {name}={value}" for name, value in reception.items() if name != "verdict")
        print(f"{number}: {reception['verdict']}{values}")


def add_to(add: Add) -> None:
    """The commands of this module with their options."""
    c = add("check-sink", _check_sink, "look at every interleaving of a variant of the trace sink for the shortest failure")
    c.add_argument(
        "--variant", required=True, metavar="V", help="such as published-first; an unknown one is answered with the list"
    )
    c.add_argument("--producers", type=int, metavar="N", help="tasks that write (default: 2)")
    c.add_argument("--messages", type=int, metavar="K", help="messages of each of them (default: 2)")
    c.add_argument("--bytes", type=int, metavar="B", help="bytes of a message (default: what the variant needs, 1 or 2)")
    c.add_argument("--capacity", type=int, metavar="C", help="slots of the ring (default: 2)")
    c.add_argument("--modulus", type=int, metavar="M", help="indices count modulo this (default: 8 times the capacity)")
    c.add_argument("--schedule", default="free", help="free, or the consumer's priority: higher, equal, lowest (default: free)")
    c.add_argument("--dma", action="store_true", help="a DMA sends the bytes, and notifies the consumer")
    c.add_argument("--budget", type=int, metavar="STATES", default=500_000, help="undecided after so many (default: %(default)s)")
    c.add_argument("--json", action="store_true")
    c = add("frames", _frames, "check receptions of velocity frames: 24 bytes of three doubles and their CRC-32/MPEG-2")
    c.add_argument("bursts", metavar="BURSTS.txt", help="one reception per line: the bytes between two idle times, in hex")
    c.add_argument("--json", action="store_true")
