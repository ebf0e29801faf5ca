"""The numbers of each row: grids, ranges, designs, files, zipped and crossed."""

import itertools

import jax
import numpy as np
import pandas
import pytest
import scipy.stats

from jaxball import ScenarioError, read_scenario
from jaxball.files.scenario.sources import builtin_text
from tests.scenario.documents import DISK
from tests.support.sentences import refuses
from tests.sweep.studies import study

EVERY = np.arange


def values(folder, axes, rows=None):
    found = study(folder, axes)
    return found.values(EVERY(found.rows) if rows is None else np.asarray(rows))


def test_crossed_axes_are_a_product_whose_last_factor_changes_fastest(tmp_path):
    found = study(tmp_path)
    assert found.paths == ("body.mass", "body.gravity")
    wanted = list(itertools.product(np.linspace(0.5, 2.0, 5), [0.5, 1.0, 2.0]))
    np.testing.assert_array_equal(found.values(EVERY(15)), wanted)
    assert (found.shape, found.rows) == ((5, 3), 15)


@pytest.mark.parametrize(("kind", "space"), [("linear", np.linspace), ("log", np.geomspace)])
def test_ranges(tmp_path, kind, space):
    found = values(tmp_path, f'[[axes]]\npath = "body.mass"\n{kind} = {{ from = 0.003, to = 17.0, count = 9 }}\n')
    np.testing.assert_allclose(found[:, 0], space(0.003, 17.0, 9), rtol=1e-14)
    assert (found[0, 0], found[-1, 0]) == (0.003, 17.0)


def test_zipped_axes_go_on_together(tmp_path):
    axes = """
    [[axes]]
    zip = [
        { path = "body.mass", values = [1, 2, 3] },
        { path = "masses[0].rail.radius", linear = { from = 0.1, to = 0.3, count = 3 } },
    ]
    [[axes]]
    path = "time.end"
    values = [4.0, 5.0]
    """
    wanted = [[m, r, end] for m, r in ((1, 0.1), (2, 0.2), (3, 0.3)) for end in (4.0, 5.0)]
    np.testing.assert_allclose(values(tmp_path, axes), wanted, rtol=1e-15)


DESIGN = """
[[axes]]
design = "{design}"
count = {count}
seed = 5
[axes.numbers]
"body.mass" = {{ uniform = [0.5, 2.0] }}
"body.gravity" = {{ log-uniform = [0.1, 10.0] }}
"body.inertia" = {{ normal = [1.0, 0.1] }}
"masses[0].mass" = {{ lognormal = [0.2, 0.5] }}
"time.end" = {{ uniform = [1.0, 3.0] }}
"""
LAWS = [
    scipy.stats.uniform(0.5, 1.5),
    scipy.stats.loguniform(0.1, 10.0),
    scipy.stats.norm(1.0, 0.1),
    scipy.stats.lognorm(0.5, scale=0.2),
    scipy.stats.uniform(1.0, 2.0),
]


def test_random_numbers_have_their_distributions_and_are_independent(tmp_path):
    found = values(tmp_path, DESIGN.format(design="random", count=4000))
    for column, law in zip(found.T, LAWS, strict=True):
        assert scipy.stats.kstest(column, law.cdf).pvalue > 1e-3
    correlations = scipy.stats.spearmanr(found).statistic - np.eye(5)
    assert np.max(np.abs(correlations)) < 4 / np.sqrt(4000)


@pytest.mark.parametrize("design", ["random", "latin-hypercube", "sobol"])
def test_a_row_is_computed_from_its_number_alone(tmp_path, design):
    axes = DESIGN.format(design=design, count=64)
    whole = values(tmp_path, axes)
    for rows in ([63], [7, 3, 7], EVERY(20, 40)):
        np.testing.assert_array_equal(values(tmp_path, axes, rows), whole[rows])
    assert not np.array_equal(whole, values(tmp_path, axes.replace("seed = 5", "seed = 6")))


def test_a_latin_hypercube_has_a_point_in_each_part(tmp_path):
    found = values(tmp_path, DESIGN.format(design="latin-hypercube", count=50))
    for column, law in zip(found.T, LAWS, strict=True):
        assert sorted(np.floor(50 * law.cdf(column)).astype(int)) == list(range(50))


def test_sobol_points_have_less_discrepancy_than_random_ones(tmp_path):
    discrepancies = {}
    for design in ("sobol", "random"):
        found = values(tmp_path, DESIGN.format(design=design, count=256))
        cube = np.stack([law.cdf(column) for column, law in zip(found.T, LAWS, strict=True)], axis=1)
        discrepancies[design] = scipy.stats.qmc.discrepancy(np.clip(cube, 0, 1))
    assert discrepancies["sobol"] < discrepancies["random"] / 3


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_points_of_a_file_bit_for_bit(tmp_path, suffix):
    rng = np.random.default_rng(0)
    frame = pandas.DataFrame({"body.mass": rng.random(20), "masses[0].rail.radius": rng.random(20)})
    path = tmp_path / f"points{suffix}"
    frame.to_csv(path, index=False) if suffix == ".csv" else frame.to_parquet(path)
    found = values(tmp_path, f'[[axes]]\npoints = "{path.name}"\n')
    np.testing.assert_array_equal(found, frame.to_numpy())


def test_a_thousand_million_rows_cost_nothing_before_they_are_wanted(tmp_path):
    axes = DESIGN.format(design="random", count=10**9)
    found = study(tmp_path, axes)
    assert (found.rows, found.chunk, found.chunks) == (10**9, 8192, 122071)
    assert found.values(np.array([999_999_999])).shape == (1, 5)


def test_the_scenario_of_a_row_has_its_numbers_and_no_other(tmp_path):
    found = study(tmp_path)
    first, last = found.scenario(0), found.scenario(14)
    assert (float(first.system.mass), float(first.system.gravity)) == (0.5, 0.5)
    assert (float(last.system.mass), float(last.system.gravity)) == (2.0, 2.0)
    assert found.template().system.mass == 1.0


def test_a_number_left_to_its_default_can_change(tmp_path):
    """The disk of a row is that of a scenario in which the number is written by hand."""
    one = study(tmp_path, '[[axes]]\npath = "body.offset[0]"\nvalues = [0.0, 0.125]\n')
    assert "offset" not in DISK
    by_hand = read_scenario(DISK.replace("[body]", "[body]\noffset = [0.125, 0.0, 0.0]"))
    assert np.array_equal(np.asarray(one.scenario(0).system.offset), np.zeros(3))
    row = one.scenario(1)
    leaves, expected = (jax.tree.leaves((item.system, item.state)) for item in (row, by_hand))
    for leaf, other in zip(leaves, expected, strict=True):
        assert np.array_equal(leaf, other)


def test_a_key_that_does_not_go_with_those_there_has_no_default(tmp_path):
    """An axis beside a versor would be a second orientation."""
    with refuses(ScenarioError, "initial.axis[0]"):
        study(tmp_path, '[[axes]]\npath = "initial.axis[0]"\nvalues = [0.5]\n', scenario=builtin_text("ball"))
