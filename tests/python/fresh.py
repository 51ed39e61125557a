"""Calls in an interpreter of their own, and code that Ctrl-C ends."""

from __future__ import annotations

import os
import resource
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path


def fresh(call: Callable[..., bytes], *arguments: object) -> bytes:
    """Returns what `call` returns in a new interpreter, which gets five minutes.

    A process that has run other tests has threads of other libraries, and a child that is forked
    from it inherits each lock that one of them holds at that moment, held for ever.
    """
    module, name = call.__module__, call.__name__
    code = f"import sys, {module}; sys.stdout.buffer.write({module}.{name}(*{arguments!r}))"
    # Python warns of a fork where there are threads by a DeprecationWarning.
    strict = ["-W", "error", "-W", "ignore::DeprecationWarning"]
    line = [sys.executable, *strict, "-c", code]
    done = subprocess.run(line, capture_output=True, cwd=Path(__file__).parent, timeout=300)
    assert done.returncode == 0, done.stderr.decode()
    return done.stdout


def interrupted(code: str, after: float = 2.0) -> tuple[float, float, bytes]:
    """Time (s) in which code ends that is interrupted so long (s) after it has printed a line.

    With the processor time (s) that it takes for that, and what it says on standard error.
    """
    before = _seconds(resource.getrusage(resource.RUSAGE_CHILDREN))
    line = [sys.executable, "-u", "-c", code]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    with subprocess.Popen(line, **pipes, preexec_fn=_heed) as run:
        try:
            run.stdout.readline()
            time.sleep(after)
            begun, spent = time.monotonic(), _spent(run.pid)
            run.send_signal(signal.SIGINT)
            _, said = run.communicate(timeout=60)
        finally:
            run.kill()
    took = time.monotonic() - begun
    whole = _seconds(resource.getrusage(resource.RUSAGE_CHILDREN)) - before
    return took, whole - spent, said


def _seconds(usage: resource.struct_rusage) -> float:
    return usage.ru_utime + usage.ru_stime


def _spent(pid: int) -> float:
    """Processor time (s) of a process so far."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return sum(map(int, fields[11:13])) / os.sysconf("SC_CLK_TCK")


def _heed() -> None:
    """A background job starts with the signal ignored."""
    signal.signal(signal.SIGINT, signal.default_int_handler)
