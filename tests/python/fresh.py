"""Calls in an interpreter of their own."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path


def fresh(call: Callable[..., bytes], *arguments: object) -> bytes:
    """Returns what `call` returns in a new interpreter, which gets five minutes.

    A process that has run other tests has threads of other libraries, and a child that is forked
    from it inherits each lock that one of them holds at that moment, held for ever.
    """
    module, name = call.__module__, call.__name__
    code = f"import sys, {module}; sys.stdout.buffer.write({module}.{name}(*{arguments!r}))"
    line = [sys.executable, "-W", "ignore::DeprecationWarning", "-c", code]
    done = subprocess.run(line, capture_output=True, cwd=Path(__file__).parent, timeout=300)
    assert done.returncode == 0, done.stderr.decode()
    return done.stdout
