"""For the Jupyter server that runs the lab: a kernel connection whose messages leave at once."""

from __future__ import annotations

import asyncio

from jupyter_server.services.kernels.connection.channels import ZMQChannelsWebsocketConnection


class PromptConnection(ZMQChannelsWebsocketConnection):
    """The server's own connection with Nagle's algorithm off.

    With it a reply that follows the kernel's small "busy" message waits until the browser has acknowledged that one, and
    browsers delay an acknowledgement by 40 ms.
    Chosen with `--ServerApp.kernel_websocket_connection_class=labkit.server.PromptConnection`.
    """

    def connect(self) -> asyncio.Future[None] | None:  # type: ignore[override]  # the server's class differs from its base in this
        self.websocket_handler.set_nodelay(True)
        return super().connect()
