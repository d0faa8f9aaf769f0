"""A notebook as one HTML file that needs no kernel, no server and no network: `render`."""

from labkit.pages.page import render

__all__ = ["render"]
