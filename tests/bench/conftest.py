"""What the tests of the benchmarks share."""

import pytest

from tests.support.scripts import BENCHMARKS


@pytest.fixture
def benchmarks(monkeypatch):
    """The folder of benchmarks, where modules are found."""
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    return BENCHMARKS
