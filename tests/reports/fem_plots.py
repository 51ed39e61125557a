"""The picture of the finite-element report: fem.svg from what fem.json holds."""

from __future__ import annotations

from pathlib import Path

import matplotlib
from fem_pages import DATA, accuracies, best_mini, cases

matplotlib.use("svg")
import matplotlib.pyplot as plt


def figure(report: dict, path: Path) -> None:
    """Errors by mesh at each Poisson's ratio, the Mini's force, seconds a frame."""
    plots = [error_plot("force_error", "force"), error_plot("displacement_error", "displacement")]
    plots += [error_plot("von_mises_error", "von Mises stress"), cost_plot, mini_plot, speed_plot]
    # Glyphs as text and a fixed seed: the file changes only with the figures.
    with plt.rc_context({"svg.fonttype": "none", "svg.hashsalt": "fem", "font.size": 8}):
        picture, axes = plt.subplots(2, 3, figsize=(12, 7), layout="constrained")
        for plot, axis in zip(plots, axes.flat, strict=True):
            plot(report, axis)
            axis.grid(alpha=0.3)
        picture.savefig(path, metadata={"Date": None})
        plt.close(picture)


STYLES = {"p1": ":", "p1-bar": "-", "p2": "--"}


def error_plot(key: str, title: str):
    """A plot of one error at 1 mm against the vertices of the mesh."""

    def plot(report: dict, axis) -> None:
        for colour, case in enumerate(accuracies(report)):
            for element, style in STYLES.items():
                rows = [row for row in solved(case) if row["element"] == element]
                x = [row["vertices"] for row in rows]
                y = [100 * abs(row["depths"]["1.0"][key]) for row in rows]
                label = f"ν {case['poisson']}" if element == DATA else None
                axis.loglog(x, y, style, marker=".", color=f"C{colour}", label=label)
        axis.set(title=f"Error of {title} at 1 mm", xlabel="vertices", ylabel="%")
        axis.legend(title="p1 dotted, p2 dashed", fontsize=7)

    return plot


def cost_plot(report: dict, axis) -> None:
    """CPU seconds a frame against the error of displacement, all Poisson's ratios."""
    for colour, element in enumerate(STYLES):
        rows = [r for case in accuracies(report) for r in solved(case) if r["element"] == element]
        x = [row["cpu_seconds"] for row in rows]
        y = [100 * row["depths"]["1.0"]["displacement_error"] for row in rows]
        axis.loglog(x, y, ".", color=f"C{colour}", label=element)
    axis.set(title="Error of displacement by cost", xlabel="CPU s a frame", ylabel="%")
    axis.legend()


def mini_plot(report: dict, axis) -> None:
    """Measured force, every calibration, closed forms."""
    measured = report["scene"]["measured"]
    x = [float(depth) for depth in measured]
    axis.loglog(x, list(measured.values()), "ko", label="measured (FEATS)")
    for case in best_mini(report):
        name, friction = case["calibration"], case["friction"]
        colour = f"C{list(report['closed_forms']).index(name)}"
        style = "-" if friction >= 1 else "--"
        y = [case["force"][depth] for depth in measured]
        axis.loglog(x, y, style, color=colour, label=f"{name}, μ {friction}, {case['element']}")
    for form, style in [("hertz", ":"), ("dimitriadis", "-.")]:
        for colour, (name, forms) in enumerate(report["closed_forms"].items()):
            label = f"{form.capitalize()}, {name}"
            y = [forms[form][depth] for depth in measured]
            axis.loglog(x, y, style, color=f"C{colour}", label=label)
    axis.set(title="GelSight Mini, ball of 7.5 mm", xlabel="depth (mm)", ylabel="N")
    axis.legend(fontsize=6, handlelength=4)


def speed_plot(report: dict, axis) -> None:
    """CPU seconds a frame against nodes."""
    for friction, marker in [(0.0, "o"), (0.5, "s")]:
        rows = [case for case in cases(report, "speed") if case["friction"] == friction]
        x, y = ([row[key] for row in rows] for key in ("vertices", "cpu_seconds"))
        axis.loglog(x, y, marker=marker, label=f"{DATA}, μ {friction}")
    axis.set(title="Cost of a 0.1 mm frame", xlabel="nodes", ylabel="CPU s")
    axis.legend()


def solved(case: dict) -> list[dict]:
    """The meshes of a Poisson's ratio that gave an answer."""
    return [row for row in case["rows"] if "failed" not in row]
