"""``jaxball simulate`` of a body that slips and flies: --contact, what the summary says, and what goes into files."""

import json

import numpy as np
import pytest

from jaxball import load_run
from jaxball.cli import main
from tests.scenario.documents import DISK
from tests.support.commands import refuses_command
from tests.support.sentences import refuses, said

SHELL, TIMES = DISK[: DISK.index("[[masses]]")].replace("inertia = 1.0", "inertia = 0.5"), DISK[DISK.index("[time]") :]
THROWN = SHELL + TIMES + "[initial]\nvelocity = [1.0, 0.0, 0.0]\n"


@pytest.fixture(autouse=True)
def folder(command_folder):
    """A folder with a disk that is thrown along its plane."""
    (command_folder / "thrown.toml").write_text(THROWN)
    return command_folder


@pytest.mark.long
def test_a_run_that_slides(capsys):
    """A disk with J = 1/2 m r² stops slipping at V / (3 μ g) with V = 1, and friction takes V² / 6 of its energy."""
    command = ["simulate", "thrown.toml", "--contact", "0.25", "--out", "run.npz", "--json", "run.json"]
    assert main(command) == 0
    printed = capsys.readouterr().out
    assert "the mode of contact changed once, and is rolling at the end" in printed
    assert "    t = 1.33333333" in printed
    assert "from sliding to rolling, as the slip ended" in printed
    assert "sliding friction dissipated the energy 0.166666666" in printed
    with open("run.json") as file:
        contact = json.load(file)["contact"]
    assert contact["law"] == {"friction": 0.25, "static_friction": 0.25}
    assert contact["modes"] == ["sliding"] * 3 + ["rolling"] * 2
    (switch,) = contact["switches"]
    np.testing.assert_allclose(switch["time"], 4 / 3, rtol=1e-9)
    assert (switch["from"], switch["to"], switch["cause"], switch["grazing"]) == (
        "sliding",
        "rolling",
        "the slip ended",
        False,
    )
    again = load_run("run.npz")
    assert again.contact.mode.tolist() == [1, 1, 1, 0, 0]


@pytest.mark.thorough
def test_a_run_ends_where_it_slips_by_its_law(capsys):
    """A disk that slips from the start, which a law with less friction than is asked for lets it do."""
    assert main(["simulate", "thrown.toml", "--contact", "0.25", "--friction", "0.25"]) == 3
    said(capsys.readouterr().err, "The run")
    assert main(["simulate", "thrown.toml", "--contact", "0.25", "--friction", "0.26", "--detachment"]) == 0


def test_keys_of_the_law(monkeypatch):
    """They are those of [contact], all of which they replace."""
    seen = []

    def noted(*_, contact, **__):
        seen.append([float(x) for x in (contact.friction, contact.static_friction, contact.restitution)])
        raise ValueError("This is as far as it goes.")

    monkeypatch.setattr("jaxball.simulation.simulate.simulate", noted)
    for law in ("0.3", "friction=0.3, static_friction=0.4,restitution=0.5"):
        with refuses(ValueError, "This"):
            main(["simulate", "bouncing-ball", "--contact", law])
    assert seen == [[0.3, 0.3, 0.0], [0.3, 0.4, 0.5]]


REFUSED = {
    "no law": (["thrown.toml"], "initial.velocity"),
    "no number": (["thrown.toml", "--contact", "ice"], "contact.friction"),
    "no key": (["thrown.toml", "--contact", "fricton=0.3"], "contact.fricton"),
    "no plane": (["heavy-top", "--contact", "0.3"], "--contact"),
}


@pytest.mark.parametrize(("arguments", "named"), REFUSED.values(), ids=REFUSED.keys())
def test_what_cannot_be_asked_for(arguments, named, capsys):
    refuses_command(capsys, ["simulate", *arguments], named)


@pytest.mark.parametrize(
    "command",
    [
        ["stability", "bowling-ball"],
        ["periodic", "bowling-ball", "--period", "5", "--chart", "body.mass=1:2:2", "contact.friction=0.1:0.2:2"],
    ],
    ids=" ".join,
)
def test_commands_of_bodies_that_roll(command, capsys):
    refuses_command(capsys, command, "jaxball simulate")


@pytest.mark.thorough
def test_analyses_of_a_bounce(folder, capsys):
    """Without loss from 1/2 up, with g = 1, a bounce takes 2: every command follows it through its strikes."""
    (folder / "bounce.toml").write_text(
        SHELL + TIMES + "[initial]\nheight = 0.5\n[contact]\nfriction = 0.25\nrestitution = 1.0\n"
    )
    assert main(["periodic", "bounce.toml", "--period", "1.9", "--json", "motion.json", "--out", "motion.csv"]) == 0
    assert "multipliers 1, 1, 1, 0" in capsys.readouterr().out
    (motion,) = json.loads((folder / "motion.json").read_text())["motions"]
    top = motion["state"]["height"] + motion["state"]["V"][2] ** 2 / 2
    np.testing.assert_allclose(motion["period"], 2 * np.sqrt(2 * top), rtol=1e-9)
    section = ["--poincare", "V[2]=0", "--direction", "falling", "--end", "9", "--out", "points.csv"]
    assert main(["chaos", "bounce.toml", *section, "--axes", "height", "phi"]) == 0
    data = np.genfromtxt(folder / "points.csv", delimiter=",", names=True, deletechars="")
    np.testing.assert_allclose(data["height"], 0.5, rtol=1e-7)
    np.testing.assert_allclose(data["time"][-3:], [4.0, 6.0, 8.0], rtol=1e-7)
    capsys.readouterr()
    assert main(["chaos", "bounce.toml", "--end", "20", "--json", "-", "--quiet"]) == 0
    exponents = json.loads(capsys.readouterr().out)["exponents"]
    assert exponents[-1] is None  # a slip does not survive a strike
    assert len(exponents) == 6
