"""RoboBall II, a robot of Texas A&M: its joint friction and its soft shell identified from measured runs.

Its steering joint turns a pendulum across the axis of rolling. In one experiment the shell hangs in a stand, and the
pendulum is let go at an angle; in the other the robot stands on the floor, is tilted against the pendulum, and let go.
Parameters come from one run of each; the others are predicted from their first samples. The measured angles, and all
parameters but those identified, are from https://github.com/mjoo-man/Drake_Based_Pendulum_Driven_Spherical_Robot
(MIT licence, in data/roboball/LICENSE). With `--steering` the robot on the floor is identified as well, and
`measured_robot.png` drawn, which takes some minutes.
"""

import sys
import tomllib
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure

from jaxball import Wrench
from jaxball.files.scenario import read_document
from jaxball.programs import cpu
from jaxball.studies.design import DesignSpace, Variable

cpu.prepare()
jax.config.update("jax_enable_x64", True)

DATA = Path(__file__).parent / "data" / "roboball"
RUNS = {"stand": 4, "steering": 3}
FITTED = {"stand": 1, "steering": 0}  # one run of each; the others are not seen
# Up to the length of the shortest run, so that one program does for all. On the floor the robot comes off the hand that
# holds it in the first half second.
SAMPLES = {"stand": slice(0, 215), "steering": slice(25, 167)}

# About its hinge the pendulum turns as two masses of half its own; their inertia is m (0.095² + 0.1417²).
PENDULUM = """
[[mechanisms]]
masses = [
  { mass = 11.015, place = [0.0033714, 0.0, 0.0467] },
  { mass = 11.015, place = [0.0033714, 0.0, -0.2367] },
]

[[mechanisms.joints]]
kind = "hinge"
axis = [0.0, -1.0, 0.0]  # so that θ has the sense of φ
force = { kind = "joint-friction", kinetic = 0.65, static = 0.7, viscous = 0.104 }

[initial]
"""
# A shell so heavy that nothing moves it.
STAND = f"""
format = 1
kind = "disk"
body = {{ mass = 1e9, inertia = 1e9, radius = 0.3175, gravity = 9.81 }}
{PENDULUM}
"""
# Shell and pitch centre as one body: its mass, centre of mass and inertia about that.
STEERING = f"""
format = 1
kind = "disk"
body = {{ mass = 19.31583, inertia = 1.06436, radius = 0.3175, offset = [0.0, 0.0, -0.0071945], gravity = 9.81 }}

[force]
function = "__main__:of_the_shell"
parameters = {{ stiffness = 0.0, damping = 0.0 }}
{PENDULUM}
"""
TEXTS = {"stand": STAND, "steering": STEERING}
FRICTION = "mechanisms[0].joints[0].force"
ASIDE = ("mechanisms[0].masses[0].place[0]", "mechanisms[0].masses[1].place[0]")
SHELL = "force.parameters"
LEVELS = (f"{FRICTION}.kinetic", f"{FRICTION}.static")
RATIO = 0.7 / 0.65  # of static to kinetic friction, as published; these runs do not determine it
# The law of five numbers in that repository's code, with its numbers: kinetic friction doubles towards rest.
FIVE_NUMBERS = {"kinetic": 0.45, "static": 0.9, "viscous": 0.204, "stribeck": 0.1, "exponent": 1}


def of_the_shell(t, motion, parameters):
    """The torque by which a soft shell turns back to where it is flattest, −stiffness sin φ − damping φ̇ about −e2."""
    sine, rate = motion.Lambda[2, 0], -jnp.sum(motion.Lambda[1] * motion.Omega)
    back = parameters["stiffness"] * sine + parameters["damping"] * rate
    return Wrench(jnp.zeros(3), back * jnp.array([0.0, 1.0, 0.0]))


def measured(kind, index):
    """The times of a run and the measured angles, θ, or φ and θ."""
    table = np.loadtxt(DATA / f"{kind}-{index}.csv", delimiter=",", skiprows=1)[SAMPLES[kind]]
    return table[:, 0] - table[0, 0], table[:, 1:]


def start(kind, index):
    """The state that a parabola through the first samples has."""
    times, angles = measured(kind, index)
    early = times < 0.1
    rates, places = np.polyfit(times[early], angles[early], 2)[1:].tolist()
    joint = {"theta": places[-1:], "thetadot": rates[-1:]}
    return joint if kind == "stand" else {"phi": places[0], "phidot": rates[0], **joint}


def document(kind, index, changes):
    """The scenario of a run, with some of its numbers changed."""
    found = tomllib.loads(TEXTS[kind])
    found["time"] = {"at": measured(kind, index)[0].tolist()}
    found["initial"] = start(kind, index)
    joint, masses = found["mechanisms"][0]["joints"][0], found["mechanisms"][0]["masses"]
    for path, value in changes.items():
        if path in ASIDE:
            masses[ASIDE.index(path)]["place"][0] = value
        elif path.startswith(SHELL):
            found["force"]["parameters"][path.rpartition(".")[2]] = value
        elif path.startswith(FRICTION):
            joint["force"][path.rpartition(".")[2]] = value
    return found


def joint_angle(run):
    return run.state.theta


def both_angles(run):
    return jnp.concatenate([run.state.phi[:, None], run.state.theta], axis=1)


def compare(kind, label, changes):
    """The runs with these numbers, each from its own start, and the root mean squares of their errors."""
    runs = [read_document(document(kind, index, changes)).simulate() for index in range(RUNS[kind])]
    assert all(run.ok for run in runs)
    quantity = joint_angle if kind == "stand" else both_angles
    found = [np.asarray(quantity(run)) for run in runs]
    errors = [np.sqrt(np.mean((x - measured(kind, index)[1]) ** 2)) for index, x in enumerate(found)]
    print(
        f"{kind:9} {label:34}", "  ".join(f"run {index}: {error:.4f}" for index, error in enumerate(errors)), flush=True
    )
    return found, errors


def identified(kind, variables, quantity):
    """The numbers of a run that fit it best, with what is uncertain of them."""
    index = FITTED[kind]
    fit = DesignSpace(document(kind, index, {}), variables).identify(measured(kind, index)[1], quantity)
    print(fit, flush=True)
    known = dict(zip(fit.names, fit.estimates.tolist(), strict=True))
    changes = {name: value for name, value in known.items() if not name.startswith("initial")}
    return changes | {ASIDE[1]: changes[ASIDE[0]], LEVELS[1]: RATIO * changes[LEVELS[0]]}


def stand():
    """Friction of the joint and the place of the pendulum, from one run; what three others say of them."""
    five = {f"{FRICTION}.{name}": value for name, value in FIVE_NUMBERS.items()}
    compare("stand", "published, Coulomb and viscous", {})
    compare("stand", "published, five numbers", five)
    variables = [
        Variable(LEVELS, factors=(1.0, RATIO), lower=0.0),
        Variable((f"{FRICTION}.viscous",), lower=0.0),
        Variable(ASIDE, scale=1e-3),
        Variable(("initial.theta[0]",)),
        Variable(("initial.thetadot[0]",)),
    ]
    changes = identified("stand", variables, joint_angle)
    return changes, *compare("stand", "identified from run 1", changes)


def steering(friction):
    """What the shell does, from one run, with the friction that the stand told."""
    compare("steering", "rigid shell", friction)
    variables = [
        Variable((f"{SHELL}.stiffness",), start=20.0, scale=10.0),
        Variable((f"{SHELL}.damping",), start=2.0, scale=1.0),
        Variable(LEVELS, factors=(1.0, RATIO), lower=0.0),
        Variable((f"{FRICTION}.viscous",), lower=0.0),
        Variable(ASIDE, scale=1e-3),
        *(Variable((f"initial.{name}",)) for name in ("phi", "phidot", "theta[0]", "thetadot[0]")),
    ]
    changes = identified("steering", variables, both_angles)
    return compare("steering", "identified from run 0", changes)


def draw(stands, steerings):
    """The runs that were not seen, measured and predicted."""
    figure = Figure(figsize=(9.0, 6.0), layout="constrained")
    top, bottom = figure.subplots(2, 3, sharey="row")
    for ax, index in zip(top, (0, 2, 3), strict=True):
        times, angles = measured("stand", index)
        ax.plot(times, angles[:, 0], "k.", ms=2, label="measured θ")
        ax.plot(times, stands[index][:, 0], label="predicted θ")
        ax.set(title=f"in the stand, run {index}", xlabel="t in s")
    for ax, index in zip(bottom, (0, 1, 2), strict=True):
        times, angles = measured("steering", index)
        for column, (name, colour) in enumerate((("φ", "C1"), ("θ", "C0"))):
            ax.plot(times, angles[:, column], ".", ms=2, color=colour, label=f"measured {name}")
            ax.plot(times, steerings[index][:, column], color=colour, label=name)
        ax.set(title=f"on the floor, run {index}{', identified' if index == 0 else ''}", xlabel="t in s")
    top[0].set_ylabel("rad")
    bottom[0].set_ylabel("rad")
    figure.legend(handles=top[2].lines, loc="outside upper center", ncols=4, frameon=False)
    figure.legend(handles=bottom[2].lines, loc="outside lower center", ncols=4, frameon=False)
    figure.savefig("measured_robot.png", dpi=150)


changes, stands, errors = stand()
assert max(errors) < 0.05
if "--steering" in sys.argv:
    steerings, errors = steering({name: value for name, value in changes.items() if "place" not in name})
    draw(stands, steerings)
