"""Loaded before every other plugin of pytest, see pyproject.toml.

nbval imports jsonschema, and that a package which compiles 38 grammars at its import, 1.5 s in every process, to check addresses
with letters beyond ASCII. Nothing here has such a check; without the package jsonschema leaves it out.
"""

import sys

sys.modules["rfc3987_syntax"] = None
