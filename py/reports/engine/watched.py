"""Work in processes that are watched: what a task may do to its process is part of its answer.

A task that takes too much processor time, or ten times as much on the clock, is ended with its
process and answered ``{"verdict": "hang"}``; one that kills its process, as running out of memory
would, ``{"verdict": "died"}``.
"""

from __future__ import annotations

import multiprocessing
import os
import time
from collections.abc import Callable, Iterator
from multiprocessing.connection import Connection, wait
from pathlib import Path
from typing import Any


class Worker:
    """A process that answers tasks one at a time."""

    def __init__(self, function: Callable[[Any], dict[str, Any]]):
        spawn = multiprocessing.get_context("spawn")
        self.pipe, theirs = spawn.Pipe()
        self._process = spawn.Process(target=_serve, args=(function, theirs), daemon=True)
        self._process.start()
        theirs.close()
        self.task: Any = None
        self.begun = self.spent = 0.0

    def give(self, task: Any) -> None:
        """Starts a task."""
        self.task, self.begun, self.spent = task, time.monotonic(), self.processor_time()
        self.pipe.send(task)

    def processor_time(self) -> float:
        """Processor time of the process so far (s)."""
        fields = Path(f"/proc/{self._process.pid}/stat").read_text().rsplit(") ", 1)[1].split()
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")

    def late(self, limit: float) -> bool:
        """Returns whether the task took more than `limit` (s), or ten times that on the clock."""
        waited = time.monotonic() - self.begun
        return waited > limit and (
            waited > 10 * limit or self.processor_time() - self.spent > limit
        )

    def end(self) -> int | None:
        """Ends the process; its exit code, if it had ended by itself."""
        self._process.join(0.5)
        code = self._process.exitcode
        self._process.kill()
        self._process.join()
        self.pipe.close()
        return code


def answers(
    function: Callable[[Any], dict[str, Any]], tasks: Iterator[Any], jobs: int, limit: float
) -> Iterator[tuple[Any, dict[str, Any]]]:
    """Each task with its answer, in the order in which they are finished.

    Args:
        function: What answers a task, importable by name.
        tasks: What to answer.
        jobs: Processes at once.
        limit: Processor time for a task (s).
    """
    workers = [Worker(function) for _ in range(jobs)]
    busy: list[Worker] = []
    try:
        while True:
            for worker in workers:
                if worker not in busy and (task := next(tasks, None)) is not None:
                    worker.give(task)
                    busy.append(worker)
            if not busy:
                return
            ready = wait([worker.pipe for worker in busy], timeout=1.0)
            for worker in list(busy):
                found = _found(worker, worker.pipe in ready, limit)
                if found is None:
                    continue
                busy.remove(worker)
                if found["verdict"] in ("hang", "died"):
                    workers[workers.index(worker)] = Worker(function)
                yield worker.task, found
    finally:
        for worker in workers:
            worker.end()


def _found(worker: Worker, ready: bool, limit: float) -> dict[str, Any] | None:
    """Result of a worker's task, ``None`` while it runs."""
    seconds = time.monotonic() - worker.begun
    if ready:
        try:
            answer: dict[str, Any] = worker.pipe.recv()
        except (EOFError, ConnectionResetError):
            return {"verdict": "died", "why": f"exit code {worker.end()}", "seconds": seconds}
        return answer
    if worker.late(limit):
        worker.end()
        return {"verdict": "hang", "why": f"more than {limit:.0f} s", "seconds": seconds}
    return None


def _serve(function: Callable[[Any], dict[str, Any]], pipe: Connection) -> None:
    while True:
        try:
            task = pipe.recv()
        except EOFError:
            return
        pipe.send(function(task))
