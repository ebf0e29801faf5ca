"""A scenario that is written and read again is the same, bit for bit."""

import math
import tomllib

import jax
import numpy as np
import pytest
import tomli_w
from hypothesis import Phase, given, settings, strategies as st

from jaxball import Scenario, load_scenario, read_scenario, write_scenario
from jaxball.files.scenario import builtin_scenarios
from jaxball.files.scenario.sources import builtin_text

from .documents import DISK


def numbers(low: float, high: float):
    return st.floats(low, high, allow_nan=False, allow_subnormal=False)


def vectors(size: float, count: int = 3):
    return st.lists(numbers(-size, size), min_size=count, max_size=count)


ANY = numbers(-10.0, 10.0)
SIZE = numbers(0.01, 0.3)
SMALL = vectors(0.05)
UNITS = vectors(1.0, 4).filter(lambda q: math.hypot(*q) > 0.1)


def table(kind=None, optional=None, **keys):
    named = {} if kind is None else {"kind": st.just(kind)}
    return st.fixed_dictionaries({**named, **keys}, optional=optional or {})


def rotation(q):
    w, x, y, z = (np.asarray(q) / np.linalg.norm(q)).tolist()
    return [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]


FRAMES = st.one_of(
    table(azimuth=numbers(-6.0, 6.0), elevation=numbers(-1.5, 1.5)),
    table(versor=UNITS),
    table(matrix=UNITS.map(rotation)),
)
PLACE = {"centre": SMALL, "frame": FRAMES}
PAIR = st.lists(SIZE, min_size=2, max_size=2)
RAILS = st.one_of(
    table("circle", PLACE, radius=SIZE),
    table("ellipse", PLACE, semi_axes=PAIR),
    table("gerono-eight", PLACE, half_extents=PAIR),
    table("bernoulli-eight", PLACE, half_width=SIZE),
    table(
        "fourier",
        {"centre": SMALL},
        cosine=st.tuples(SMALL, SMALL).map(list),
        sine=st.tuples(SMALL, SMALL).map(list),
    ),
    table("spline", points=st.lists(vectors(0.2), min_size=4, max_size=4)),
)


def waves(amplitudes):
    def of(count):
        phases = st.lists(ANY, min_size=count, max_size=count)
        rows = st.lists(amplitudes, min_size=count, max_size=count)
        return table(None, {"phase": phases}, amplitude=rows, frequency=phases)

    return st.integers(1, 2).flatmap(of)


def increasing(count):
    return st.lists(numbers(0.1, 2.0), min_size=count, max_size=count).map(lambda steps: np.cumsum(steps).tolist())


def paths(count):
    angles = st.lists(ANY, min_size=count, max_size=count)
    return table("waypoints", {"end_rates": vectors(1.0, 2)}, times=increasing(count), theta=angles)


def pieces(count):
    rows = st.lists(vectors(1.0, 2), min_size=count, max_size=count)
    return table("piecewise-acceleration", {"rate": ANY}, theta=ANY, times=increasing(count + 1), accelerations=rows)


SCHEDULES = st.one_of(
    table("constant-rate", {"rate": ANY}, theta=ANY),
    table(
        "pulse",
        {"height": ANY, "rate": ANY, "start": numbers(-1.0, 0.05), "end": numbers(0.3, 2.0)},
        theta=ANY,
    ),
    st.builds(
        lambda wave, line: wave | line,
        waves(numbers(-1.0, 1.0)),
        table("sinusoids", {"rate": ANY}, theta=ANY),
    ),
    paths(3),
    pieces(2),
)
ON_RAIL = table(mass=SIZE, rail=RAILS, schedule=SCHEDULES)
TUBE = table("tube", {"centre": SMALL}, direction=vectors(1.0).filter(lambda d: math.hypot(*d) > 0.1))
IN_TUBE = table(
    mass=SIZE, rail=TUBE, schedule=table("constant-rate", theta=numbers(-0.5, 0.5), rate=numbers(-0.01, 0.01))
)
FREE = st.builds(lambda wave, constant: wave | {"constant": constant}, waves(SMALL), SMALL)
MASSES = st.one_of(ON_RAIL, ON_RAIL, IN_TUBE, table(mass=SIZE, position=vectors(0.5)), table(mass=SIZE, free=FREE))

BODY = table(
    None,
    {"offset": SMALL},
    mass=SIZE,
    radius=st.just(1.0),
    gravity=ANY,
    inertia=st.lists(numbers(0.5, 0.9), min_size=3, max_size=3),
)
UNIT = UNITS.map(lambda q: (np.asarray(q) / np.linalg.norm(q)).tolist())
MOVING = {"Omega": vectors(1.0), "z": vectors(1.0, 2)}
INITIAL = st.one_of(
    st.fixed_dictionaries({}, optional={"versor": UNIT, **MOVING}),
    st.fixed_dictionaries({"axis": vectors(1.0).filter(any), "angle": ANY}, optional=MOVING),
)
TIME = st.one_of(
    table(start=numbers(-5.0, -0.1), end=numbers(0.1, 9.0), saves=st.integers(2, 50)),
    st.fixed_dictionaries({"at": increasing(4)}),
)
KNOW_MASS_MATRICES = ["radau5", "radau9", "radau13", "ndf", "trapezoidal", "tr-bdf2"]
SOLVERS = ["dopri5", "dopri8", "tsit5", "kvaerno3", "kvaerno5", "adams", "gauss16"]
SOLVERS += KNOW_MASS_MATRICES
SOLVE = table(
    optional={
        "solver": st.sampled_from(SOLVERS),
        "rtol": numbers(1e-12, 1e-3),
        "atol": numbers(1e-12, 1e-3),
        "max_steps": st.integers(1, 10**6),
        "max_step": numbers(1e-3, 9.0),
        "step_to_times": st.booleans(),
        "project": st.booleans(),
    }
)
SOLVE_DAE = table(solver=st.sampled_from(KNOW_MASS_MATRICES), dae=st.booleans())
ACTUATION = st.one_of(st.none(), st.just("integrated"), st.just("servo"))


@st.composite
def documents(draw):
    """Scenario files of balls, of every family of rails, schedules and motions."""
    document = {"format": 1, "kind": "ball", "body": draw(BODY), "title": draw(st.text(max_size=20))}
    document |= {"initial": draw(INITIAL), "time": draw(TIME), "solve": draw(st.one_of(SOLVE, SOLVE, SOLVE_DAE))}
    document["masses"] = draw(st.lists(MASSES, max_size=3))
    if draw(st.booleans()):
        document["force"] = draw(FREE)
    rails = [index for index, mass in enumerate(document["masses"]) if "rail" in mass]
    form = draw(ACTUATION) if rails else None
    if form is not None:
        chosen = draw(st.lists(st.sampled_from(rails), min_size=1, unique=True).map(sorted))
        document["actuation"] = {"form": form, "masses": chosen}
        if form == "servo":
            gains = st.lists(numbers(0.0, 9.0), min_size=len(chosen), max_size=len(chosen))
            document["actuation"] |= {"stiffness": draw(gains), "damping": draw(gains)}
    return document


DEFAULTS = {
    "title": "",
    "offset": [0.0, 0.0, 0.0],
    "constant": [0.0, 0.0, 0.0],
    "centre": [0.0, 0.0, 0.0],
    "frame": {"matrix": [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]},
    "rate": 0.0,
    "height": 1.0,
    "start": 0.0,
    "hold": 0.1,
    "end": 0.2,
    "end_rates": [0.0, 0.0],
    "versor": [1.0, 0.0, 0.0, 0.0],
    "Omega": [0.0, 0.0, 0.0],
    "z": [0.0, 0.0],
    "solver": "dopri8",
    "rtol": 1e-10,
    "atol": 1e-10,
    "max_steps": 16384,
    "step_to_times": False,
    "dae": False,
    "project": False,
}


def same_objects(one: Scenario, other: Scenario) -> bool:
    """Whether two scenarios have the same structure and the same bits in every number."""
    parts = [(s.system, s.state, s.contact, s.times, s.rtol, s.atol) for s in (one, other)]
    (leaves, structure), (others, other_structure) = (jax.tree.flatten(part) for part in parts)
    settings = [(s.title, s.solver, s.max_steps, s.max_step, s.step_to_times, s.dae, s.project) for s in (one, other)]
    return (
        structure == other_structure
        and settings[0] == settings[1]
        and all(np.asarray(a).tobytes() == np.asarray(b).tobytes() for a, b in zip(leaves, others, strict=True))
    )


def assert_says_the_same(written, document, path=""):
    """Every number of the document is in what was written, digit for digit, unless it is a default."""
    for name, value in document.items():
        where = f"{path}.{name}"
        if name in ("axis", "angle", "masses") and name not in written:
            continue
        if name not in written:
            # A table whose every key is a default is left out.
            missing = value.items() if isinstance(value, dict) and name in ("initial", "solve") else [(name, value)]
            for key, omitted in missing:
                assert key in ("axis", "angle") or repr(omitted) == repr(DEFAULTS[key]), where
        elif isinstance(value, dict):
            assert_says_the_same(written[name], value, where)
        elif name == "masses" and path == "":
            for index, (one, other) in enumerate(zip(written[name], value, strict=True)):
                assert_says_the_same(one, other, f"{where}[{index}]")
        else:
            assert repr(written[name]) == repr(value), where


# Without shrinking, which takes minutes at some 50 ms an example.
@pytest.mark.long
@settings(max_examples=30, deadline=None, phases=[Phase.explicit, Phase.reuse, Phase.generate])
@given(documents())
def test_random_scenarios(document):
    scenario = read_scenario(tomli_w.dumps(document))
    text = write_scenario(scenario)
    again = read_scenario(text)
    assert same_objects(scenario, again)
    assert write_scenario(again) == text
    asked = document.pop("time")
    even = "at" not in asked
    times = np.linspace(asked["start"], asked["end"], asked["saves"]) if even else np.asarray(asked["at"])
    assert np.array_equal(scenario.times, times)
    assert_says_the_same(tomllib.loads(text), document)


def features(table, path=""):
    """The keys of a file, of which those in lists are one, with the kinds that it has there."""
    for name, value in table.items():
        where = f"{path}.{name}"
        yield f"{where} = {value}" if name == "kind" else where
        for item in value if isinstance(value, list) else [value]:
            if isinstance(item, dict):
                yield from features(item, where)


def with_every_feature():
    """Built-in scenarios that together have every key and kind of all of them, those with the most first."""
    left = {name: {*features(tomllib.loads(builtin_text(name)))} for name in builtin_scenarios()}
    while any(left.values()):
        name = max(left, key=lambda name: len(left[name]))
        yield name
        left = {other: keys - left[name] for other, keys in left.items()}


@pytest.mark.thorough
@pytest.mark.parametrize("name", [*with_every_feature()])
def test_builtin_scenarios(name):
    scenario = load_scenario(name)
    again = read_scenario(write_scenario(scenario))
    assert same_objects(scenario, again)
    assert scenario.title == tomllib.loads(builtin_text(name))["title"]


def test_state_of_a_disk():
    text = DISK + "[initial]\nphi = 0.1\nphidot = -0.2\nz = 0.3\n"
    scenario = read_scenario(text)
    assert [float(x) for x in (scenario.state.phi, scenario.state.phidot, scenario.state.z)] == [
        0.1,
        -0.2,
        0.3,
    ]
    assert tomllib.loads(write_scenario(scenario))["initial"] == {"phi": 0.1, "phidot": -0.2, "z": 0.3}


def test_uneven_times_are_written_one_by_one():
    text = DISK.replace("start = 0.0\nend = 2.0\nsaves = 5", "at = [0.0, 0.5, 2.0]")
    assert tomllib.loads(write_scenario(read_scenario(text)))["time"] == {"at": [0.0, 0.5, 2.0]}


def test_step_gives_round_times():
    text = DISK.replace("saves = 5", "step = 0.5")
    assert read_scenario(text).times.tolist() == [0.0, 0.5, 1.0, 1.5, 2.0]
