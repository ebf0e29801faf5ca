"""Rows read together are what each row's own document reads as, and are possible where it is."""

import functools
import tomllib

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import tomli_w

from jaxball import ScenarioError
from jaxball.files.scenario.errors import UntraceableError
from jaxball.files.scenario.files import read_contents
from jaxball.files.scenario.paths import numbers_of, value_at, with_numbers
from jaxball.files.scenario.sources import builtin_text
from jaxball.files.scenario.traced import Parts
from jaxball.numerics.arrays import arrays_of
from jaxball.studies.sweep import StudyError, read_study, rows
from jaxball.studies.sweep.axes import Listed, Zipped
from jaxball.studies.sweep.rows import read_rows
from jaxball.studies.sweep.study import Study
from tests.scenario.documents import BALL, DISK, edited, with_motion, with_rail, with_schedule
from tests.support.sentences import refuses
from tests.support.structure import Structure
from tests.sweep.studies import study

PULSE = '{ kind = "pulse", theta = 0.3, height = 0.5, rate = 0.1, start = 0.1, hold = 0.5, end = 1.5 }'
WAYPOINTS = '{ kind = "waypoints", times = [0.0, 0.7, 2.0], theta = [0.1, 0.5, 0.2], end_rates = [0.1, 0.0] }'
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


# Found from other numbers: the same to rounding alone.
DERIVED = ("q", "theta", "thetadot", "multiplier")


@functools.cache
def document(name):
    return tomllib.loads(DOCUMENTS[name])


def changeable(name):
    """The numbers of a document, but for the second entries of vectors in the plane of a disk."""
    paths = numbers_of(document(name))
    return tuple(path for path in paths if name != "disk" or not (path.startswith("force") and path.endswith("[1]")))


def base_of(name, paths):
    return np.array([float(value_at(document(name), path)) for path in paths])


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


def contents(name, paths, values):
    """What the row's own document says; None where it is refused."""
    try:
        return read_contents(with_numbers(document(name), dict(zip(paths, values.tolist(), strict=True))))
    except ScenarioError:
        return None


def at_a_limit(name, paths, values):
    """Whether a row is possible or not as its numbers are a little larger or smaller."""
    nudged = [contents(name, paths, values * (1 + nudge)) is None for nudge in (-1e-9, -1e-14, 0.0, 1e-14, 1e-9)]
    return len(set(nudged)) > 1


def study_with(name, paths, values):
    """The study of a document whose rows have ``values`` at ``paths``."""
    listed = tuple(Listed(path, tuple(column.tolist())) for path, column in zip(paths, values.T, strict=True))
    return Study("", document(name), (Zipped(listed),), "times", False, False, (), len(values))


def compare(name, paths, values):
    """Which rows are possible, once they and their numbers are found to be those of their own documents."""
    with np.errstate(all="ignore"):
        stacked = rows._read_stack(study_with(name, paths, values), values)
        parts, possible = stacked.parts, stacked.possible
        for k, row in enumerate(values):
            own = contents(name, paths, row)
            if possible[k] != (own is not None):
                assert at_a_limit(name, paths, row), dict(zip(paths, row, strict=True))
            elif own is not None:
                own = Parts.of(own, document(name))  # of which it reads numbers of feedback, and there is none
                compare_numbers(jax.tree.map(lambda leaf, k=k: leaf[k], parts), own, tame=np.max(np.abs(row)) < 1e6)
    return possible


def compare_numbers(found, wanted, tame):
    for name, of_wanted in arrays_of(wanted.state).items():
        a, b = getattr(found.state, name), np.asarray(of_wanted)
        if name not in DERIVED:
            assert a.tobytes() == b.tobytes(), name
        elif tame:
            np.testing.assert_allclose(a, b, rtol=1e-12, atol=1e-14)
    others = (found._replace(state=None), wanted._replace(state=None))
    for a, b in zip(*map(jax.tree.leaves, others), strict=True):
        assert a.tobytes() == np.asarray(b, dtype=float).tobytes()


@pytest.mark.long
@pytest.mark.parametrize("name", DOCUMENTS)
def test_rows_are_their_documents(name):
    paths, rng = changeable(name), np.random.default_rng(len(name))
    compare(name, paths, drawn(base_of(name, paths), 6, rng))


@pytest.mark.slow
@pytest.mark.parametrize("name", DOCUMENTS)
def test_many_rows_are_their_documents(name):
    paths, rng = changeable(name), np.random.default_rng(1)
    base = base_of(name, paths)
    compare(name, paths, drawn(base, 200, rng))
    for _ in range(4):
        few = rng.choice(len(paths), min(3, len(paths)), replace=False)
        compare(name, tuple(paths[k] for k in few), drawn(base[few], 50, rng))


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("name", "path", "values", "wanted"),
    [
        ("the paper's ball", "masses[0].rail.radius", [0.5, 1.0, 1.0000001, 1.1, 0.0, -0.5], [True] * 2 + [False] * 4),
        ("the paper's ball", "body.inertia[2]", [1.9, 1.90001, -1.0, np.nan], [True, False, False, False]),
        ("the paper's ball", "time.end", [1.0, 0.0, -1.0, np.inf], [True, False, False, False]),
        ("disk", "masses[0].rail.radius", [1.0, 1.000001], [True, False]),
        ("servo", "masses[0].schedule.hold", [0.1, 0.05, 1.5], [True, False, False]),
        ("routh", "masses[0].position[2]", [0.6, 1.01], [True, False]),
        ("driven in a tube", "initial.theta[0]", [0.8, 1.0], [True, False]),
        ("pushed in a tube", "masses[0].schedule.rate", [0.1, 0.28, 0.9], [True, True, False]),
        ("free", "masses[0].free.constant[2]", [0.4, 0.95, 1.5], [True, False, False]),
        ("steps", "time.step", [0.25, 0.3, -1.0], [True, False, False]),
    ],
)
def test_rows_at_the_limits(name, path, values, wanted):
    np.testing.assert_array_equal(compare(name, (path,), np.array(values)[:, None]), wanted)


def test_a_row_in_doubt_is_read_by_itself(monkeypatch):
    """The bounds on a mass in a tube tell nothing about this one, which stays in the shell by little."""
    read, seen = rows._read, []
    monkeypatch.setattr(rows, "_read", lambda study, values: (seen.append(values.tolist()), read(study, values))[1])
    assert list(compare("pushed in a tube", ("masses[0].schedule.rate",), np.array([[0.01], [0.28]]))) == [True, True]
    assert seen == [[0.28]]


def test_conditions_are_told_by_the_paths_of_their_keys():
    structure = Structure(document("servo"), ("masses[0].schedule.hold", "masses[0].rail.radius"))
    holds = jax.jit(structure.conditions)(jnp.array([1.7, 1.1]))
    assert {path for path, fulfilled in holds.items() if not fulfilled} == {"masses[0].schedule.end", "masses"}
    assert {"masses[0].schedule.hold", "masses[0].rail.radius"} <= {path for path, one in holds.items() if one}


def test_a_structure_has_derivatives():
    """The versor of an axis and an angle, by the derivative of the half angle."""
    structure = Structure(document("turned"), ("initial.angle", "masses[0].mass"))
    slope = jax.jacfwd(lambda x: structure.build(x).state.q)(jnp.array([0.4, 0.5]))
    axis = np.array([1.0, 0.2, 0.3]) / np.linalg.norm([1.0, 0.2, 0.3])
    np.testing.assert_allclose(slope[:, 0], [-np.sin(0.2) / 2, *(np.cos(0.2) / 2 * axis)], rtol=1e-14)
    np.testing.assert_array_equal(slope[:, 1], 0)


def test_versors_are_rescaled_where_a_reader_does():
    q = np.random.default_rng(2).standard_normal((6, 4))
    q /= np.linalg.norm(q, axis=1, keepdims=True)
    q[3:] = np.round(q[3:], 7)
    q[5, 0] += 1e-3
    found = study_of(BALL + "[initial]\nversor = [1.0, 0.0, 0.0, 0.0]\n", [f"initial.versor[{k}]" for k in range(4)], q)
    possible, batch = read_rows(found, found.template(), np.arange(6), q)
    assert list(possible) == [0, 1, 2, 3, 4]
    for k in possible:
        np.testing.assert_allclose(batch.state.q[k], found.scenario(int(k)).state.q, rtol=1e-15)


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
    with refuses(ScenarioError, "masses[0].rail"):
        found.scenario(bad)


def test_what_does_not_change_takes_no_room(tmp_path):
    found = study(tmp_path, MANY.replace("1.0001", "0.9"), scenario=BALL)
    _, batch = read_rows(found, found.template(), found.rows_of(3), found.values(found.rows_of(3)))
    still = (batch.times, batch.state.q, batch.system.inertia, batch.system.groups[0].motion.schedule.theta)
    assert [leaf.strides[0] for leaf in still] == [0, 0, 0, 0]
    assert batch.rows == found.chunk


@pytest.mark.thorough
def test_balance_is_read_row_by_row_where_it_may_change(tmp_path, monkeypatch):
    text = with_rail('{ kind = "circle", radius = 0.9 }') + "[initial]\nbalance = { masses = [0] }\n"
    found = study(tmp_path, '[[axes]]\npath = "body.mass"\nvalues = [1.0, 2.0, -1.0]\n', scenario=text)
    with refuses(UntraceableError, "initial.balance"):
        rows._read_stack(found, found.values(np.arange(3)))
    possible, batch = read_rows(found, found.template(), np.arange(3), found.values(np.arange(3)))
    assert list(possible) == [0, 1]
    assert list(batch.system.mass) == [1.0, 2.0]
    monkeypatch.setattr(rows, "_read_one_by_one", None)
    axis = '[[axes]]\nzip = [{ path = "body.gravity", values = [2.0] }, { path = "time.end", values = [3.0] }]\n'
    other = study(tmp_path, axis, scenario=text)
    angle = float(found.template().system.groups[0].motion.schedule.theta[0])
    _, batch = read_rows(other, other.template(), np.arange(1), other.values(np.arange(1)))
    assert (float(batch.system.groups[0].motion.schedule.theta[0, 0]), batch.times[0, 1]) == (angle, 3.0)


def test_rows_with_other_numbers_of_save_times_are_refused_where_these_are_kept(tmp_path):
    axes = '[[axes]]\npath = "time.step"\nvalues = [0.5, 0.25]\n'
    text = edited("saves = 5", "step = 0.5")
    kept = study(tmp_path, axes, 'save = "times"', text)
    with refuses(StudyError, "time.saves"):
        read_rows(kept, kept.template(), np.arange(2), kept.values(np.arange(2)))
    ends = study(tmp_path, axes, scenario=text)
    _, batch = read_rows(ends, ends.template(), np.arange(2), ends.values(np.arange(2)))
    np.testing.assert_array_equal(batch.times, [[0.0, 2.0]] * 2)
