"""The kernel connection that sends at once, and that `make lab` uses it."""

import re
import subprocess
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


def test_make_lab_uses_it_and_asks_for_no_echo():
    root = Path(__file__).parents[1]
    recipe = subprocess.run(["make", "-n", "lab"], cwd=root, capture_output=True, text=True, check=True).stdout
    name = re.search(r"--ServerApp.kernel_websocket_connection_class=(\S+)", recipe)[1]
    assert import_item(name) is PromptConnection
    assert "JUPYTER_WIDGETS_ECHO=0 " in recipe
