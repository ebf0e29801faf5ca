"""Rows read together are what each row's own document reads as, bit for bit, and as possible or impossible."""

import functools
import tomllib

import jax
import numpy as np
import pytest
import tomli_w

from jaxball.scenario import ScenarioError, builtin_text, read_document
from jaxball.sweep import read_study
from jaxball.sweep.numbers import numbers_of, value_at, with_numbers
from jaxball.sweep.reading import plan, read_rows, rows
from jaxball.sweep.reading.entries import Place, arrays_of
from jaxball.sweep.reading.together import read_together
from jaxball.sweep.reading.verdict import BAD, GOOD, UNSURE
from tests.scenario.documents import BALL, DISK, edited, with_motion, with_rail, with_schedule
from tests.sweep.studies import study

PULSE = '{ kind = "pulse", theta = 0.3, height = 0.5, rate = 0.1, start = 0.1, hold = 0.5, end = 1.5 }'
WAYPOINTS = '{ kind = "waypoints", times = [0.0, 0.7, 2.0], angles = [0.1, 0.5, 0.2], end_rates = [0.1, 0.0] }'
TUBE = '{ kind = "tube", direction = [1.0, 0.5, 0.2], centre = [0.1, 0.0, 0.0] }'
FOURIER = (
    '{ kind = "fourier", cosine = [[0.5, 0.1, 0.0], [0.05, 0.0, 0.02]], sine = [[0.0, 0.3, 0.4], [0.0, 0.1, 0.0]], '
    "centre = [0.0, 0.0, 0.1] }"
)
SPLINE = '{ kind = "spline", points = [[0.5, 0.1, 0.0], [0.0, 0.6, 0.0], [-0.5, 0.0, 0.1], [0.0, -0.5, 0.1]] }'
LEMNISCATE = (
    '{ kind = "bernoulli-eight", half_width = 0.8, centre = [0.0, 0.1, 0.05], '
    "frame = { azimuth = 0.3, elevation = -0.2 } }"
)
MATRIX = '{ kind = "circle", radius = 0.7, frame = { matrix = [[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]] } }'
FREE = "free = { constant = [0.1, 0.2, 0.3], amplitude = [[0.1, 0.1, 0.1], [0.2, 0.0, 0.1]], frequency = [1.0, 3.0] }"
FORCE = "[force]\nconstant = [0.1, 0.0, 0.2]\namplitude = [[0.3, 0.0, 0.1]]\nfrequency = [2.0]\nphase = [0.1]\n"
TURNED = "[initial]\naxis = [1.0, 0.2, 0.3]\nangle = 0.4\nOmega = [0.1, 0.2, 0.3]\nz = [0.0, 1.0]\n"
INTEGRATED = '[actuation]\nform = "integrated"\n'
DOCUMENTS = {
    "the paper's ball": edited("step = 0.1", "saves = 7", builtin_text("ball")),
    "ellipse and eight, integrated": builtin_text("ellipse-and-eight"),
    "tubes": builtin_text("six-tubes"),
    "pendulum": builtin_text("pendulum"),
    "routh": builtin_text("routh-sphere"),
    "top": builtin_text("heavy-top"),
    "suslov": builtin_text("suslov"),
    "particle": 'format = 1\nkind = "vakonomic-particle"\nbody = { mass = 1.0 }\ninitial = { x = 0.1, y = 0.2, '
    "xdot = 0.3 }\ntime = { start = 0.0, end = 1.0, saves = 3 }\n",
    "turned": with_schedule(WAYPOINTS, BALL + TURNED),
    "lemniscate": with_rail(LEMNISCATE),
    "fourier": with_rail(FOURIER),
    "spline": with_rail(SPLINE),
    "matrix": with_rail(MATRIX),
    "free": with_motion(FREE),
    "pushed in a tube": with_rail(TUBE, with_schedule(PULSE.replace("height = 0.5", "height = 0.05"))),
    "driven in a tube": with_rail(TUBE) + INTEGRATED + "[initial]\ntheta = [0.2]\n",
    "servo": with_schedule(PULSE) + '[actuation]\nform = "servo"\nstiffness = [3.0]\ndamping = [1.0]\n',
    "disk": DISK + FORCE + "[initial]\nphi = 0.1\nphidot = 0.2\nz = 0.3\n",
    "offset": edited("gravity = 1.0", "gravity = 1.0\noffset = [0.6, 0.0, 0.8]"),
    "times one by one": edited("start = 0.0\nend = 2.0\nsaves = 5", "at = [0.0, 0.5, 2.0]") + "[solve]\nrtol = 1e-8\n",
    "steps": edited("saves = 5", "step = 0.5"),
}
EXTREMES = (0.0, -0.0, -1.0, 1.0, 2.0, np.nan, np.inf, 1e300, -1e300, 1e-300, 0.5, 0.999, 1e-9)


@functools.cache
def document(name):
    return tomllib.loads(DOCUMENTS[name])


def changeable(name):
    """The numbers of a document, but for the second entries of vectors in the plane of a disk."""
    paths = numbers_of(document(name))
    return tuple(path for path in paths if name != "disk" or not (path.startswith("force") and path.endswith("[1]")))


def drawn(base, count, rng):
    """Rows of which each has some numbers a little or much changed, and some of them numbers that are often wrong."""
    found = np.tile(base, (count, 1))
    for row in found:
        which = rng.random(base.size) < rng.choice([0.05, 0.3, 1.0])
        size = rng.choice([1e-17, 1e-12, 1e-9, 1e-7, 1e-3, 0.03, 0.3])
        row[which] += size * np.where(base == 0, 0.1, base)[which] * rng.standard_normal(which.sum())
        if rng.random() < 0.3:
            row[rng.integers(base.size)] = rng.choice(EXTREMES)
    return found


def slow(name, paths, values):
    try:
        return read_document(with_numbers(document(name), dict(zip(paths, values.tolist(), strict=True))))
    except ScenarioError:
        return None


def compare(name, paths, values):
    """The verdicts, once they and the numbers are found to be those of the documents of the rows."""
    with np.errstate(all="ignore"):
        found = plan.plan_of(tomli_w.dumps(document(name)), paths)
        together = read_together(found, paths, values, ends_only=False)
        for k, row in enumerate(values):
            scenario, verdict, batch = slow(name, paths, row), together.verdict[k], together.batch
            assert verdict == UNSURE or (verdict == GOOD) == (scenario is not None), dict(zip(paths, row, strict=True))
            if scenario is None or verdict != GOOD:
                continue
            parts = jax.tree.leaves((batch.system, batch.state, batch.rtol, batch.atol))
            for leaf, wanted in zip(parts, arrays_of(scenario), strict=True):
                assert leaf[k].tobytes() == wanted.tobytes()
            assert together.counts[k] == scenario.times.size
            if scenario.times.size == batch.times.shape[1]:
                assert batch.times[k].tobytes() == scenario.times.tobytes()
    return together.verdict


@pytest.mark.parametrize("name", DOCUMENTS)
def test_rows_are_their_documents(name):
    paths, rng = changeable(name), np.random.default_rng(len(name))
    base = np.array([float(value_at(document(name), path)) for path in paths])
    compare(name, paths, drawn(base, 6, rng))


@pytest.mark.slow
@pytest.mark.parametrize("name", DOCUMENTS)
def test_many_rows_are_their_documents(name):
    paths, rng = changeable(name), np.random.default_rng(1)
    base = np.array([float(value_at(document(name), path)) for path in paths])
    compare(name, paths, drawn(base, 200, rng))
    for _ in range(4):
        few = rng.choice(len(paths), min(3, len(paths)), replace=False)
        compare(name, tuple(paths[k] for k in few), drawn(base[few], 50, rng))


@pytest.mark.parametrize(
    ("name", "path", "values", "wanted"),
    [
        ("the paper's ball", "masses[0].rail.radius", [0.5, 1.0, 1.0000001, 1.1, 0.0, -0.5], [GOOD] * 2 + [BAD] * 4),
        ("the paper's ball", "body.inertia[2]", [1.9, 1.90001, -1.0, np.nan], [GOOD, BAD, BAD, BAD]),
        ("the paper's ball", "time.end", [1.0, 0.0, -1.0, np.inf], [GOOD, BAD, BAD, BAD]),
        ("disk", "masses[0].rail.radius", [1.0, 1.000001], [GOOD, BAD]),
        ("servo", "masses[0].schedule.hold", [0.1, 0.05, 1.5], [GOOD, BAD, BAD]),
        ("routh", "masses[0].position[2]", [0.6, 1.01], [GOOD, BAD]),
        ("driven in a tube", "initial.theta[0]", [0.8, 1.0], [GOOD, BAD]),
        ("steps", "time.step", [0.25, 0.3, -1.0], [GOOD, BAD, BAD]),
    ],
)
def test_bounds_decide_without_a_doubt(name, path, values, wanted):
    np.testing.assert_array_equal(compare(name, (path,), np.array(values)[:, None]), wanted)


def test_versors_are_rescaled_where_a_reader_does():
    q = np.random.default_rng(2).standard_normal((6, 4))
    q /= np.linalg.norm(q, axis=1, keepdims=True)
    q[3:] = np.round(q[3:], 7)
    q[5, 0] += 1e-3
    found = study_of(BALL + "[initial]\nversor = [1.0, 0.0, 0.0, 0.0]\n", [f"initial.versor[{k}]" for k in range(4)], q)
    possible, batch = read_rows(found, found.template(), np.arange(6), q)
    assert list(possible) == [0, 1, 2, 3, 4]
    for k in possible:
        np.testing.assert_array_equal(batch.state.q[k], found.scenario(int(k)).state.q)


def study_of(text, paths, values):
    members = "".join(
        f'{{ path = "{path}", values = {column.tolist()} }},\n' for path, column in zip(paths, values.T, strict=True)
    )
    table = tomllib.loads(text)
    return read_study(tomli_w.dumps({"format": 1, "scenario": table}) + f"[[axes]]\nzip = [\n{members}]\n")


MANY = """
[[axes]]
design = "random"
count = 1_000_000
seed = 4
[axes.numbers]
"body.mass" = { uniform = [0.5, 2.0] }
"masses[0].rail.radius" = { uniform = [0.4, 1.0001] }
"""


def test_an_impossible_row_among_a_million(tmp_path):
    found = study(tmp_path, MANY, "chunk = 8192", BALL)
    numbers = found.rows_of(found.chunks - 2)
    values = found.values(numbers)
    possible, batch = read_rows(found, found.template(), numbers, values)
    np.testing.assert_array_equal(possible, np.flatnonzero(values[:, 1] < 1))
    assert 0 < len(numbers) - len(possible) < 20
    np.testing.assert_array_equal(batch.system.groups[0].motion.rail.radius[:, 0], values[possible, 1])
    bad = int(numbers[np.setdiff1d(np.arange(len(numbers)), possible)[0]])
    with pytest.raises(ScenarioError, match=rf"Row {bad}: Key `masses\[0\].rail` must be a curve inside the shell"):
        found.scenario(bad)


def test_what_does_not_change_takes_no_room(tmp_path):
    found = study(tmp_path, MANY.replace("1.0001", "0.9"), scenario=BALL)
    _, batch = read_rows(found, found.template(), found.rows_of(3), found.values(found.rows_of(3)))
    still = (batch.times, batch.state.q, batch.system.inertia, batch.system.groups[0].motion.schedule.theta)
    assert [leaf.strides[0] for leaf in still] == [0, 0, 0, 0]
    assert batch.rows == found.chunk


def test_balance_is_read_row_by_row_where_it_may_change(tmp_path):
    text = with_rail('{ kind = "circle", radius = 0.9 }') + "[initial]\nbalance = { masses = [0] }\n"
    found = study(tmp_path, '[[axes]]\npath = "body.mass"\nvalues = [1.0, 2.0, -1.0]\n', scenario=text)
    assert plan.plan_of(tomli_w.dumps(found.document), found.paths) is None
    possible, batch = read_rows(found, found.template(), np.arange(3), found.values(np.arange(3)))
    assert list(possible) == [0, 1]
    assert list(batch.system.mass) == [1.0, 2.0]
    together = plan.plan_of(tomli_w.dumps(found.document), ("body.gravity", "time.end"))
    angle = float(found.template().system.groups[0].motion.schedule.theta[0])
    batch = read_together(together, ("body.gravity", "time.end"), np.array([[2.0, 3.0]]), ends_only=True).batch
    assert (float(batch.system.groups[0].motion.schedule.theta[0, 0]), batch.times[0, 1]) == (angle, 3.0)


def test_a_number_in_a_wrong_place_is_seen(tmp_path, monkeypatch):
    found = study(tmp_path)
    right = plan.plan_of(tomli_w.dumps(found.document), found.paths)
    wrong = right._replace(places=frozenset(Place(1 - item.column, *item[1:]) for item in right.places))
    monkeypatch.setattr(rows, "plan_of", lambda text, paths: wrong)
    _, batch = read_rows(found, found.template(), found.rows_of(0), found.values(found.rows_of(0)))
    np.testing.assert_array_equal(batch.system.mass, found.values(found.rows_of(0))[:, 0])


def test_rows_read_twice_are_few_and_among_all():
    sampled = np.flatnonzero(rows._sampled(np.arange(1_000_000), 1_000_000))
    assert {0, 999_999} <= set(sampled.tolist())
    assert 30 < len(sampled) < 120
    assert np.max(np.diff(sampled)) < 100_000
    assert np.all(rows._sampled(np.arange(8), 8))
