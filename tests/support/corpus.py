"""Documents of every kind of file: built-in ones, examples, those of the documentation, and some with everything."""

import re
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import tomli_w

from jaxball import read_scenario
from jaxball.files.scenario import builtin_scenarios
from jaxball.files.scenario.sources import builtin_text, document_of
from jaxball.studies.design import DesignError
from jaxball.studies.design.files import CONTROL_TABLE, problem_of, read_control
from jaxball.studies.sweep import read_study

from .every_mechanism import EVERY_MECHANISM
from .held_files import CONVEX_OR_HELD
from .surface_files import ON_SURFACES
from .under_feedback import FEEDFORWARD, PREDICTIVE, UNDER_FEEDBACK
from .vehicle_files import VEHICLES

ROOT = Path(__file__).parents[2]
EXAMPLES = ROOT / "examples"

EVERY_MOTION = """
format = 1
title = "Every rail, frame and schedule, on a plane with friction"
kind = "ball"
units = { length = "m", mass = "kg", time = "s" }
[body]
mass = 1.0
radius = 2.0
inertia = [0.9, 1.0, 1.1]
offset = [0.0, 0.0, -0.05]
gravity = 1.0

[force]
constant = [0.01, 0.0, 0.0]
amplitude = [[0.0, 0.02, 0.0]]
frequency = [1.5]
phase = [0.1]
powers = [[0.0, 0.01, 0.0], [0.001, 0.0, 0.0]]

[own_states]
names = ["turned", "rolled"]
units = ["rad", "rad"]
function = "jaxball.physics:odometer"
parameters = [0.0, 0.0, 1.0]
kink_times = [0.5]

[[masses]]
mass = 0.5
rail = { kind = "circle", radius = 0.9, centre = [0.1, 0.0, 0.0], frame = { azimuth = 0.8, elevation = 0.3 } }
schedule = { kind = "pulse", theta = 0.7, height = 1.0, rate = 0.0, start = 0.0, hold = 0.1, end = 0.2 }

[[masses]]
mass = 0.5
rail = { kind = "ellipse", semi_axes = [0.9, 0.5], frame = { versor = [1.0, 0.2, 0.0, 0.0] } }
schedule = { kind = "constant-rate", theta = 0.7, rate = 0.1 }

[[masses]]
mass = 0.5
rail = { kind = "gerono-eight", half_extents = [0.9, 0.5], frame = { matrix = [[0, -1, 0], [1, 0, 0], [0, 0, 1]] } }
schedule = { kind = "sinusoids", theta = 0.7, rate = 0.1, amplitude = [0.2], frequency = [1.0], phase = [0.3] }

[[masses]]
mass = 0.5
rail = { kind = "bernoulli-eight", half_width = 0.9 }

[masses.schedule]
kind = "piecewise-acceleration"
theta = 0.0
rate = 0.1
times = [0.0, 1.0, 2.0]
accelerations = [[0.1, 0.2], [0.0, 0.1]]

[[masses]]
mass = 0.5
rail = { kind = "tube", direction = [1.0, 0.0, 0.0], centre = [0.0, 0.1, 0.0] }
schedule = { kind = "waypoints", times = [0.0, 1.0, 5.0], theta = [0.0, 0.2, 0.1], end_rates = [0.0, 0.1] }

[[masses]]
mass = 0.5
rail = { kind = "fourier", cosine = [[0.5, 0.0, 0.0]], sine = [[0.0, 0.5, 0.0]], centre = [0.0, 0.0, 0.1] }
schedule = { kind = "log", csv = "t,a\\n0,0.7\\n2,0.8\\n4,0.7\\n", time = "t", column = "a", outside = "continue" }

[[masses]]
mass = 0.5
rail = { kind = "spline", points = [[0.5, 0.0, 0.0], [0.0, 0.5, 0.0], [-0.5, 0.0, 0.1]] }
schedule = { kind = "constant-rate", theta = 0.7 }

[[masses]]
mass = 0.2
position = [0.1, 0.0, -0.5]

[[masses]]
mass = 0.2
free = { constant = [0.0, 0.0, 0.3], amplitude = [[0.2, 0.0, 0.0]], frequency = [1.0], phase = [0.2] }

[contact]
friction = { kind = "smoothed-coulomb", kinetic = 0.3, smoothing = 0.01 }
static_friction = 0.4
restitution = 0.5
slowest = 1e-5
capacity = 16

[ground.motion]
free = { constant = [0.0, 0.0, 0.0], powers = [[0.0, 0.0, 0.0], [0.1, 0.0, 0.0]] }

[[mechanisms]]

[[mechanisms.joints]]
kind = "hinge"
axis = [0.0, 1.0, 0.0]
accelerated = true
schedule = { kind = "constant-rate", theta = 0.1, rate = 0.2 }

[[mechanisms.masses]]
mass = 0.1
place = [0.0, 0.0, -0.5]

[actuation]
form = "servo"
stiffness = [20.0, 10.0, 5.0]
damping = [6.0, 3.0, 2.0]
masses = [0, 4]

[initial]
axis = [0.0, 1.0, 0.0]
angle = 0.1
Omega = [0.0, 0.1, 0.0]
z = [0.0, 0.0]
velocity = [0.1, 0.0, 0.2]
height = 0.1
theta = [0.4, 0.1, 0.2]
thetadot = [0.0, 0.0, 0.1]
own = [0.0, 1.0]

[time]
start = 0.0
end = 5.0
step = 0.5

[solve]
solver = "gauss16"
rtol = 1e-10
atol = 1e-10
max_steps = 1000
max_step = 0.25
step_to_times = true
dae = false
project = true
"""

EVERY_EVENT = """
format = 1
title = "Every event"
kind = "disk"
body = { mass = 1.0, radius = 1.0, inertia = 0.5, gravity = 1.0 }
initial = { phidot = -1.0 }
time = { start = 0.0, end = 2.0, saves = 5 }

[events.post]
of = "z"
level = 1.5
direction = "rising"
terminal = true
capacity = 1

[events.speed]
of = "tests.support.corpus:speed_of"
direction = "falling"
capacity = 2

[events.slide]
kind = "slip"
friction = 0.3
terminal = false
capacity = 3

[events.lift]
kind = "detachment"
terminal = false
capacity = 4
"""

EVERY_AXIS = """
format = 1
title = "Every axis"
scenario = "disk"
save = "times"
contact = true
detachment = true
find = ["distance", "energy_drift", { name = "sine", maximum = "math:sin" }]
chunk = 16

[[axes]]
path = "body.mass"
values = [1.0, 2.0]

[[axes]]
path = "body.gravity"
linear = { from = 0.5, to = 2.0, count = 3 }

[[axes]]
path = "body.inertia"
log = { from = 0.5, to = 2.0, count = 3 }

[[axes]]
design = "sobol"
count = 4
seed = 1

[axes.numbers]
"body.radius" = { uniform = [0.9, 1.0] }
"time.end" = { log-uniform = [1.0, 2.0] }
"masses[0].mass" = { normal = [1.0, 0.1] }
"masses[1].mass" = { lognormal = [1.0, 0.1] }

[[axes]]
zip = [
  { path = "masses[0].schedule.theta", values = [0.0, 0.1] },
  { path = "masses[1].schedule.theta", linear = { from = 0.0, to = 1.0, count = 2 } },
]
"""

_TO_BE_DESIGNED = """
format = 1
title = "Every objective and constraint"

[scenario]
format = 1
kind = "KIND"
body = { mass = 1.0, radius = 1.0, inertia = INERTIA, gravity = 1.0 }
time = { start = 0.0, end = 5.0, saves = 11 }

[[scenario.masses]]
mass = 1.0
rail = { kind = "circle", radius = 0.9 }
schedule = { kind = "constant-rate", theta = -1.5, rate = 0.1 }
"""
_VARIABLES = """
[[variables]]
path = ["masses[0].schedule.rate", "masses[0].schedule.theta"]
factors = [1.0, -1.0]
lower = -0.5
upper = 0.5
start = 0.2
scale = 0.3

[[variables]]
path = "masses[*].rail.radius"

[robust]
count = 4
masses = 0.02
offset = 0.01
seed = 1

[search]
starts = 4
spread = 0.1
steps = 10
learning_rate = 0.1
polished = 2
rounds = 3
evaluations = 10
penalty = 1.0
tolerance = 1e-4
stationary = 1e-4
seed = 3
method = "gauss-newton"
intervals = 2

[[objectives]]
kind = "reach-place"
place = PLACE
weight = 2.0

[[objectives]]
kind = "reach-pose"
versor = [1.0, 0.0, 0.1, 0.0]

[[objectives]]
kind = "stop-at-rest"

[[objectives]]
kind = "balanced"

[[objectives]]
kind = "duration"

[[objectives]]
kind = "go-far"

[[objectives]]
kind = "function"
function = "tests.support.corpus:last_speed"
weight = 0.5

[[objectives]]
kind = "follow-curve"
curve = { kind = "sigmoid", length = 2.0, height = HEIGHT, steepness = 8.0, origin = PLACE }

[[objectives]]
kind = "largest-distance"
curve = { kind = "figure-eight", length = 2.0, height = HEIGHT, origin = PLACE }

[[constraints]]
kind = "rails-apart"
distance = 0.1

[[constraints]]
kind = "regular-rails"
least = 0.1
[[constraints]]
kind = "function"
function = "tests.support.corpus:speeds"
parameters = [2.0]
"""
_CONTROL = """
[control]
place = PLACE
depth = 0.1
intervals = 8
tolerance = 1e-5
violation = 1e-3
barrier = 0.1
guess = "rolling-along"
first_weights = { force-effort = 0.1 }
"""
_WITHOUT_KEYS = "masses-near-centre", "acceleration-effort", "power-effort", "force-effort", "joint-effort"
_ALONG_THE_RUN = """
[[objectives]]
kind = "follow-trajectory"
curve = { kind = "through", points = [PLACE, PLACE] }
rest_to_rest = true
start = 0.5
end = 4.0

[[objectives]]
kind = "avoid-obstacles"
centres = [PLACE]
radii = [0.2]
softness = 0.1

[[objectives]]
kind = "running-function"
function = "tests.support.corpus:speeds"
parameters = { scale = [2.0] }

[[constraints]]
kind = "rails-inside"
clearance = 0.05

[[constraints]]
kind = "masses-apart"
distance = 0.1

[[constraints]]
kind = "speed-limit"
most = 1.0

[[constraints]]
kind = "acceleration-limit"
most = 1.0

[[constraints]]
kind = "force-limit"
most = 1.0

[[constraints]]
kind = "joint-effort-limit"
most = 1.0

[[constraints]]
kind = "running-function"
function = "tests.support.corpus:speeds"

[[constraints]]
kind = "normal-force"
least = 0.3

[[constraints]]
kind = "friction"
friction = 0.3

[[constraints]]
kind = "on-ground"

[[constraints]]
kind = "clear-of-obstacles"
centres = [PLACE]
radii = [0.2]

[[constraints]]
kind = "within"
lower = LOW
upper = HIGH
"""
OF_A_BALL = {"KIND": "ball", "INERTIA": "[1.0, 1.0, 1.0]", "PLACE": "[1.0, 0.5]", "HEIGHT": "1.0"}
OF_A_BALL |= {"LOW": "[-5.0, -5.0]", "HIGH": "[5.0, 5.0]"}
OF_A_DISK = {"KIND": "disk", "INERTIA": "1.0", "PLACE": "1.0", "HEIGHT": "0.0", "LOW": "-5.0", "HIGH": "5.0"}


def every_kind(body: dict[str, str], controlled: bool) -> str:
    """A problem with every objective and constraint that there is, of a search or of optimal control."""
    text = _TO_BE_DESIGNED + (_CONTROL if controlled else _VARIABLES) + _ALONG_THE_RUN
    text += "".join(f'\n[[objectives]]\nkind = "{kind}"\n' for kind in _WITHOUT_KEYS)
    for name, value in body.items():
        text = re.sub(rf"\b{name}\b", value, text)
    return text


def speeds(run: Any, parameters: Any) -> Any:
    """An objective or a constraint at each time."""
    return run.observables.kinetic_energy


def speed_of(system: Any, t: Any, state: Any) -> Any:
    """An event."""
    return state.phidot**2 - 0.5


def last_speed(run: Any, parameters: Any) -> Any:
    """An objective of a whole run."""
    return run.observables.kinetic_energy[-1]


def kinds() -> set[str]:
    """The kinds of tables that documents with everything have."""

    def within(value: Any) -> set[str]:
        items = value.values() if isinstance(value, dict) else value if isinstance(value, list) else ()
        here = {value["kind"]} if isinstance(value, dict) and "kind" in value else set()
        return here.union(*map(within, items))

    return set().union(*map(within, with_everything()))


def scenarios() -> dict[str, dict[str, Any]]:
    """The built-in scenarios, those of the documentation, and some with everything that a body can have."""
    texts = {name: builtin_text(name) for name in builtin_scenarios()}
    texts |= _blocks("reference/scenario-files.md", "```toml\n(.*?)```") | {"every motion": EVERY_MOTION}
    texts |= {"every mechanism": EVERY_MECHANISM, "under feedback": UNDER_FEEDBACK}
    texts |= {"predictive": PREDICTIVE, "feedforward": FEEDFORWARD, "every event": EVERY_EVENT}
    return {name: tomllib.loads(text) for name, text in (texts | ON_SURFACES | VEHICLES | CONVEX_OR_HELD).items()}


def studies() -> dict[str, dict[str, Any]]:
    """Those of the documentation, and one with every axis."""
    texts = _blocks("how-to/sweeps.md", "```toml\n(.*?)```") | _blocks("how-to/sweeps.md", 'read_study\\("""\n(.*?)"""')
    return {name: tomllib.loads(text) for name, text in (texts | {"every axis": EVERY_AXIS}).items()}


def problems() -> dict[str, dict[str, Any]]:
    """Those of the examples and the documentation, and four with everything that can be asked for."""
    texts = {path.stem: path.read_text() for path in EXAMPLES.glob("problem*.toml")}
    texts |= _blocks("how-to/design.md", 'read_problem\\("""\n(.*?)"""')
    for body in (OF_A_BALL, OF_A_DISK):
        for controlled in (False, True):
            texts[f"every kind, {body['KIND']}{', controlled' * controlled}"] = every_kind(body, controlled)
    return {name: tomllib.loads(text) for name, text in texts.items()}


def with_everything() -> list[dict[str, Any]]:
    """Documents that have all keys there are, but for `balance`."""
    rigid = ("free-rigid-body", "heavy-top", "suslov", "rattleback", "oblate-ball")
    classical = (*rigid, "nonholonomic-particle", "vakonomic-particle")
    with_all_keys = ("every motion", "every mechanism", "under feedback", "predictive", "feedforward", "every event")
    named = [name for name in problems() if name.startswith("every kind")]
    return [
        *(scenarios()[name] for name in (*classical, "disk", *with_all_keys, *ON_SURFACES, *VEHICLES, *CONVEX_OR_HELD)),
        studies()["every axis"],
        *(problems()[name] for name in named),
    ]


def read_any(document: dict[str, Any]) -> Any:
    """A scenario, a study, or a problem of search or of optimal control, whichever it is."""
    return reader_of(document)(tomli_w.dumps(document))


def reader_of(document: dict[str, Any]) -> Callable[[str], Any]:
    """What reads documents of this kind."""
    if "axes" in document:
        return lambda text: read_study(text, EXAMPLES)
    return _read_problem if "objectives" in document else read_scenario


def _read_problem(text: str) -> Any:
    document = document_of(text, "problem", DesignError)
    return (read_control if CONTROL_TABLE in document else problem_of)(document, EXAMPLES)


def _blocks(document: str, pattern: str) -> dict[str, str]:
    found = re.findall(pattern, (ROOT / "docs" / document).read_text(), re.DOTALL)
    return {f"{document} {k}": text for k, text in enumerate(found) if "format = 1" in text}
