"""The ``ruffini`` command: one module per subcommand.

Exit status: 0, 1 for a failed computation, 2 for bad input, 130 if interrupted.
"""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Sequence
from typing import Any, NoReturn

from ruffini import SimulationError, __version__
from ruffini._words import nearest
from ruffini.commands import (
    agent,
    calibrate,
    dataset,
    mesh,
    network,
    play,
    press,
    recommend,
    sensor,
    view,
)

_COMMANDS = (play, view, agent, dataset, network, press, mesh, sensor, calibrate, recommend)


class _Parser(argparse.ArgumentParser):
    """Parser whose errors name the nearest option or choice, and the command that they are of.

    An option is not understood by a part of its name, which may be a slip.
    """

    def __init__(self, *args: Any, **options: Any) -> None:
        super().__init__(*args, **{"allow_abbrev": False} | options)

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        options, rest = super().parse_known_args(args, namespace)
        if rest:
            known = re.findall(r"--[\w-]+", self.format_usage())
            near = nearest(rest[0].split("=")[0], known) if rest[0].startswith("-") else ","
            self.error(f"unrecognized arguments: {' '.join(rest)}{near}".rstrip(","))
        return options, rest

    def error(self, message: str) -> NoReturn:
        if found := re.fullmatch(r"(.*)invalid choice: '(.*)' \(choose from (.*)\)", message):
            about, word, choices = found.groups()
            known = choices.replace("'", "").split(", ")
            message = f"{about}found {word!r}{nearest(word, known)} expected one of "
            message += ", ".join(known)
        super().error(message)


def parser() -> argparse.ArgumentParser:
    """Parser of the command with all of its subcommands."""
    whole = _Parser(prog="ruffini", description="Grasping with soft tactile fingertips.")
    whole.add_argument("--version", action="version", version=__version__)
    commands = whole.add_subparsers(metavar="command", required=True)
    for command in _COMMANDS:
        command.add_to(commands)
    return whole


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command with `arguments`, or those of the process; return the exit status."""
    words = sys.argv[1:] if arguments is None else list(arguments)
    if words[:1] == ["demo"]:  # Another name of it, which is not listed.
        words[0] = "play"
    try:
        if words[:1] in (["train"], ["evaluate"]):
            ours, gels = (f"ruffini {part} {words[0]}" for part in ("agent", "network"))
            raise ValueError(f"{words[0]}: expected {ours}, or for models of the gel {gels}")
        options = parser().parse_args(words or ["--help"])
        options.run(options)
    except SimulationError as error:
        print(f"ruffini: {error}", file=sys.stderr)
        return 1
    except (ImportError, ValueError) as error:
        print(f"ruffini: {error}", file=sys.stderr)
        return 2
    except OSError as error:
        where = "" if error.filename is None else f"{error.filename}: "
        print(f"ruffini: {where}{error.strerror or error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("\nruffini: stopped", file=sys.stderr)
        return 130
    return 0
