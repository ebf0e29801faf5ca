"""The plane under an ellipsoid that rolls: against Newton's and Euler's laws for its motion, and what reports it."""

import dataclasses
import json

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxball
from jaxball import Detachment, Slip, Status, contact_extremes, load_scenario
from jaxball.analysis.verify import check_laws
from jaxball.cli import main
from jaxball.cli.options import FAILED_SOLVE
from jaxball.physics.classical import EllipsoidState, HeavyTop, RigidBodyState, RollingEllipsoid
from jaxball.simulation.ensemble import REDUCTIONS, simulate_ensemble
from tests.support.differences import slope
from tests.support.sentences import refuses, said

NOW = jnp.array(0.0)
STONE = load_scenario("rattleback").system
TILTED = "initial.angle=0.17453292519943295"  # ten degrees, with which the stone is thrown up
FAST = "initial.Omega=[0.0, 0.0, -12.0]"
PRECISE = {"rtol": 1e-11, "atol": 1e-11}
FINE = np.linspace(0.0, 1.0, 8001)


def thrown(spin=-12.0):
    """Spun against its sense, tilted about its long axis by ten degrees."""
    tilt = np.deg2rad(10.0)
    return EllipsoidState((np.cos(tilt / 2), np.sin(tilt / 2), 0.0, 0.0), (0.0, 0.0, spin))


@pytest.fixture(scope="module")
def run():
    return jaxball.simulate(STONE, FINE, thrown(), dense=True, throw=True, **PRECISE)


def centre_of_mass(body, state):
    """In space, over the plane, by the support function of the ellipsoid, √(Γ·A²Γ)."""
    height = jnp.sqrt(jnp.sum((body.semiaxes * state.Gamma) ** 2))
    return jnp.concatenate([state.z, height[None]]) + state.Lambda @ body.offset


def along(function, body, state):
    """The rate of a function of the state along the motion."""
    return jax.jvp(function, (state,), (body.field(NOW, state),))[1]


def test_newtons_and_eulers_laws_along_the_motion():
    """m ẍ = R − m g e3, and the rate of the angular momentum about the centre of mass is the moment of R there."""
    shape = {"semiaxes": (0.9, 0.7, 0.5), "inertia": (0.5, 0.6, 0.7), "turn": 0.4, "offset": (0.1, -0.2, 0.15)}
    body = RollingEllipsoid(mass=1.3, gravity=9.8, **shape)
    rng = np.random.default_rng(5)

    @jax.jit
    def laws(q, Omega):
        state = EllipsoidState(q, Omega)

        def velocity(state):
            return along(lambda s: centre_of_mass(body, s), body, state)

        force = body.mass * along(velocity, body, state) + body.mass * body.gravity * jnp.array([0.0, 0.0, 1.0])
        moment = along(lambda s: s.Lambda @ body.J @ s.Omega, body, state)
        squared = (body.semiaxes * state.Gamma) ** 2
        lowest = -state.Lambda @ (body.semiaxes**2 * state.Gamma) / jnp.sqrt(jnp.sum(squared))
        arm = lowest - state.Lambda @ body.offset
        return force, moment, jnp.cross(arm, force), body.plane_reaction(NOW, state)

    for _ in range(5):
        q = rng.normal(size=4)
        force, moment, of_force, reaction = laws(q / np.linalg.norm(q), 3 * rng.normal(size=3))
        np.testing.assert_allclose(reaction.normal, force[2], rtol=1e-11)
        np.testing.assert_allclose(reaction.friction_squared, force[0] ** 2 + force[1] ** 2, rtol=1e-11)
        np.testing.assert_allclose(moment, of_force, rtol=0, atol=1e-11 * np.linalg.norm(force))


@pytest.mark.long
def test_the_reaction_along_a_run_is_that_of_its_centre_of_mass(run):
    """By central differences, of fourth order, of its velocity, which follows from q̇ and ż.

    Forces are up to 87. Differences over half and over twice the distance err by a sixteenth and by 16 times as much.
    """
    v = np.asarray(jax.vmap(lambda s: along(lambda at: centre_of_mass(STONE, at), STONE, s))(run.state))
    h = FINE[1] - FINE[0]
    a = (-v[4:] + 8 * v[3:-1] - 8 * v[1:-3] + v[:-4]) / (12 * h)
    N, f = a[:, 2] + 9.81, np.hypot(a[:, 0], a[:, 1])
    reaction = run.plane_reaction
    np.testing.assert_allclose(reaction.normal[2:-2], N, rtol=0, atol=1e-3)
    np.testing.assert_allclose(reaction.friction[2:-2], f, rtol=0, atol=1e-3)
    assert N.min() < 0 < N[0]


@pytest.mark.long
def test_extremes_lie_at_or_beyond_those_of_a_fine_sampling(run):
    """N has its least value within one step of the sampling, where it differs by less than its curvature allows."""
    N = np.asarray(run.plane_reaction.normal)
    extremes = contact_extremes(run)
    assert not extremes.holds
    assert np.isinf(extremes.friction_needed)
    np.testing.assert_allclose(extremes.weight, 9.81)
    assert extremes.least_normal_force <= N.min()
    np.testing.assert_allclose(extremes.least_normal_force, N.min(), rtol=0, atol=5e-3)
    np.testing.assert_allclose(extremes.least_normal_force_time, FINE[N.argmin()], atol=FINE[1])
    assert "the body would leave the plane, so no friction is enough" in str(extremes)


@pytest.mark.long
def test_it_detaches_and_slips_where_the_run_without_events_would(run):
    N, ratio = np.asarray(run.plane_reaction.normal), np.asarray(run.plane_reaction.ratio)
    lifted = jaxball.simulate(STONE, FINE, thrown(), events={"lift": Detachment()}, **PRECISE)
    k = int(np.argmax(N <= 0))
    assert lifted.status == Status.DETACHED
    assert FINE[k - 1] - 1e-6 <= lifted.reached <= FINE[k] + 1e-6
    slipped = jaxball.simulate(STONE, FINE, thrown(), events={"slip": Slip(2.0)}, **PRECISE)
    k = int(np.argmax(ratio >= 2.0))
    assert slipped.status == Status.SLIPPED
    assert FINE[k - 1] - 1e-6 <= slipped.reached <= FINE[k] + 1e-6


@pytest.mark.long
def test_reductions_of_ensembles_are_the_extremes_of_single_runs(run):
    spins = np.array([-12.0, -5.0])
    starts = jax.vmap(lambda spin: thrown(spin=spin))(jnp.asarray(spins))
    finds = {name: REDUCTIONS[name] for name in ("least_normal_force", "friction_needed")}
    found = simulate_ensemble(STONE, FINE[[0, -1]], starts, reductions=finds, in_axes=(None, 0)).reductions
    for k, spin in enumerate(spins):
        single = jaxball.simulate(STONE, FINE[[0, -1]], thrown(spin=spin), dense=True)
        extremes = contact_extremes(single)
        np.testing.assert_allclose(found["least_normal_force"][k], extremes.least_normal_force, rtol=0, atol=1e-5)
        np.testing.assert_allclose(found["friction_needed"][k], extremes.friction_needed, rtol=1e-5)


@pytest.mark.long
def test_the_derivative_of_the_least_normal_force():
    """With respect to the mass, of N / m, which does not depend on it where the inertia is in proportion; and of g."""

    def least(mass, gravity):
        body = RollingEllipsoid(
            mass=mass,
            semiaxes=STONE.semiaxes,
            inertia=mass * STONE.inertia,
            turn=STONE.turn,
            offset=STONE.offset,
            gravity=gravity,
        )
        run = jaxball.simulate(body, FINE[[0, -1]], thrown(), dense=True, **PRECISE)
        return contact_extremes(run).least_normal_force

    at = jnp.array(1.0), jnp.array(9.81)
    value, slopes = jaxball.jit(jax.value_and_grad(least, argnums=(0, 1)))(*at)
    np.testing.assert_allclose(slopes[0], value, rtol=1e-4, atol=1e-5)
    single = jaxball.jit(least)
    expected = slope(lambda gravity: single(at[0], gravity), at[1], 1e-4, points=2)
    np.testing.assert_allclose(slopes[1], expected, rtol=1e-3)


@pytest.mark.thorough
def test_a_saved_run_has_the_forces(run, tmp_path):
    data = run.to_dataset()
    np.testing.assert_array_equal(data["normal_force"], run.plane_reaction.normal)
    np.testing.assert_array_equal(data["friction_ratio"], run.plane_reaction.ratio)
    assert data.attrs["least_normal_force"] == float(contact_extremes(run).least_normal_force)
    assert np.isinf(run.friction_needed)
    again = jaxball.load_run(run.save(tmp_path / "run.nc"))
    np.testing.assert_array_equal(again.plane_reaction.normal, run.plane_reaction.normal)


@pytest.mark.long
def test_the_command_line_tells_of_the_plane_under_a_rattleback(capsys, tmp_path):
    summary = tmp_path / "run.json"
    stone = ["simulate", "rattleback", "--set", TILTED, "--set", FAST, "--end", "1"]
    assert main([*stone, "--json", str(summary)]) == 0
    printed = capsys.readouterr().out
    assert "the body would leave the plane, so no friction is enough" in printed
    assert "change of conserved quantities: energy" in printed
    assert json.loads(summary.read_text())["least_normal_force"] < 0
    assert main([*stone, "--detachment"]) == FAILED_SOLVE
    said(capsys.readouterr().err, "The run")


@pytest.mark.long
def test_verify_has_a_row_of_the_contact():
    scenario = dataclasses.replace(load_scenario("rattleback"), state=thrown(), times=FINE[[0, -1]])
    row = check_laws(scenario, laws=["contact"])["contact"]
    assert row.applies
    assert not row.ok
    assert row.residual < 0
    held = dataclasses.replace(scenario, state=EllipsoidState())
    np.testing.assert_allclose(check_laws(held, laws=["contact"])["contact"].residual, 1.0, rtol=1e-12)


def test_what_does_not_roll_has_no_reaction():
    top = jaxball.simulate(HeavyTop(inertia=(1.0, 1.0, 0.5), chi=(0.0, 0.0, 1.0)), [0.0, 0.1], RigidBodyState())
    with refuses(ValueError, "HeavyTop"):
        _ = top.plane_reaction
    with refuses(TypeError, "trajectory"):
        contact_extremes(top)
