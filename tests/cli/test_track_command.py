"""``jaxball track``, against the closed loops that Python makes of the same scenario."""

import json

import numpy as np
import pytest

import jaxball
from jaxball.cli import main
from tests.support.commands import refuses_command
from tests.support.sentences import said
from tests.support.under_feedback import UNDER_FEEDBACK


@pytest.fixture(autouse=True)
def folder(command_folder):
    (command_folder / "disk.toml").write_text(UNDER_FEEDBACK)
    return command_folder


@pytest.mark.slow
def test_disturbed_starts_are_held_and_saved(folder, capsys):
    """The numbers are those of the closed loops, and the saved run is that of the first start, from sensors."""
    grid = ["phi=-0.4:0.4:3", "phidot=-0.5:0.5:2"]
    files = ["--out", "held.npz", "--plot", "figures", "--json", "-"]
    assert main(["track", "disk.toml", "--basin", *grid, "--within", "0.3", *files]) == 0
    captured = capsys.readouterr()
    found = json.loads(captured.out)
    said(captured.err)
    scenario = jaxball.load_scenario("disk.toml")
    seeing = scenario.closed_loop()
    track = seeing.feedback.feedback
    loops = found["starts"][0]["loops"]
    assert list(loops) == ["without feedback", "with feedback", "from sensors"]
    xi = np.asarray(seeing.xi)
    weighted = np.sqrt((xi[:, 0] ** 2 + xi[:, 3] ** 2) / 2)
    assert loops["from sensors"]["start"] == pytest.approx(0.2 / np.sqrt(2))
    assert loops["from sensors"]["end"] == pytest.approx(weighted[-1], abs=1e-9)
    assert loops["from sensors"]["largest_input"] == pytest.approx(float(np.max(np.abs(seeing.u))), abs=1e-9)
    assert loops["without feedback"]["largest_input"] == pytest.approx(0.0, abs=1e-12)
    starts = {"phi": np.linspace(-0.4, 0.4, 3), "phidot": np.linspace(-0.5, 0.5, 2)}
    push, Q = scenario.feedback.pushes[0], {"phi": 1.0, "theta": 1.0}
    again = track.basin(starts, Q=Q, within=0.3, limits=0.5, delay=1, push=push, system=scenario.system)
    np.testing.assert_array_equal(np.ravel(found["basin"]["returned"]), again.returned)
    assert found["basin"]["share"] == again.share
    seen = seeing.feedback.basin(starts, Q=Q, within=0.3, limits=0.5, delay=1, push=push, system=scenario.system)
    np.testing.assert_array_equal(np.ravel(found["basin_from_sensors"]["returned"]), seen.returned)
    said(captured.err, np.sum(seen.returned))
    saved = jaxball.load_run("held.npz")
    np.testing.assert_allclose(saved.state.z, seeing.states.z, rtol=0, atol=1e-9)
    np.testing.assert_allclose(saved.history.u[:-1], seeing.u, rtol=0, atol=1e-9)
    names = {"paths", "inputs", "gains", "basin", "basin_from_sensors", "estimate"}
    assert {path.name for path in (folder / "figures").iterdir()} == {f"disk_{name}.png" for name in names}


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (["disk.toml", "--Q", "pih=1"], "feedback.Q"),
        (["disk.toml", "--sample", "0.3"], "--sample"),
        (["disk.toml", "--disturb", "y=1"], "--disturb"),
        (["disk.toml", "--set", "feedback.kind=feedforward"], "feedback.kind"),
        (["heavy-top"], "kind"),
        (["bowling-ball"], "initial.velocity"),
    ],
)
def test_bad_input_gets_a_sentence(arguments, named, capsys):
    refuses_command(capsys, ["track", *arguments], named)


@pytest.mark.long
def test_a_body_that_would_leave_its_ground_is_marked(capsys):
    """The paper's ball, disturbed: its regulator presses it off the plane."""
    assert main(["track", "ball"]) == 0
    line = next(line for line in capsys.readouterr().out.splitlines() if line.strip().startswith("with feedback"))
    said(line)
