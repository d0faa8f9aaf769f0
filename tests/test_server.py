"""The kernel connection that sends at once, and that `make lab` uses it."""

import re
from pathlib import Path

import pytest
from jupyter_server.services.kernels.connection.channels import ZMQChannelsWebsocketConnection
from jupyter_server.services.kernels.websocket import KernelWebsocketHandler
from traitlets.utils.importstring import import_item

from labkit.server import PromptConnection


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


def test_make_lab_uses_it():
    recipe = (Path(__file__).parents[1] / "Makefile").read_text(encoding="utf-8")
    name = re.search(r"--ServerApp.kernel_websocket_connection_class=(\S+)", recipe)[1]
    assert import_item(name) is PromptConnection
