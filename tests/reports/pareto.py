"""Error against run time of every answerer: makes pareto.json, pareto.md and pareto.svg.

    python tests/reports/pareto.py            an hour of one core; goes on after a stop
    python tests/reports/pareto.py --quick    a few presses and answerers, into target/reports/quick

Judged by finite elements on the finest mesh, never by an answerer's own. The full form also writes
what `ruffini recommend` reads, py/python/ruffini/answerers.json. Held-out grasps are those of
~/.cache/ruffini/grasps-63x10x10, left out where there are none: `ruffini dataset generate` with
``--grasps 10 --frames 10`` makes them. So are networks that are not shipped, which `networks.py
--data PRESSES --sizes --papers GRASPS --runs ~/.cache/ruffini/networks` trains. Batches come last,
by the clock: all else on the machine must rest.
"""

from __future__ import annotations

import json
import multiprocessing
import time
from functools import lru_cache
from pathlib import Path

import pareto_batch
from kept import HERE, KEPT, ROOT, Rows, arguments, folder, header
from pareto_answerers import ANSWERERS, ELEMENTS, FEW, Gel, fem
from pareto_cases import Case, Fields, cases
from pareto_pages import chosen, markdown, renewed, summary
from pareto_plots import figure

from ruffini import PressError

PARTS = ("geometry", "deformation", "contact", "fem", "compliance", "surrogate")
MADE_OF = [f"env-core/src/{part}" for part in PARTS]
MADE_OF += ["env-core/assets", "tests/reports/pareto_cases.py"]
"""What the figures come from, under the root."""
FINEST = {"full": 5000, "quick": 2500}
"""Nodes of the mesh of the truth, p1-bar."""
REPEATS = 3
"""Times that a press is answered where that is quick; the fastest counts."""
JOBS = 2
CHOICE = ROOT / "py/python/ruffini/answerers.json"


@lru_cache(maxsize=2)
def model(name: str, gel: Gel) -> tuple:
    """An answerer of a gel, and the CPU time that making it took (s)."""
    begun = time.process_time()
    made = ANSWERERS[name].make(gel)
    return made, time.process_time() - begun


def truth(case: Case, nodes: int, kept: Path) -> Fields | None:
    """What the finest mesh says, kept in a file; ``None`` where it has no answer."""
    file = kept / f"{case.panel}-{case.name.replace('/', '-')}.npz"
    if not file.exists():
        judge = fem("p1-bar", nodes).make(case.gel)
        frames = judge.solve_path(case.press())
        if isinstance(frames[-1], PressError):
            return None
        Fields.carried(case.gel, judge.body.mesh, frames).write(file)
    return Fields.read(file)


def answered(case: Case, name: str) -> tuple[Fields | None, dict]:
    """A press answered by name: its fields, and CPU time a frame (s) or why there is none."""
    made, setup = model(name, case.gel)
    if name == "bonded layer":
        return None, closed_form(case, made)
    seconds: list[float] = []
    while len(seconds) < REPEATS and sum(seconds) * len(case.path) < 1.0:
        begun = time.process_time()
        frames = made.solve_path(case.press())
        seconds.append((time.process_time() - begun) / len(case.path))
    if isinstance(frames[-1], PressError):
        return None, {"failed": frames[-1].kind}
    fields = Fields.carried(case.gel, made.body.mesh, frames)
    if hasattr(made, "knows"):
        fields.known = [made.knows(frame) for frame in frames]
    return fields, {"seconds": min(seconds), "setup": setup}


def closed_form(case: Case, layer) -> dict:
    """The closed form's force on a ball, its cost a Python call's."""
    if case.ball is None:
        return {"failed": "no ball"}
    begun = time.process_time()
    for _ in range(100):
        force = layer.force(*case.ball)
    return {"seconds": (time.process_time() - begun) / 100 / len(force), "normal": force.tolist()}


def row(case: Case, name: str, judges: dict[str, Fields]) -> dict:
    """Errors of an answerer at a press against the finest mesh and against `ELEMENTS`."""
    fields, found = answered(case, name)
    found |= {"key": key(case, name), "panel": case.panel, "answerer": name}
    for judge, true in judges.items():
        if fields is not None and name != judge:
            found[judge] = fields.errors(true, case.judged)
        elif "normal" in found:
            pairs = zip(found["normal"], -true.force[:, 2], strict=True)
            off = [abs(normal / force - 1) if force > 0 else None for normal, force in pairs]
            felt = [off[frame] for frame in case.judged if off[frame] is not None]
            found[judge] = {"force": felt} if felt else {}
    return found


def key(case: Case, name: str) -> str:
    """What a row is known by."""
    return f"{case.panel}/{case.name}/{name}"


def task(work: tuple[bool, int, int, list[str], int, Path]) -> list[dict]:
    """Rows of the press of that number, for some of the answerers."""
    quick, most, number, names, nodes, kept = work
    case = list(cases(quick, most))[number]
    finest = truth(case, nodes, kept)
    if finest is None:
        failed = {"failed": "not solved on the finest mesh", "panel": case.panel}
        return [failed | {"key": key(case, name), "answerer": name} for name in names]
    elements, _ = answered(case, ELEMENTS)
    judges = {"finest": finest} | ({ELEMENTS: elements} if elements else {})
    return [row(case, name, judges) for name in names]


def run(rows: Rows, form: str, asked: list[str], most: int, jobs: int, kept: Path) -> None:
    """Asks for every press that is not among the rows."""
    quick = form == "quick"
    files = {name: ANSWERERS[name].file for name in asked}
    there = [name for name, file in files.items() if file is None or file.exists()]
    if lacking := [name for name in asked if name not in there]:
        print(f"left out, not trained: {', '.join(lacking)}", flush=True)
    work = []
    for number, case in enumerate(cases(quick, most)):
        if names := [name for name in there if key(case, name) not in rows]:
            work.append((quick, most, number, names, FINEST[form], kept))
    with multiprocessing.get_context("spawn").Pool(jobs, pareto_batch.use_threads, (1,)) as pool:
        for found in pool.imap_unordered(task, work):
            for one in found:
                rows.add(one)
            print(found[0]["key"].rsplit("/", 1)[0], flush=True)
    for name in there:
        for found in pareto_batch.missing(rows, name, quick):
            rows.add(found)
            print(found["key"], flush=True)


def main() -> None:
    """Runs what is missing and writes the files."""
    parser = arguments(__doc__)
    parser.add_argument("--presses", type=int, default=14, help="most of a panel; 14 if not given")
    parser.add_argument("--jobs", type=int, default=JOBS, help=f"processes; {JOBS} if not given")
    parser.add_argument(
        "--again", nargs="+", choices=list(ANSWERERS), help="only these; the others as they stand"
    )
    options = parser.parse_args()
    form = "quick" if options.quick else "full"
    known = header(MADE_OF, {"nodes of the truth": FINEST[form]})
    asked = FEW if options.quick else list(ANSWERERS)
    if options.again:
        asked = [ELEMENTS, *(name for name in options.again if name != ELEMENTS)]
    rows = Rows(KEPT / form / f"pareto{'-again' * bool(options.again)}.jsonl", known)
    kept = KEPT / form / f"truth-{known['commit']}"
    run(rows, form, asked, options.presses, options.jobs, kept)
    out, found = folder(parser, options), known | {"note": options.note} | summary(list(rows))
    report = found
    if options.again:
        before = json.loads((HERE / "pareto.json").read_text())
        report = before | {"note": options.note} | renewed(before, found, options.again)
    (out / "pareto.json").write_text(json.dumps(report, indent=1) + "\n")
    (out / "pareto.md").write_text(markdown(report))
    figure(report, out / "pareto.svg")
    if out == HERE:
        CHOICE.write_text(json.dumps(chosen(report), indent=1) + "\n")


if __name__ == "__main__":
    main()
