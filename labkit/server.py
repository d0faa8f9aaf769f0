"""For the Jupyter server that runs the lab: a kernel connection that keeps a moved slider from being anybody else's business."""

from __future__ import annotations

import asyncio
from typing import Any

from jupyter_server.services.kernels.connection.channels import ZMQChannelsWebsocketConnection

#: Seconds after which a kernel that works on a widget's message is called busy.
BUSY_AFTER = 0.2

_HEADER, _PARENT, _CONTENT = 1, 2, 4  # parts of a message behind its addressees


class PromptConnection(ZMQChannelsWebsocketConnection):
    """The server's own connection, but messages leave at once, and the page is not told of a kernel that is busy for an instant.

    With Nagle's algorithm on, a reply that follows a small message waits until the browser has acknowledged that one, and
    browsers delay an acknowledgement by 40 ms. And a kernel calls itself busy and then idle for each step of a slider: JupyterLab
    lays out its toolbar anew for both, before and after it gets to the picture. What takes longer than `BUSY_AFTER` is told.

    Chosen with `--ServerApp.kernel_websocket_connection_class=labkit.server.PromptConnection`.
    """

    def __init__(self, **more: Any) -> None:
        super().__init__(**more)
        self._busy: dict[str, asyncio.TimerHandle] = {}  # by the message that the kernel works on

    def connect(self) -> asyncio.Future[None] | None:  # type: ignore[override]  # the server's class differs from its base in this
        self.websocket_handler.set_nodelay(True)
        return super().connect()

    def disconnect(self) -> None:  # type: ignore[override]  # here, too
        while self._busy:
            self._busy.popitem()[1].cancel()
        super().disconnect()

    def handle_outgoing_message(self, stream: Any, outgoing_msg: list[Any]) -> None:
        state, cause = self._status(stream, outgoing_msg)
        if state == "busy":
            loop = asyncio.get_running_loop()
            self._busy[cause] = loop.call_later(BUSY_AFTER, self._tell, cause, stream, outgoing_msg)
            return
        if state == "idle" and (untold := self._busy.pop(cause, None)):
            untold.cancel()
        super().handle_outgoing_message(stream, outgoing_msg)

    def _tell(self, cause: str, stream: Any, message: list[Any]) -> None:
        del self._busy[cause]
        super().handle_outgoing_message(stream, message)

    def _status(self, stream: Any, message: list[Any]) -> tuple[str, str]:
        """What the kernel says of itself because of a widget's message, and the id of that; ("", "") for any other message."""
        if stream is not self.channels.get("iopub"):
            return "", ""
        parts = self.session.feed_identities(message)[1]
        if self.session.unpack(parts[_HEADER])["msg_type"] != "status":
            return "", ""
        parent = self.session.unpack(parts[_PARENT])
        if parent.get("msg_type") != "comm_msg":
            return "", ""
        return self.session.unpack(parts[_CONTENT]).get("execution_state", ""), parent["msg_id"]
