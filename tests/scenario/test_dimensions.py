"""The dimensions of numbers in files, against the page of keys; and logs whose unit is not that of the scenario."""

import re

import pytest

from jaxball import ScenarioError, read_scenario
from jaxball.files.scenario import Units, builtin_scenarios, read_document
from jaxball.files.scenario.paths import key_of, numbers_of
from jaxball.files.scenario.sources import builtin_text, document_of
from jaxball.files.scenario.units import dimension_of, parse_unit
from jaxball.files.scenario.values import kinds_of_numbers
from tests.support.keys import entries, meaning, unit
from tests.support.sentences import refuses

SI = Units("m", "kg", "s")


def units_on_the_page():
    """The units that the page gives for a key, by the path of its table; several where its kinds differ.

    They are those declared, or else what the words of a key end with.
    """
    unit_said = re.compile(r", ((?:(?:mass|length|time|rad|or|1)[²³]?[ /()]*)+)(?=[,;]|$)")
    units = {}
    for (path, _, name), key in entries().items():
        in_words = unit_said.search(meaning(key))
        its_units = unit(key.kind) or (in_words[1] if in_words else "1")
        units.setdefault(f"{path}.{name}".removeprefix("scenario."), set()).update(its_units.split(" or "))
    return units


def words_of(cell):
    """``mass length²/time`` as the code writes it."""
    powers = str.maketrans({"²": "^2", "³": "^3"})
    above, _, below = cell.translate(powers).partition("/")
    return "/".join(["*".join(above.split()), *below.strip("()").split()])


# What stands for an angle or a length by the joint, for what a sensor reads, or for several units in one list.
UNDECLARED = re.compile(
    r"initial\.(theta|thetadot|q|qdot)|(sensors|events|solve|estimator)\..*|feedback\.(Q|R|Qf|start|model|limits).*"
    r"|body\.xi\.(constant|amplitude)"  # the direction of an axis, on the page as a vector of any length
)


def along_a_slider(words):
    """What a unit of a joint is along a slider, where the page has that about a hinge."""
    return {
        words.replace("rad", "length", 1),
        words.replace("mass*length^2/time^2", "mass*length/time^2"),  # of a torque
        words.replace("mass*length^2", "mass"),  # of a stiffness and a damping
    }


@pytest.mark.parametrize("name", builtin_scenarios())
def test_dimensions_of_keys_are_those_of_the_page(name):
    document = document_of(builtin_text(name), "scenario", ScenarioError)
    with kinds_of_numbers() as kinds:
        read_document(document)
    page = units_on_the_page()
    for path in numbers_of(document):
        words, key = dimension_of(path, kinds, document), re.sub(r"\[\d+\]", "", key_of(path))
        on_page = {words_of(cell) for cell in page.get(key, ())}
        physical = {unit for unit in on_page if re.search("rad|length|mass|time", unit)}
        if not words:
            assert not physical or UNDECLARED.fullmatch(key), (path, physical)
        elif key in page and not key.endswith(".values"):  # of a signal, which have the unit of what it drives
            there = on_page.union(*map(along_a_slider, on_page)) if "joints" in key or "masses" in key else on_page
            assert words in there, (path, words, on_page)


def test_what_is_declared_is_known():
    document = document_of(builtin_text("ball"), "scenario", ScenarioError)
    with kinds_of_numbers() as kinds:
        read_document(document)
    wanted = {
        "body.mass": "kg",
        "body.inertia[1]": "kg m^2",
        "body.gravity": "m s^-2",
        "body.offset[2]": "m",
        "masses[0].mass": "kg",
        "masses[0].rail.radius": "m",
        "masses[0].schedule.theta": "rad",
        "time.end": "s",
    }
    paths = {*numbers_of(document)}
    assert {*wanted} <= paths
    assert {path: SI.of(dimension_of(path, kinds, document)) for path in wanted} == wanted


def test_a_tube_has_lengths_where_a_circle_has_angles():
    document = document_of(builtin_text("six-tubes"), "scenario", ScenarioError)
    with kinds_of_numbers() as kinds:
        read_document(document)
    scheduled = [path for path in numbers_of(document) if ".schedule." in path]
    words = {path: dimension_of(path, kinds, document) for path in scheduled}
    angles = ("phase", "frequency")
    assert len(words) > 10
    of_angles = {path for path in words if key_of(path).endswith(angles)}
    assert {path for path, word in words.items() if "rad" in word} == of_angles
    assert {word for path, word in words.items() if path.endswith((".theta", ".amplitude"))} <= {"length"}


def test_a_belt_travels_lengths():
    text = (
        builtin_text("disk")
        + '[ground.belt]\nheading = 0.0\ntravel = { kind = "constant-rate", theta = 0.5, rate = 2.0 }\n'
    )
    document = document_of(text, "scenario", ScenarioError)
    with kinds_of_numbers() as kinds:
        read_document(document)
    words = [
        dimension_of(f"ground.belt.{name}", kinds, document) for name in ("travel.theta", "travel.rate", "heading")
    ]
    assert words == ["length", "length/time", "rad"]


@pytest.mark.parametrize(
    ("text", "powers"),
    [
        ("N m", {"kg": 1, "m": 2, "s": -2}),
        ("kg m^2 s^-2", {"kg": 1, "m": 2, "s": -2}),
        ("m*N", {"kg": 1, "m": 2, "s": -2}),
        ("rad s^-1", {"rad": 1, "s": -1}),
        ("1", {}),
        ("m m^-1", {}),
        ("m/s", None),
        ("5 m", None),
    ],
)
def test_units_are_parsed(text, powers):
    assert parse_unit(text, SI) == powers


def test_names_of_si_stand_for_themselves_elsewhere():
    assert parse_unit("N", Units("cm", "g", "s")) == {"N": 1}


LOG = 'kind = "log", csv = "t,u\n0.0,0.0\n9.0,1.0\n", time = "t", column = "u"'.replace("\n", "\\n")
ROBOT = """
format = 1
kind = "ball"
{units}
[body]
mass = 1.0
radius = 1.0
inertia = [0.4, 0.4, 0.4]
gravity = 9.81
[[mechanisms]]
[[mechanisms.joints]]
kind = "{kind}"
axis = [0.0, 1.0, 0.0]
{drive}
[[mechanisms.masses]]
mass = 0.5
place = [0.0, 0.0, -0.5]
[time]
start = 0.0
end = 1.0
step = 0.5
"""
MOTOR = "force = { kind = 'motor', signal = { %s, unit = '%s' } }"
SCHEDULE = "schedule = { %s, interpolation = 'spline', unit = '%s' }"
STATED = 'units = { length = "m", mass = "kg", time = "s" }'


def robot(kind, drive, unit, units=STATED):
    return read_scenario(ROBOT.format(kind=kind, drive=drive % (LOG, unit), units=units))


@pytest.mark.parametrize(
    ("kind", "drive", "unit", "units"),
    [
        ("hinge", MOTOR, "N m", STATED),
        ("hinge", MOTOR, "kg m^2 s^-2", STATED),
        ("slider", MOTOR, "N", STATED),
        ("hinge", SCHEDULE, "rad", STATED),
        ("slider", SCHEDULE, "m", STATED),
        ("hinge", MOTOR, "g cm^2 s^-2", 'units = { length = "cm", mass = "g", time = "s" }'),
        ("hinge", MOTOR, "1", 'units = "dimensionless"'),
    ],
)
def test_a_log_in_the_units_of_the_scenario_is_read(kind, drive, unit, units):
    assert robot(kind, drive, unit, units).units is not None


@pytest.mark.parametrize(
    ("kind", "drive", "unit", "named"),
    [
        ("hinge", MOTOR, "N", "mechanisms[0].joints[0].force.signal.unit"),
        ("hinge", MOTOR, "N cm", "mechanisms[0].joints[0].force.signal.unit"),
        ("slider", MOTOR, "N m", "mechanisms[0].joints[0].force.signal.unit"),
        ("hinge", SCHEDULE, "deg", "mechanisms[0].joints[0].schedule.unit"),
        ("slider", SCHEDULE, "mm", "mechanisms[0].joints[0].schedule.unit"),
    ],
)
def test_a_log_in_other_units_is_refused(kind, drive, unit, named):
    with refuses(ScenarioError, named):
        robot(kind, drive, unit)


def test_a_unit_needs_those_of_the_scenario():
    with refuses(ScenarioError, "mechanisms[0].joints[0].force.signal.unit", "units"):
        robot("hinge", MOTOR, "N m", units="")
