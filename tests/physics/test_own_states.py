"""States of one's own beside a body: linear circuits in closed form, a battery against the balance of energy, and a
clock that keeps the time in every mode.
"""

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.linalg

import jaxball
from jaxball import (
    Ball,
    BallState,
    Bowl,
    Contact,
    Damper,
    Disk,
    DiskState,
    Driven,
    Event,
    FunctionLaw,
    FunctionWrench,
    JointFriction,
    PointMass,
    Resistance,
    Tube,
    planar_pendulum,
    ring_rotor,
    simulate,
)
from jaxball.analysis import stability
from jaxball.files import mjcf
from jaxball.physics import FunctionJointForce, OwnStates, ReducedState, ReleasedState, RotationState, odometer
from jaxball.simulation.ensemble import simulate_ensemble
from jaxball.simulation.solvers import RadauIIA
from jaxball.studies import design
from tests.support.sentences import refuses

M, D, R, G = 1.1, 0.5, 0.9, 2.0
RING, RADIUS = 0.4, 0.5
ROTOR = RING * RADIUS**2  # of the rotor about its axis
SHELL = D + (M + RING) * R**2  # of all else about the contact point: a balanced rotor rolls along without turning
TAU, K, U = 0.3, 0.07, 1.7
TIMES = np.linspace(0.0, 1.5, 7)
FINE = {"rtol": 1e-12, "atol": 1e-12}


def lag(t, state, tau):
    return (U - state.own) / tau


def effort(t, theta, thetadot, state, gain):
    return gain * state.own[0]


def rotor_disk(own_states, drive=None):
    rotor = ring_rotor(
        RING, RADIUS, axis=(0.0, 1.0, 0.0), drive=FunctionJointForce(effort, K) if drive is None else drive
    )
    return Disk(mass=M, inertia=D, radius=R, gravity=G, mechanisms=[rotor], own_states=own_states)


def rotor_state(kind=DiskState, own=(0.0,), **others):
    return kind(theta=[0.0], thetadot=[0.0], own=own, **others)


def lagging_disk(tau=TAU):
    return rotor_disk(OwnStates(lag, tau, names="current"))


def test_a_drive_with_a_filter_of_first_order_turns_a_rotor_as_linear_theory_says():
    run = simulate(lagging_disk(), TIMES, rotor_state(), **FINE)
    np.testing.assert_allclose(run.state.own[:, 0], U * -np.expm1(-TIMES / TAU), rtol=1e-11, atol=1e-12)
    impulse = K * U * (TIMES + TAU * np.expm1(-TIMES / TAU))
    # The torque acts on rotor and shell in opposite directions. The rotor turns at −φ̇ + θ̇ about e2.
    np.testing.assert_allclose(run.state.phidot, impulse / SHELL, rtol=1e-10, atol=1e-12)
    np.testing.assert_allclose(run.state.thetadot[:, 0], impulse * (1 / ROTOR + 1 / SHELL), rtol=1e-10, atol=1e-12)


INDUCTANCE, RESISTANCE, CONSTANT = 0.2, 0.6, 0.15


def circuit(t, state, parameters):
    inductance, resistance, constant = parameters
    return (U - resistance * state.own - constant * state.thetadot) / inductance


@pytest.mark.parametrize("kind", [BallState, RotationState, ReducedState, DiskState])
def test_a_motor_with_inductance_and_back_emf_follows_the_matrix_exponential(kind):
    own = OwnStates(circuit, jnp.array([INDUCTANCE, RESISTANCE, CONSTANT]), names=("current",))
    rotor = ring_rotor(RING, RADIUS, axis=(0.0, 1.0, 0.0), drive=FunctionJointForce(effort, CONSTANT))
    shell = {"mass": M, "radius": R, "gravity": G, "mechanisms": [rotor], "own_states": own}
    body = Disk(inertia=D, **shell) if kind is DiskState else Ball(inertia=(D, D, D), **shell)
    run = simulate(body, TIMES, rotor_state(kind), **FINE)
    # (i, ϑ̇)' = A (i, ϑ̇) + b, from rest.
    A = np.array([[-RESISTANCE / INDUCTANCE, -CONSTANT / INDUCTANCE], [CONSTANT * (1 / ROTOR + 1 / SHELL), 0.0]])
    b = np.array([U / INDUCTANCE, 0.0])
    expected = np.array([np.linalg.solve(A, (scipy.linalg.expm(A * t) - np.eye(2)) @ b) for t in TIMES])
    np.testing.assert_allclose(run.state.own[:, 0], expected[:, 0], rtol=1e-10, atol=1e-11)
    np.testing.assert_allclose(run.state.thetadot[:, 0], expected[:, 1], rtol=1e-10, atol=1e-11)


def swing(t, theta, thetadot, state, strength):
    return strength * jnp.cos(2.0 * t)


def work(t, state, strength):
    return swing(t, None, None, state, strength) * state.thetadot


SWUNG = {
    "mass": M,
    "inertia": (D, D, D),
    "radius": R,
    "gravity": G,
    "mechanisms": [planar_pendulum(0.5, 0.6, drive=FunctionJointForce(swing, 0.8))],
    "own_states": OwnStates(work, 0.8, names=["work"]),
}


def test_the_work_of_a_motor_is_what_the_energy_gains():
    state = rotor_state(BallState, (3.0,), Omega=(0.3, 0.5, -0.2))
    run = simulate(Ball(**SWUNG), TIMES, state, **FINE)
    gained = run.observables.energy - run.observables.energy[0]
    assert np.ptp(gained) > 0.1
    np.testing.assert_allclose(run.state.own[:, 0] - 3.0, gained, rtol=0, atol=1e-11)


@pytest.mark.thorough
def test_the_work_of_a_motor_is_what_the_energy_gains_and_friction_takes_while_the_ball_slips():
    start = ReleasedState(rotor_state(BallState, Omega=(0.3, -2.0, -0.2)), V=(1.0, 0.2, 0.0), height=0.05)
    run = simulate(Ball(**SWUNG), TIMES, start, contact=Contact(friction=0.1, restitution=0.3), **FINE)
    assert run.ok
    assert len(set(np.asarray(run.contact.mode))) == 2
    taken = run.contact.friction_loss + run.contact.impact_loss
    gained = run.observables.energy - run.observables.energy[0] + taken
    assert float(taken[-1]) > 0.1
    np.testing.assert_allclose(run.state.own[:, 0], gained, rtol=0, atol=1e-9)


WANTED, KP, KI, DAMPING = 2.0, 0.05, 0.1, 0.03


def error(t, state):
    return WANTED - state.thetadot


def controller(t, theta, thetadot, state):
    return KP * (WANTED - thetadot) + KI * state.own[0]


def test_the_integral_of_a_controller_settles_at_the_effort_that_holds_the_speed():
    disk = rotor_disk(OwnStates(error, names="integral"), FunctionJointForce(controller) + Damper(DAMPING))
    run = simulate(disk, [0.0, 60.0], rotor_state())
    np.testing.assert_allclose(run.state.thetadot[-1, 0], WANTED, rtol=1e-8)
    np.testing.assert_allclose(run.state.own[-1, 0], DAMPING * WANTED / KI, rtol=1e-8)


def last_speed(tau, **settings):
    return simulate(lagging_disk(tau), [0.0, 1.5], rotor_state(), **settings).state.thetadot[-1, 0]


@pytest.mark.parametrize(
    "derivative", [jax.grad, jax.jacfwd, pytest.param(lambda f: jax.grad(jax.grad(f)), marks=pytest.mark.thorough)]
)
def test_derivatives_by_a_parameter_of_the_filter_are_those_of_the_closed_form(derivative):
    def closed_form(tau):
        return K * U * (1.5 + tau * jnp.expm1(-1.5 / tau)) * (1 / ROTOR + 1 / SHELL)

    np.testing.assert_allclose(derivative(last_speed)(TAU), derivative(closed_form)(TAU), rtol=1e-8)


def leak(t, state):
    return -state.own / TAU


@pytest.mark.parametrize("adjoint", [diffrax.ForwardMode(), diffrax.RecursiveCheckpointAdjoint()])
def test_derivatives_at_rest_are_those_of_the_linear_circuit(adjoint):
    disk, T = rotor_disk(OwnStates(leak, names="current")), 4.0

    def end(start):
        run = simulate(disk, [0.0, T], rotor_state(own=start), adjoint=adjoint)
        return jnp.stack([run.state.own[-1, 0], run.state.thetadot[-1, 0]])

    derive = jax.jacfwd if isinstance(adjoint, diffrax.ForwardMode) else jax.jacrev
    decayed = np.exp(-T / TAU)
    expected = [decayed, K * TAU * (1 - decayed) * (1 / ROTOR + 1 / SHELL)]
    np.testing.assert_allclose(derive(end)(jnp.zeros(1))[:, 0], expected, rtol=1e-6, atol=1e-8)


@pytest.mark.parametrize("of", ["own[0]", lambda system, t, state: state.own[0]])
def test_an_event_finds_when_the_filter_is_half_charged(of):
    run = simulate(lagging_disk(), [0.0, 1.5], rotor_state(), events={"half": Event(of, level=U / 2)}, **FINE)
    np.testing.assert_allclose(run.events["half"].times[0], TAU * np.log(2.0), rtol=1e-10)


def test_each_run_of_an_ensemble_has_own_states_and_parameters_of_its_own():
    taus, starts = jnp.array([0.1, 0.3, 1.0]), jnp.array([[0.0], [0.5], [2.0]])
    disks = jax.vmap(lagging_disk)(taus)
    states = jax.vmap(lambda own: rotor_state(own=own))(starts)
    runs = simulate_ensemble(disks, TIMES, states, **FINE).trajectory
    expected = U + (starts - U) * np.exp(-TIMES[None] / taus[:, None])
    np.testing.assert_allclose(runs.state.own[..., 0], expected, rtol=1e-11)


def clock(t, state):
    return jnp.stack([jnp.ones_like(t), 2.0 * t])


CLOCK = OwnStates(clock, names=("time", "square"))
STICKY = {"mechanisms": [planar_pendulum(0.5, 0.6, drive=JointFriction(0.05, static=0.06))]}
SHELL_OF_BALL = {"mass": M, "inertia": (D, D, D), "radius": R, "gravity": G, "own_states": CLOCK}
BOUNCE = Contact(friction=0.2, restitution=0.5)
EXACT = {"resistance": Resistance(dry=0.2, exact=True)}
IN_BOWL = {"ground": Bowl(3.0)}, BallState(z=(0.5, 0.1), own=(0.0, 0.0))


def thrown(**others):
    return ReleasedState(BallState(Omega=(0.0, -1.0, 0.1), own=(0.0, 0.0), **others), V=(1.0, 0.0, 0.0), height=0.2)


@pytest.mark.parametrize(
    ("more", "state", "settings"),
    [
        ({}, thrown(), {"contact": BOUNCE}),
        ({}, BallState(Omega=(0.2, 0.5, 0.1), own=(0.0, 0.0)), {"dae": True, "solver": RadauIIA(3)}),
        ({}, BallState(Omega=(0.2, 0.5, 0.1), own=(0.0, 0.0)), {"project": True}),
        *(
            pytest.param(*case, marks=pytest.mark.thorough)
            for case in (
                (STICKY, thrown(theta=[0.5], thetadot=[0.1]), {"contact": BOUNCE}),
                (EXACT, thrown(), {"contact": BOUNCE}),
                (EXACT, BallState(Omega=(0.2, 0.5, 0.1), own=(0.0, 0.0)), {}),
                (STICKY, BallState(theta=[0.5], thetadot=[0.1], own=(0.0, 0.0)), {}),
                (*IN_BOWL, {}),
                (*IN_BOWL, {"contact": Contact(friction=0.05)}),
            )
        ),
    ],
    ids=[
        "bounces",
        "dae",
        "q",
        "bounces and sticks",
        "bounces and rests",
        "rests",
        "sticks",
        "bowl",
        "slides in a bowl",
    ],
)
def test_a_clock_keeps_the_time_in_every_mode(more, state, settings):
    run = simulate(Ball(**SHELL_OF_BALL, **more), TIMES, state, **settings)
    assert run.ok, run.message
    np.testing.assert_allclose(run.state.own, np.stack([TIMES, TIMES**2], axis=1), rtol=0, atol=1e-9)


def following(t, state):
    return state.own - state.theta


def test_a_law_reads_the_states_of_ones_own():
    # θ̈ = x − θ with ẋ = 0: an oscillator about the x that it starts with.
    mass = PointMass(0.3, Driven(Tube(direction=(1.0, 0.0, 0.0))))
    still = OwnStates(lambda t, state: jnp.zeros(1), names="target")
    ball = Ball(mass=M, inertia=(D, D, D), radius=R, masses=[mass], law=FunctionLaw(following), own_states=still)
    run = simulate(ball, TIMES, BallState(theta=[0.0], thetadot=[0.0], own=[0.25]), **FINE)
    np.testing.assert_allclose(run.state.theta[:, 0], 0.25 * (1 - np.cos(TIMES)), rtol=0, atol=1e-11)


def propeller(t, motion):
    return motion.own[0] * jnp.array([1.0, 0.0, 0.0])


def test_a_force_on_the_body_reads_the_states_of_ones_own():
    ball = Ball(
        **{**SHELL_OF_BALL, "force": FunctionWrench(propeller), "own_states": OwnStates(lag, TAU, names="push")}
    )
    run = simulate(ball, TIMES, BallState(own=[0.0]), **FINE)
    impulse = U * (TIMES + TAU * np.expm1(-TIMES / TAU))
    np.testing.assert_allclose(run.state.Omega[:, 1], R * impulse / (D + M * R**2), rtol=1e-10, atol=1e-12)


def test_a_jump_of_a_rate_ends_a_step():
    switched = OwnStates(lambda t, state: jnp.where(t < 0.7, 1.0, -3.0)[None], names="charge")
    run = simulate(Ball(**{**SHELL_OF_BALL, "own_states": switched}), TIMES)
    expected = np.minimum(TIMES, 0.7) - 3.0 * np.maximum(TIMES - 0.7, 0.0)
    np.testing.assert_allclose(run.state.own[:, 0], expected, rtol=0, atol=1e-13)
    assert run.steps < 20


def test_a_late_pulse_of_a_rate_is_seen():
    pulse = OwnStates(lambda t, state: jnp.exp(-(((t - 47.0) / 0.3) ** 2))[None], names="charge")
    run = simulate(Ball(**{**SHELL_OF_BALL, "own_states": pulse}), [0.0, 100.0])
    np.testing.assert_allclose(run.state.own[-1, 0], 0.3 * np.sqrt(np.pi), rtol=1e-8)


def test_without_states_of_ones_own_a_state_has_no_more_arrays_than_before():
    for kind, count in ((BallState, 5), (RotationState, 5), (ReducedState, 4), (DiskState, 5)):
        assert kind().own is None
        assert len(jax.tree.leaves(kind())) == count
        assert "own" not in repr(kind())


def test_a_state_that_does_not_fit_is_refused():
    ball, plain = Ball(**SHELL_OF_BALL), Ball(mass=M, inertia=(D, D, D))
    assert ball.default_state().own.shape == (2,)
    with refuses(ValueError, "state.own"):
        simulate(ball, TIMES, BallState())
    with refuses(ValueError, "state.own"):
        simulate(ball, TIMES, BallState(own=[1.0]))
    with refuses(ValueError, "state.own"):
        simulate(plain, TIMES, BallState(own=[1.0]))
    with refuses(ValueError, "own"):
        simulate(ball, TIMES, BallState(own=np.zeros((3, 2))))


def test_the_stability_of_a_steady_motion_counts_own_states():
    ball = Ball(mass=M, inertia=(D, D, D), radius=R, gravity=G, own_states=OwnStates(leak, names="charge"))
    eigenvalues = stability.steady_motion(ball, ReducedState(own=[0.0])).eigenvalues
    assert np.min(np.abs(eigenvalues + 1 / TAU)) < 1e-12


def test_what_cannot_have_own_states_says_so():
    disk, ball = lagging_disk(), Ball(**SHELL_OF_BALL)
    with refuses(ValueError, "ball"):
        stability.permanent_rotations(ball, 1.0)
    with refuses(mjcf.MJCFError, "own_states"):
        mjcf.to_mjcf(disk)
    with refuses(design.DesignError, "system"):
        design.optimal_control.Rolling(disk, (0.0, 1.0), {}, rotor_state())


def test_what_is_wrong_with_own_states_is_said():
    for names in ((), ("a", "a"), ("",)):
        with refuses(ValueError, "names"):
            OwnStates(clock, names=names)
    with refuses(TypeError, "names"):
        OwnStates(clock, names=2)
    with refuses(TypeError, "function"):
        OwnStates(lambda t: t, names="x")
    with refuses(TypeError, "own_states"):
        Ball(mass=M, inertia=(D, D, D), own_states=clock)
    with refuses(TypeError, "function"):
        simulate(Ball(**{**SHELL_OF_BALL, "own_states": OwnStates(lambda t, state: t, names="x")}), TIMES)


COUNTED = OwnStates(odometer, names=("turned", "rolled"))


def test_an_odometer_counts_what_a_disk_turns_and_rolls_to_and_fro():
    # A disk that rocks about rest with its centre of mass below the geometric centre turns back where φ̇ = 0.
    disk = Disk(mass=M, inertia=D, radius=R, gravity=G, offset=(0.0, 0.0, -0.3), own_states=COUNTED)
    back = {"back": Event("phidot")}
    run = simulate(disk, np.linspace(0.0, 15.0, 5), DiskState(phidot=1.0, own=(0.0, 0.0)), events=back, **FINE)
    np.testing.assert_allclose(run.state.own[:, 0], -run.state.phi, rtol=0, atol=1e-10)
    count = int(run.events["back"].count)
    ends = np.concatenate([[0.0], run.events["back"].state.phi[:count], run.state.phi[-1:]])
    assert count > 2
    np.testing.assert_allclose(run.state.own[-1, 1], np.abs(np.diff(ends)).sum(), rtol=1e-9)


def test_an_odometer_leaves_out_the_spin_of_a_ball_about_the_vertical():
    # Of a homogeneous ball Ω and ω are constant, and Γ turns about Ω.
    Omega = jnp.array([0.3, -0.4, 1.2])
    ball = Ball(**{**SHELL_OF_BALL, "own_states": COUNTED})
    run = simulate(ball, TIMES, BallState(Omega=Omega, own=(0.0, 0.0)), **FINE)
    np.testing.assert_allclose(run.state.own, np.stack([-0.4 * TIMES, 0.5 * TIMES], axis=1), rtol=0, atol=1e-11)
    np.testing.assert_allclose(np.linalg.norm(run.state.z, axis=1), R * run.state.own[:, 1], rtol=0, atol=1e-11)


def test_an_odometer_at_rest_has_derivatives_that_are_finite():
    def turned(Omega):
        ball = Ball(**{**SHELL_OF_BALL, "own_states": COUNTED})
        return simulate(ball, [0.0, 2.0], BallState(Omega=Omega, own=(0.0, 0.0))).state.own[-1]

    # |Ω| has no derivative at 0: of those between −1 and 1, 0 is taken.
    np.testing.assert_allclose(jax.jacrev(turned)(jnp.zeros(3)), [[0.0, 2.0, 0.0], [0.0, 0.0, 0.0]], atol=1e-9)


def test_a_saved_run_has_its_own_states_by_name(tmp_path):
    ball = Ball(**SHELL_OF_BALL)
    run = simulate(ball, TIMES, thrown(), contact=BOUNCE)
    assert run.to_dataset().own.sel(own_state="square").values == pytest.approx(TIMES**2)
    for suffix in ("nc", "npz"):
        again = jaxball.load_run(run.save(tmp_path / f"run.{suffix}"), ball)
        for saved, loaded in ((run.state, again.state), (run.contact.switches.before, again.contact.switches.before)):
            for leaf, other in zip(jax.tree.leaves(saved), jax.tree.leaves(loaded), strict=True):
                np.testing.assert_array_equal(leaf, other)
    header = (run.save(tmp_path / "run.csv")).read_text().splitlines()[0].split(",")
    assert {"own[0]", "own[1]"} <= set(header)


@pytest.mark.thorough
def test_figures_show_own_states_by_their_names():

    run = simulate(Ball(**SHELL_OF_BALL), TIMES, BallState(own=(0.0, 0.0)))
    lines = run.plot("own_states").lines
    assert [line.get_label() for line in lines[:2]] == ["time", "square"]
    np.testing.assert_allclose(lines[1].get_ydata(), TIMES**2, atol=1e-9)
    assert "own states" in [ax.get_ylabel() for ax in run.plot().axes]
    assert simulate(lagging_disk(), TIMES, rotor_state()).plot("own_states").get_ylabel() == "current"
    with refuses(ValueError, "own_states"):
        simulate(Ball(mass=M, inertia=(D, D, D)), TIMES).plot("own_states")
