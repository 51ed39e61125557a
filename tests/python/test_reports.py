"""Reports: their pages and tables, what they keep, and the measures by which they judge."""

from __future__ import annotations

import importlib
import json
import re
import sys
from argparse import Namespace
from pathlib import Path

import numpy as np
import pytest

import ruffini
from ruffini._frames import turned

ROOT = Path(__file__).resolve().parents[2]
REPORTS = ROOT / "tests/reports"
sys.path.append(str(ROOT / "py/reports"))
pytest.importorskip("matplotlib", reason="reports draw with it")

from engine import command, pages


def module(name):
    """The module of a report."""
    pytest.importorskip("tomllib", reason="some of what reports read is TOML, read from 3.11 on")
    return importlib.import_module(name)


@pytest.mark.parametrize("name", command.REPORTS)
def test_a_page_is_that_of_its_figures(name):
    report = json.loads((REPORTS / f"{name}.json").read_text())
    made = module(name).page(report) + "\n"
    assert made == (REPORTS / f"{name}.md").read_text(), "to be made anew by .ci/report --pages"


def test_every_report_is_made_by_ci():
    assert set(command.REPORTS) <= set(re.findall(r"\w+", (ROOT / ".ci/report").read_text()))


def test_text_has_its_figures_in_other_units_and_leaves_out_what_is_empty():
    found = {"of": {"95 %": 0.125}, "s": 0.0042}
    template = "Errors of {of[95 %]:100*.1f} %\nin {s:1e3*.1f} ms.\n\n{nothing}\n\nThe end."
    expected = "Errors of 12.5 % in 4.2 ms.\n\nThe end."
    assert pages.text(template, found, nothing="") == expected


def test_a_table_has_a_row_for_each_and_says_what_is_absent():
    rows = [{"name": "a", "x": 1.25, "by": "5e6507c"}, {"name": "b", "by": "of late"}]
    columns = {"who": "{name}", "x (%)": "{x:100*.0f}", "by": "{by}"}
    assert pages.table(columns, rows, absent="–").splitlines() == [
        "| who | x (%) | by |",
        "| --- | ---: | --- |",
        "| a | 125 | 5e6507c |",
        "| b | – | of late |",
    ]
    with pytest.raises(KeyError):
        pages.table(columns, rows)


def test_what_is_recommended_from_is_the_report():
    pareto = module("pareto")
    report = json.loads((REPORTS / "pareto.json").read_text())
    shipped = json.loads((ROOT / "py/python/ruffini/answerers.json").read_text())
    assert pareto.chosen(report) == shipped


def test_a_front_leaves_out_what_is_measurably_beaten():
    pareto = module("pareto")

    def answers(ms, error, kind="fem", whole=True):
        return {"ms": ms, "errors": {"force": {"median": error}}, "kind": kind, "whole": whole}

    found = {
        "slow and near": answers(100, 0.01),
        "fast and far": answers(1, 0.1),
        "as fast, to measure": answers(1.04, 0.1004),
        "as near, but slower": answers(120, 0.01),
        "as fast, but farther": answers(1, 0.11),
        "not of all presses": answers(1, 0.001, whole=False),
        "an oracle": answers(1, 0.001, kind="oracle"),
        "silent": {"errors": {}},
    }
    expected = ["fast and far", "as fast, to measure", "slow and near"]
    assert pareto.front(found, "force") == expected


def test_a_press_to_leave_out_is_one_of_those_asked():
    pareto = module("pareto")
    parser = command.parser_of(pareto, "pareto")
    chosen = parser.parse_args(["--quick", "--skip", "deep/ball 99 mm"], Namespace(form="quick"))
    with pytest.raises(SystemExit, match="--skip: found deep/ball 99 mm, expected some of unseen/"):
        pareto.make(chosen)


def test_every_answerer_is_in_the_picture():
    pareto = module("pareto")
    drawn = {name for series in pareto.SERIES.values() for name in series.members}
    assert drawn == set(pareto.ANSWERERS)


def test_what_a_change_may_touch_is_asked_again(tmp_path, monkeypatch):
    stability = module("stability")

    def asked(*options, build):
        """Number of presses by model and the build that solved them, after a run of `build`."""
        answer = {"verdict": "solved", "why": "", "seconds": 0.0}
        about = {"commit": build, "sizes": {}}
        monkeypatch.setattr(stability, "header", lambda *_: dict(about))
        monkeypatch.setattr(
            stability, "answers", lambda _, tasks, *__: ((one, answer) for one in tasks)
        )
        parser = command.parser_of(stability, "stability")
        chosen = parser.parse_args(["--presses", "600", *options], Namespace(form="full"))
        return stability.make(chosen)["asked by"]

    monkeypatch.setattr(stability, "KEPT", tmp_path)
    assert all(builds.keys() == {"one"} for builds in asked(build="one").values())
    by = asked("--keep", "one", "--again", "surrogate", "fem:tiny", build="two")
    assert by["surrogate"].keys() == {"two"}
    assert by["compliance"].keys() == by["linear"].keys() == {"one"}
    assert by["fem"].keys() == {"one", "two"}
    with pytest.raises(SystemExit, match="no rows of that build"):
        asked("--keep", "two", build="three")
    with pytest.raises(SystemExit, match="no row is surrogat"):
        asked("--keep", "one", "--again", "surrogat", build="three")
    assert asked("--keep", "one", build="three") == by
    assert asked(build="three")["surrogate"].keys() == {"three"}


def test_shapes_that_begin_buried_are_as_deep_as_is_said():
    extreme = module("extreme")
    mesh = ruffini.sensor("gelsight-mini", resolution=300).mesh
    assert extreme.face_height(mesh, np.zeros(2)) == pytest.approx(0.0, abs=1e-4)
    for number in range(20):
        case = extreme.draw_buried(np.random.default_rng(number)) | {"mesh": "mini"}
        path = extreme.buried(case, mesh)
        assert len(path) == (1 if case["kind"] == "buried" else case["frames"] + 1)
        corners = turned(path[0][1], extreme.shape(case)[0].surface()[0]) + path[0][0]
        depth = extreme.face_height(mesh, path[0][0][:2]) - corners[:, 2].min()
        assert depth == pytest.approx(case["depth"] * 4e-3, abs=1e-9), case["shape"]


def test_contact_that_pulls_is_found():
    verdict, case = module("verdict"), {"answerer": "linear", "mesh": "mini", "young": 3e5}
    case |= {"shape": "pin", "size": 5e-4, "slenderness": 4.0, "turn": None, "friction": 0.0}
    case |= {
        "kind": "buried",
        "depth": 0.1,
        "frames": 1,
        "aside": [0.0, 0.0],
        "poisson": 0.47,
        "shear": [0.0, 0.0],
    }
    model = verdict.answerer(case)
    [found] = model.solve_path(verdict.press(case, model.body.mesh))
    total = np.abs(found.contact_force).sum()

    def judged(force):
        wrench = np.r_[force.sum(axis=0), 0, 0, 0]
        frame = {"displacement": found.displacement, "pose": found.pose, "wrench": wrench}
        verdict.check_pull(case, model.body, Namespace(**frame, contact_force=force), total)

    judged(found.contact_force)
    with pytest.raises(verdict.WrongError, match="contact pulls"):
        judged(-found.contact_force)
    aside = np.r_[-2.0, 0.5, -1.0, 0, 0, 0]
    with pytest.raises(verdict.WrongError, match="pushes aside with"):
        verdict.check_upright(case, Namespace(pose=found.pose, wrench=aside), total)
    pulled = found.contact_force.copy()
    pulled[pulled[:, 2].argmax()] = [0.0, 0.0, 0.01 * total]
    with pytest.raises(verdict.WrongError, match="nodes are pulled"):
        judged(pulled)


def test_paired_differences_have_the_intervals_that_others_found():
    """Of a table whose interval the R package contingencytables tests, and of an exact binomial."""
    paired = module("paired")
    assert paired.paired_interval(59, 6, 16, 80) == pytest.approx((-0.1186, -0.0046), abs=1e-4)
    assert paired.mcnemar(0, 5) == pytest.approx(2 / 2**5)
    assert paired.mcnemar(3, 3) == 1.0
    low, high = paired.paired_interval(50, 0, 0, 0)
    assert low == -high < -0.05, "fifty seeds alike do not show that none would differ"
    assert paired.mean_with_interval([0.5] * 9)["interval"] == [0.5, 0.5]


def test_an_episode_of_the_comparison_is_that_of_the_evaluation():
    from ruffini import agents
    from ruffini.evaluation import evaluate

    found = module("sim_to_sim_cases").episode("GraspFragile", "agent", 10_003, "surrogate")
    agent = agents.load("GraspFragile")
    told = evaluate(agent, agent.env_id, 1, first_seed=10_003, **agent.settings)
    assert found["success"] == bool(told["success"])
    assert found["return"] == pytest.approx(told["return"], abs=1e-3)
    assert list(told["by_object"]) == [found["object"]]


def test_the_network_solves_a_recorded_motion_as_it_was_felt():
    found = module("sliding_cases").replayed("sphere", "network")
    off = module("sliding").differences(found, found["felt"])
    assert off["force"] < 0.01
    assert off["apart"] < 0.03
    assert max(found["sliding"]) > 0.2


def test_slip_that_is_computed_along_an_episode_is_that_of_the_episode():
    episode = module("sim_to_sim_cases").episode
    own, again = (episode("HoldStill", "agent", 10_003, "surrogate", so) for so in (False, True))
    assert again["missed"] == 0
    assert again["success"]
    assert again["return"] == pytest.approx(own["return"], abs=0.5)
    assert again["return"] != own["return"]


def test_a_press_that_is_not_solved_is_a_failure_that_is_shown():
    compared = module("sim_to_sim").compared

    def row(model, ending):
        won = ending is None
        told = {"success": won, "return": 80.0 if won else 20.0, "ending": ending, "restarts": 1}
        told |= {"press_error": None if won else "not-converged", "steps": 100, "seconds": 1.0}
        told |= {"reset_seconds": 0.1, "terms": {"still": 0.5}, "grip": 3.0, "model": model}
        return told

    def pair(ending):
        return {"surrogate": row("surrogate", None), "fem": row("fem", ending)}

    found = compared([pair(None), pair(None), pair("press_failed")])
    assert found["success"]["only surrogate"] == 1
    assert found["fem"]["outcomes"] == {"success": 2, "press_failed": 1}
    assert found["fem"]["press errors"] == {"not-converged": 1}
    assert found["return"]["difference"] == pytest.approx(-20.0)
    assert found["solved"]["seeds"] == 2
    assert found["solved"]["success"]["difference"] == found["solved"]["return"]["difference"] == 0


def test_rows_are_kept_until_what_they_depend_on_changes(tmp_path, capsys):
    from engine import Rows, run

    file, told = tmp_path / "rows.jsonl", []

    def case(figure):
        told.append(figure)
        return {"figure": figure}

    run(Rows(file, {"commit": "one"}), {"a": (case, 1)})
    file.write_text(file.read_text() + '{"key": "b", "figu')
    rows = Rows(file, {"commit": "one"})
    run(rows, {"a": (case, 1), "b": (case, 2)})
    assert told == [1, 2]
    assert [row["figure"] for row in Rows(file, {"commit": "one"})] == [1, 2]
    drawn = {"commit": "one", "versions": {"matplotlib": "3.10"}}
    assert len(Rows(file, drawn)) == 2
    for commit in ("two", "one", "two", "three"):
        rows = Rows(file, {"commit": commit})
        assert not len(rows)
        run(rows, {"a": (case, 3)})
    assert "rows.jsonl: made under other conditions, kept as rows.one.jsonl" in (
        capsys.readouterr().out
    )
    names = {"one", "two", "one-2", "two-2"}
    assert {path.name for path in tmp_path.iterdir()} == {
        "rows.jsonl",
        *(f"rows.{name}.jsonl" for name in names),
    }
    assert [row["figure"] for row in Rows(tmp_path / "rows.one.jsonl", drawn)] == [1, 2]


def test_the_balance_of_a_body_on_a_known_path_is_its_load():
    """Of a block that swings and turns, with pads that feel what it needs, or a twelfth more."""
    cases = module("load_cases")
    mass, inertia = 0.2, np.diag([3e-5, 5e-5, 4e-5])
    look = {"load": 1.0, "shaking": [0.3, -0.2, 0.5], "shaking_frequency": 1.0}
    record = cases.Record(mass, inertia, np.zeros(3), np.zeros((1, 3)), look)
    sway, axis, rate = np.array([0.01, -0.02, 0.015]), np.array([0.0, 0.6, 0.8]), 5.0

    def momentum(time):
        turn = cases.spun(0.4 * np.sin(rate * time) * axis)
        return turn @ inertia @ turn.T @ (0.4 * rate * np.cos(rate * time) * axis)

    for i in range(40):
        time = i * cases.PERIOD
        # What is read belongs to the beginning of the last step of the rigid bodies.
        felt = time - cases.STEP
        force = mass * (-(rate**2) * np.sin(rate * felt) * sway + [0, 0, cases.GRAVITY])
        load = cases.external(look, np.array([felt]))[0]
        torque = (momentum(felt + 1e-5) - momentum(felt - 1e-5)) / 2e-5
        record.add(
            center=[0, 0, 0.1] + np.sin(rate * time) * sway,
            rotation=cases.spun(0.4 * np.sin(rate * time) * axis),
            velocity=rate * np.cos(rate * time) * sway,
            spin=0.4 * rate * np.cos(rate * time) * axis,
            unloaded=np.r_[force, torque],
            felt=np.r_[force - load, torque],
            engine=np.r_[force - load, torque] * 13 / 12,
            slip=[0.0, 0.0],
            normal=[5.0, 5.0],
            grip=5.0,
            lowest=0.1,
            tool=np.zeros(3),
            hand=np.zeros(3),
        )
    found = cases.balance(record)
    # From the end of the load's onset, where it has a kink, on.
    late = found["step"] * cases.PERIOD > cases.ONSET + 2 * cases.PERIOD
    assert late.sum() > 20
    force, torque = cases.errors(found, "felt")
    assert force[late].max() < 2e-3, "error of a force that is the load"
    assert torque[late].max() < 2e-3, "error of a torque that turns the body"
    force, _ = cases.errors(found, "engine")
    needed = np.linalg.norm(found["needed"][:, :3], axis=1) / found["scale"] / 12
    assert force[late] == pytest.approx(needed[late], abs=2e-3)
    # Without the load, velocities say the same as poses.
    record.samples["felt"] = record.samples["unloaded"]
    for error in cases.errors(cases.balance_of_velocities(record), "felt"):
        assert error.max() < 2e-3, "error of what the velocities need"


def standing(place, missing=0.0):
    """A peg that stands on the block, whose force acts at a place of the top (m), as it is felt."""
    load, cases = module("load_cases"), module("insertion_cases")
    mass, half, center = 0.04, np.array([6e-3, 6e-3, 0.03]), np.array([1e-3, -2e-3, 0.05])
    corners = half * np.stack(np.meshgrid(*[[-1, 1]] * 3), axis=-1).reshape(-1, 3)
    record = load.Record(mass, 1e-5 * np.eye(3), np.zeros(3), corners, {})
    force = np.array([0.5, -0.3, 4.0])
    arm = np.array([*place, cases.TOP]) - center
    needed = np.r_[mass * np.array([0, 0, load.GRAVITY]) - force, -np.cross(arm, force)]
    for _ in range(6):
        record.add(felt=needed + missing * np.r_[force, 0, 0, 0], engine=needed, block=force)
        record.add(center=center, rotation=np.eye(3), tool=center, hand=np.zeros(3))
        record.add(slip=[0.0, 0.0], normal=[5.0, 5.0], grip=5.0, lowest=cases.TOP)
    return record


@pytest.mark.parametrize(
    ("place", "aside"),
    [((0.0, 0.0), 0.0), ((6e-3, 3e-3), 0.0), ((9e-3, 8e-3), np.hypot(2, 4) / 1e3)],
)
def test_the_torque_on_a_standing_peg_tells_where_the_block_bears_it(place, aside):
    load, cases = module("load_cases"), module("insertion_cases")
    record = standing(place)
    found = cases.balance(record)
    assert load.errors(found, "felt")[0].max() < 1e-9
    assert cases.aside(record, found, "felt") == pytest.approx(np.full(3, aside), abs=1e-9)
    found = cases.balance(standing(place, 0.1))
    scale = np.linalg.norm([0.5, -0.3, 4.0])
    expected = 0.1 * scale / (scale + 0.04 * load.GRAVITY)
    assert load.errors(found, "felt")[0] == pytest.approx(np.full(3, expected))
    assert found["change"].max() == 0.0


def test_a_spiral_search_finds_a_wide_hole_and_goes_on_only_while_it_touches():
    search = module("insertion_search")
    row = search.searched("spiral", "round-peg", 2e-3, 4, 40_000)["search"]
    assert row["successes"] >= 2
    up = {"proprio": np.zeros((1, 14), np.float32), "wrench": np.zeros((1, 12), np.float32)}
    spiral, state = search.Spiral(), None
    for force, way in ((5.0, 1), (5.0, 2), (0.0, 2), (5.0, 3)):
        up["wrench"][:, 1] = force
        action, state = spiral.predict(up, state)
        assert state[1] == pytest.approx(way * search.PACE * search.PERIOD)
    assert action[0, 2] == pytest.approx(search.RISE)
    up["proprio"][:, 2] = -2 * search.DROPPED
    _, state = spiral.predict(up, state)
    assert state[3].all()


def test_a_load_is_judged_by_what_a_jerky_hand_leaves_to_the_ends_of_steps():
    cases = module("load_cases")
    mass, still = 0.2, np.zeros(3)
    record = cases.Record(mass, 1e-5 * np.eye(3), still, np.zeros((1, 3)), {})
    random, most = np.random.default_rng(0), cases.LIMIT * cases.STEP
    place, velocity, weight = np.array([0, 0, 0.1]), still, np.array([0, 0, mass * cases.GRAVITY])
    jerks = []
    for _ in range(60):
        # Some commands are reached at once, others not within the step.
        wanted = random.uniform(-0.3, 0.3, 3) * random.choice([0.05, 1.0])
        for _ in range(round(cases.PERIOD / cases.STEP)):
            change = (wanted - velocity).clip(-most, most)
            velocity = velocity + change
            place = place + cases.STEP * velocity
        jerks.append(np.abs(change).max() / cases.STEP)
        push = weight + mass * change / cases.STEP
        moved = {"center": place, "tool": place, "hand": velocity, "velocity": velocity}
        record.add(**moved, felt=np.r_[push, still], engine=np.r_[weight, still], spin=still)
        record.add(rotation=np.eye(3), slip=[0.0, 0.0], normal=[5.0, 5.0], grip=5.0, lowest=0.1)
    found = cases.balance(record)
    assert (np.array(jerks) > 0.9 * cases.LIMIT).any() and (np.array(jerks) < 1e-9).any()
    assert cases.errors(found, "felt")[0].max() < 1e-6
    assert cases.errors(found, "engine")[0].max() > 0.1, "pads that feel the weight alone"


def test_the_way_of_an_object_past_a_marker_is_none_where_it_is_carried():
    markers = module("load_markers")
    spun, axes = module("load_cases").spun, np.stack([np.eye(3)] * 2)
    center, turn, shift = np.array([0.0, 0.0, 0.1]), spun(np.array([0, 0, 0.2])), [1e-3, 2e-3, 0]
    places = np.array([[[0.01, 0, 0.1], [0, 0.02, 0.1]]] * 2)
    before = {"center": center, "rotation": np.eye(3), "axes": axes}
    before |= {"markers": places, "moved": np.zeros((2, 2, 3))}
    carried = center + shift + (places - center) @ turn.T
    now = before | {"center": center + shift, "rotation": turn}
    way = markers.passed(before, now | {"moved": carried - places})
    np.testing.assert_allclose(way, 0.0, atol=1e-15)
    way = markers.passed(before, now)
    np.testing.assert_allclose(way, (carried - places)[..., :2], atol=1e-15)


def test_onset_of_slip_is_where_the_first_and_the_last_marker_slips():
    markers = module("load_markers")
    ratio = np.arange(0, 121) / 100
    share = np.where(ratio < 0.1, 0, markers.predicted(ratio))
    found = markers.judged(np.c_[ratio, share])
    assert (found["first slip"], found["gross slip"], found["predicted"]) == (10, 100, 100)
    assert found["steps between"] == found["predicted between"] == 90
    assert found["shares"]["0.6"] == pytest.approx(1 - 0.4 ** (2 / 3))
    # An object that was dropped before.
    short = markers.judged(np.c_[ratio, share][:50])
    assert short["gross slip"] is short["load at gross slip"] is short["shares"]["0.9"] is None


def test_markers_under_a_flat_face_slip_as_cattaneo_and_mindlin_predict():
    markers = module("load_markers")
    found = markers.loaded("cuboid", "compliance")
    assert found["load at gross slip"] == pytest.approx(1.0, abs=0.05)
    # The law is that of a half-space, the pad a layer with sides.
    for ratio in (0.4, 0.6, 0.8):
        share, law = found["shares"][str(ratio)], float(markers.predicted(ratio))
        assert share == pytest.approx(law, abs=0.08), f"{share} for {law} at {ratio}"


def test_what_hangs_still_is_felt_as_its_weight():
    cases = module("load_cases")
    record = cases.hanging("cuboid", "surrogate", 1, 20)
    found = cases.balance(record)
    weight = found["scale"][-1]
    assert weight == pytest.approx(9.81 * record.look["mass"], rel=1e-3)
    force, torque = cases.errors(found, "felt")
    assert force[-1] < 0.01, f"{found['felt'][-1, :3]} N felt of a weight of {weight} N"
    assert torque[-1] < 0.01, f"{found['felt'][-1, 3:]} N m felt of none"


def test_what_a_hand_accelerates_is_felt_as_its_inertia():
    cases = module("load_cases")
    for axis, found in cases.excess(cases.moved("cuboid", "compliance", 0)).items():
        assert found["samples"] > 5
        assert abs(found["felt"]) < 0.1, f"{found['felt']} m a too much {axis}"


def test_a_solid_has_the_inertia_of_its_box():
    cases = module("load_cases")
    volume, center, inertia = cases.solid(*ruffini.Shape.cuboid((0.01, 0.02, 0.03)).surface())
    assert volume == pytest.approx(8 * 0.01 * 0.02 * 0.03)
    assert center == pytest.approx([0, 0, 0], abs=1e-12)
    expected = [volume * (a**2 + b**2) / 3 for a, b in ((0.02, 0.03), (0.01, 0.03), (0.01, 0.02))]
    assert inertia.diagonal() == pytest.approx(expected)
    assert abs(inertia - inertia.diagonal() * [[1, 0, 0], [0, 1, 0], [0, 0, 1]]).max() < 1e-20
