"""Common parts of all reports: rows that are kept, tables and text, figures, the command line.

A report is a module with ``make(options)``, which gives its figures as they stand in
``tests/reports/<name>.json``, ``page(report)``, the Markdown of them, and where it needs them
``figure(report)``, a picture, ``options(parser)`` and ``also(report, out, options)``. With
``ONE_THREAD`` it runs on one where it does not ask for more.
"""

import sys

from matplotlib import pyplot as plt

from engine.figures import COLOURS, readable
from engine.pages import filled, grid, made, spread, table, text
from engine.rows import KEPT, OUT, ROOT, Rows, machine, quantiles, run

# Reports time steps with the functions of policies/timing.py.
sys.path.append(str(ROOT / "policies"))

__all__ = ["COLOURS", "KEPT", "OUT", "ROOT", "Rows", "filled", "grid", "machine", "made", "plt"]
__all__ += ["quantiles", "readable", "run", "spread", "table", "text"]
