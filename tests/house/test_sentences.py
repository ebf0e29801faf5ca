"""The file of sentences belongs to the tests that there are, and the helper that keeps it finds what differs."""

import pytest

from tests.support import sentences
from tests.support.sentences import ROOT, refuses, said, shown


def test_every_sentence_belongs_to_a_test(request):
    """Of the modules that this process has collected; of the others, the file must be there."""
    collected = request.config.stash[sentences.COLLECTED]
    modules = {sentences.module_of(test) for test in collected}
    for test in sentences.sentences():
        module = sentences.module_of(test)
        assert test in collected if module in modules else (sentences.FILE.parents[1] / module).is_file(), test


@pytest.mark.parametrize(
    ("raised", "error", "names"),
    [
        (ValueError("Argument `mass` is wrong."), TypeError, ["mass"]),
        (ValueError("Argument `mass` is wrong."), ValueError, ["masses"]),
        (ValueError("Argument `mass` is wrong."), ValueError, ["mas"]),
        (ValueError("Argument `mass` is wrong."), ValueError, ["mass"]),  # which the file does not have
    ],
)
def test_another_type_another_name_and_another_sentence_fail(monkeypatch, raised, error, names):
    monkeypatch.setattr(sentences, "WRITES", False)
    monkeypatch.setattr(sentences, "_now", [])
    with pytest.raises((AssertionError, type(raised))), refuses(error, *names):
        raise raised


def test_a_sentence_that_is_in_the_file():
    with refuses(ValueError, "mass", "body.radius"):
        raise ValueError("Arguments `mass` and `body.radius` must be positive,\n  but they are -1.")
    said("Written to run.csv.", "run.csv")


def test_what_differs_from_run_to_run_has_a_placeholder(tmp_path):
    assert shown(f'The file "{tmp_path}/a/run.csv" is 0.12345678 of 12.5 m.') == (
        'The file "TMP/a/run.csv" is 0.123457 of 12.5 m.'
    )
    assert shown("A sweep needs zarr; pip install -e '.[sweep]' in jaxball's folder.") == (
        "A sweep needs zarr; pip install 'jaxball[sweep]'."
    )
    assert shown(f"<object at {hex(id(tmp_path))}> in {ROOT}/tests") == "<object at 0x...> in ROOT/tests"
