"""Cost of 10⁸ steps: the model of it, and processes that step at once."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pytest

import rollout_speed
from scaling import doubled, predicted, table, together


def test_the_cost_is_that_of_as_many_cores_with_the_efficiency_of_all_here():
    found = predicted({1: 1000.0, 2: 1900.0, 4: 3600.0}, {1: 1000.0, 2: 1800.0, 4: 3000.0})
    assert found["efficiency"] == {"processes": 0.9, "threads": 0.75}
    # 10⁸ steps at 900 a second and core.
    assert found["core_hours"] == pytest.approx(1e8 / 900 / 3600, abs=0.05)
    assert found["hours"]["64"] == pytest.approx(1e8 / 900 / 3600 / 64, abs=5e-4)
    # All four cores are predicted with the efficiency of two of them, 0.95.
    assert found["check"] == {
        "predicted": 3800.0,
        "error_processes": round(3800 / 3600 - 1, 3),
        "error_threads": round(3800 / 3000 - 1, 3),
    }


def test_two_cores_are_predicted_from_one():
    found = predicted({1: 1000.0, 2: 1900.0}, {1: 1000.0, 2: 1800.0})
    assert found["check"]["predicted"] == 2000.0
    alone = predicted({1: 1000.0}, {1: 1000.0})
    assert alone["efficiency"] == {"processes": 1.0, "threads": 1.0}


@pytest.mark.parametrize(("cores", "counts"), [(1, [1]), (2, [1, 2]), (6, [1, 2, 4, 6])])
def test_cores_are_doubled_up_to_all_of_them(cores, counts, monkeypatch):
    monkeypatch.setattr("scaling.usable_cores", lambda: cores)
    assert doubled() == counts


def test_processes_that_step_at_once_tell_their_speed_and_memory():
    found = together(2, 2, "none", repeats=1)
    assert found["rate"] > 0
    assert found["make"] > 0
    assert 0 <= found["per_environment"] < found["whole"] < 1e9


def test_a_process_that_fails_stops_all():
    with pytest.raises(ValueError, match="eyes"):
        together(2, 2, "eyes", repeats=1)


def test_the_table_of_costs_is_renewed_from_its_json(tmp_path, monkeypatch):
    pytest.importorskip("matplotlib", reason="reports draw with it")
    sys.path.append(str(Path(__file__).parents[2] / "py/reports"))
    from engine import pages

    measured = {"kilobytes_per_environment": 89.6, "megabytes_of_a_process": 51.2}
    measured |= {"seconds_to_make": 0.021}
    measured |= {"processes": {"1": 8464.8}} | predicted({1: 8464.8, 2: 16000}, {1: 8e3, 2: 15e3})
    found = {"none": measured, "surrogate": measured}
    (tmp_path / "cost.json").write_text(json.dumps(found))
    monkeypatch.setattr(pages, "FOLDERS", (tmp_path,))
    made = table(found, "cost")
    assert len(list(pages.MARK.finditer(made))) == made.count("<!--") > 10
    assert "8,465<!-- cost: none / processes / 1 -->" in made
    assert pages.requoted(made) == made


def test_the_cost_tells_how_long_it_takes_and_took(monkeypatch, capsys):
    monkeypatch.setattr(rollout_speed, "cost", lambda _quick: {})
    monkeypatch.setattr(rollout_speed, "table", lambda _found: "| figures |")
    monkeypatch.setattr(sys, "argv", ["rollout_speed.py", "--cost", "--quick"])
    rollout_speed.main()
    first, figures, last = capsys.readouterr().out.splitlines()
    assert first.startswith("This takes about a minute on two cores")
    assert figures == "| figures |" and last == "It took 0 s."


def test_the_cost_of_python_is_measured_over_recorded_steps():
    assert 0 < rollout_speed.python_share(0.02) < 1
    times = rollout_speed.infos_microseconds(4, 0.02)
    assert list(times) == ["native", "every step", "episode ends"]
    assert min(times.values()) > 0
