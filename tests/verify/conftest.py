"""The disk at a tolerance whose error can be measured."""

import dataclasses

import pytest

from jaxball import load_scenario
from jaxball.analysis.verify import comparisons


@pytest.fixture(scope="module")
def case():
    return comparisons.Case(dataclasses.replace(load_scenario("disk"), rtol=1e-7, atol=1e-7))
