"""Commands that refuse what they are given."""

from pathlib import Path

from jaxball.cli import main
from tests.support.sentences import said


def refuses_command(capsys, arguments, *names) -> None:
    """The command ends with 2, says one sentence that names each of ``names``, and leaves the folder as it is."""
    before = sorted(Path().iterdir())
    assert main(arguments) == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    assert sorted(Path().iterdir()) == before
    said(printed.err, *names)
