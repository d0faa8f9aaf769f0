"""The kernel connection that sends at once and keeps an instant of work to itself, and that `make lab` uses it."""

import asyncio
import re
import subprocess
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from jupyter_client.session import Session
from jupyter_server.services.kernels.connection.channels import ZMQChannelsWebsocketConnection
from jupyter_server.services.kernels.websocket import KernelWebsocketHandler
from traitlets.utils.importstring import import_item

from labkit.server import BUSY_AFTER, PromptConnection


class Handler(KernelWebsocketHandler):
    """Notes what happens, in order; knows no server."""

    def __init__(self) -> None:
        self.seen: list[object] = []

    def set_nodelay(self, value: bool) -> None:
        self.seen.append(("nodelay", value))


def test_nothing_is_held_back_once_the_page_is_connected(monkeypatch: pytest.MonkeyPatch):
    handler = Handler()
    monkeypatch.setattr(ZMQChannelsWebsocketConnection, "connect", lambda self: self.websocket_handler.seen.append("connected"))
    PromptConnection(websocket_handler=handler).connect()
    assert handler.seen == [("nodelay", True), "connected"]


def told(monkeypatch: pytest.MonkeyPatch, *, cause: str, pause: float, channel: str = "iopub") -> list[str]:
    """The states that reach the page when a kernel says busy, and `pause` seconds later idle, because of a message."""
    passed: list[str] = []
    session = Session(key=b"secret")

    def pass_on(self, stream: object, message: list[bytes]) -> None:
        _, parts = self.session.feed_identities(message)
        passed.append(self.session.deserialize(parts)["content"]["execution_state"])

    monkeypatch.setattr(ZMQChannelsWebsocketConnection, "handle_outgoing_message", pass_on)
    connection = PromptConnection(websocket_handler=Handler(), session=session)
    iopub = object()
    connection.channels = {"iopub": iopub, "shell": object()}
    parent = session.msg(cause)

    async def work() -> None:
        for state in ("busy", "idle"):
            message = session.serialize(session.msg("status", {"execution_state": state}, parent=parent), ident=b"kernel.status")
            connection.handle_outgoing_message(connection.channels[channel], message)
            await asyncio.sleep(pause)
        await asyncio.sleep(1.5 * BUSY_AFTER)

    with ThreadPoolExecutor(1) as thread:  # in this one a browser's event loop may run
        thread.submit(asyncio.run, work()).result()
    return passed


def test_the_page_is_told_of_a_widgets_work_only_if_it_takes_time(monkeypatch: pytest.MonkeyPatch):
    assert told(monkeypatch, cause="comm_msg", pause=0) == ["idle"]
    assert told(monkeypatch, cause="comm_msg", pause=2 * BUSY_AFTER) == ["busy", "idle"]


def test_the_page_is_told_of_all_other_work(monkeypatch: pytest.MonkeyPatch):
    assert told(monkeypatch, cause="execute_request", pause=0) == ["busy", "idle"]
    assert told(monkeypatch, cause="comm_msg", pause=0, channel="shell") == ["busy", "idle"]


def test_make_lab_uses_it_and_asks_for_no_echo():
    root = Path(__file__).parents[1]
    recipe = subprocess.run(["make", "-n", "lab"], cwd=root, capture_output=True, text=True, check=True).stdout
    name = re.search(r"--ServerApp.kernel_websocket_connection_class=(\S+)", recipe)[1]
    assert import_item(name) is PromptConnection
    assert "JUPYTER_WIDGETS_ECHO=0 " in recipe
