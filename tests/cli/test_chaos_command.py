"""``jaxball chaos``."""

import re

import numpy as np
import pytest

from jaxball.cli import main
from tests.scenario.documents import DISK

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
    ("arguments", "sentence"),
    [
        (["none.toml"], '"none.toml" (No such file or directory)'),
        (["ball", "--plot", "means.txt"], "must end in one of .png, .pdf, .svg"),
        (
            ["ball", "--transient", "50"],
            "`--transient` must be from 0 to less than the length of the run, 20, but it is 50",
        ),
        (["ball", "--exponents", "6"], "`--exponents` must be from 1 to 5"),
    ],
)
def test_bad_arguments(capsys, arguments, sentence):
    assert main(["chaos", *arguments]) == 2
    captured = capsys.readouterr()
    assert sentence in captured.err
    assert captured.out == ""


@pytest.mark.parametrize("arguments", [["ball", "--interval", "0"], ["ball", "--end", "inf"], []])
def test_usage(capsys, arguments):
    with pytest.raises(SystemExit) as caught:
        main(["chaos", *arguments])
    assert caught.value.code == 2
    assert "usage: jaxball chaos" in capsys.readouterr().err
