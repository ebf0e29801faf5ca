"""``jaxball chaos``."""

import re

import numpy as np
import pytest

from jaxball.cli import main
from tests.scenario.documents import DISK
from tests.support.commands import refuses_command

pytestmark = pytest.mark.usefixtures("command_folder")


@pytest.mark.slow
def test_the_table_of_a_disk_and_its_figure(tmp_path, capsys):
    (tmp_path / "disk.toml").write_text(DISK)
    assert main(["chaos", "disk.toml", "--end", "8", "--transient", "2", "--plot", "means.png"]) == 0
    text = capsys.readouterr().out
    values = [float(value) for value in re.findall(r"λ\d = +(\S+) ±", text)]
    assert len(values) == 3
    assert np.all(np.isfinite(values))
    assert "The solve reached t = 8." in text
    assert "least normal force" in text
    assert (tmp_path / "means.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (["ball", "--plot", "means.txt"], "--plot"),
        (["ball", "--transient", "50"], "--transient"),
        (["ball", "--exponents", "6"], "--exponents"),
    ],
)
def test_bad_arguments(capsys, arguments, named):
    refuses_command(capsys, ["chaos", *arguments], named)
