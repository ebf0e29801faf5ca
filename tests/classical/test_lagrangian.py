"""Systems from a Lagrangian and constraints, compared with equations written by hand and with minimal coordinates."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxball
from jaxball.analysis.verify import check_laws
from jaxball.physics import classical
from jaxball.physics.classical import LagrangianState, LagrangianSystem
from jaxball.simulation.ensemble import simulate_ensemble
from jaxball.simulation.solvers import RadauIIA
from tests.support.sentences import refuses, said

TIGHT = {"rtol": 1e-12, "atol": 1e-12, "throw": True}
TOP = classical.HeavyTop(mass=0.5, inertia=(1.3, 1.1, 0.8), chi=(0.1, -0.2, 0.7), gravity=3.0)
RODS = {"m": 1.5, "l": 1.0, "k": 0.7}  # the second mass, and the lengths of both rods
ANGLES = (1.2, -0.4)
G = 9.81


def free(t, q, qdot):
    return 0.5 * jnp.sum(qdot**2)


def with_y(t, q, qdot):
    """ż − y ẋ, of the nonholonomic particle."""
    return qdot[2] - q[1] * qdot[0]


PARTICLE = LagrangianSystem(free, ("x", "y", "z"), constraints=with_y)


def of_top(q, qdot):
    """(Ω, Γ) of the angles of precession, nutation and spin, about z, x and z."""
    (s, c), (s3, c3) = ((jnp.sin(angle), jnp.cos(angle)) for angle in q[1:])
    precession, nutation, spin = qdot
    Gamma = jnp.stack([s * s3, s * c3, c])
    return precession * Gamma + nutation * jnp.stack([c3, -s3, 0.0 * s]) + jnp.stack([0.0 * s, 0.0 * s, spin]), Gamma


def of_heavy_top(t, q, qdot):
    Omega, Gamma = of_top(q, qdot)
    return 0.5 * jnp.sum(TOP.inertia * Omega**2) - TOP.mass * TOP.gravity * jnp.sum(TOP.chi * Gamma)


EULER = LagrangianSystem(of_heavy_top, ("precession", "nutation", "spin"))
TURNING = LagrangianState([0.3, 0.9, -0.4], [0.5, 0.8, 2.0])


def closed(t, q):
    """What closes a four-bar with rods of 1, 2 and 1 on a ground of 2, which is flat where all angles are 0."""
    lengths = jnp.array([1.0, 2.0, -1.0])
    return [jnp.sum(lengths * jnp.cos(q)) - 2.0, jnp.sum(lengths * jnp.sin(q))]


FOUR_BAR = LagrangianSystem(free, ("a", "b", "c"), holonomic=closed)


def versor_of(q):
    """The versor of Rz(q₀) Rx(q₁) Rz(q₂)."""
    half, total, difference = q[1] / 2, (q[0] + q[2]) / 2, (q[0] - q[2]) / 2
    across = jnp.sin(half) * jnp.stack([jnp.cos(difference), jnp.sin(difference)])
    along = jnp.cos(half) * jnp.stack([jnp.cos(total), jnp.sin(total)])
    return jnp.stack([along[0], across[0], across[1], along[1]])


def test_the_rates_of_a_top_in_angles_are_those_of_its_equation_in_body_axes():
    def Omega_rate(q, qdot):
        rates = EULER.field(jnp.array(0.0), LagrangianState(q, qdot))
        return jax.jvp(of_top, (q, qdot), (rates.q, rates.qdot))

    (Omega, Gamma), (rate, _) = jax.jit(Omega_rate)(TURNING.q, TURNING.qdot)
    state = classical.RigidBodyState(versor_of(TURNING.q), Omega)
    np.testing.assert_allclose(state.Gamma, Gamma, rtol=0, atol=1e-15)
    np.testing.assert_allclose(rate, TOP.field(jnp.array(0.0), state).Omega, rtol=0, atol=1e-14)


@pytest.mark.long
def test_the_motion_of_a_top_in_angles_is_that_in_body_axes():
    times = np.linspace(0.0, 3.0, 31)
    angles = jaxball.simulate(EULER, times, TURNING, **TIGHT)
    Omega, Gamma = of_top(TURNING.q, TURNING.qdot)
    body = jaxball.simulate(TOP, times, classical.RigidBodyState(versor_of(TURNING.q), Omega), **TIGHT)
    Omega, Gamma = jax.vmap(of_top)(angles.state.q, angles.state.qdot)
    np.testing.assert_allclose(Omega, body.state.Omega, rtol=0, atol=1e-10)
    np.testing.assert_allclose(Gamma, jax.vmap(lambda state: state.Gamma)(body.state), rtol=0, atol=1e-10)
    np.testing.assert_allclose(angles.laws.energy, body.laws.energy, rtol=0, atol=1e-10)


def test_the_particle_and_its_multiplier_are_those_written_by_hand():
    state = classical.ParticleState(0.3, -0.7, 0.2, 1.1, 0.4)
    here = LagrangianState([0.3, -0.7, 0.2], jnp.stack([state.xdot, state.ydot, state.zdot]))
    rates, by_hand = jax.jit(PARTICLE.field)(jnp.array(0.0), here), classical.NonholonomicParticle()
    expected = by_hand.field(jnp.array(0.0), state)
    np.testing.assert_allclose(rates.qdot[:2], [expected.xdot, expected.ydot], rtol=0, atol=2e-16)
    lam = by_hand.multiplier(jnp.array(0.0), state)
    reactions = jax.jit(PARTICLE.reactions)(jnp.array(0.0), here)
    np.testing.assert_allclose(reactions, [0.7 * lam, 0.0, lam], rtol=0, atol=2e-16)


@pytest.mark.thorough
def test_a_coordinate_without_mass_may_be_fixed_by_a_constraint():
    """On the paraboloid z = (x² + y²)/2 without inertia along z, ẍ = −g x; the surface pushes up with λ = g."""

    def lagrangian(t, q, qdot):
        return 0.5 * (qdot[0] ** 2 + qdot[1] ** 2) - G * q[2]

    bowl = LagrangianSystem(lagrangian, ("x", "y", "z"), holonomic=lambda t, q: q[2] - 0.5 * (q[0] ** 2 + q[1] ** 2))
    state = LagrangianState([0.3, -0.4, 0.125], [0.4, 0.3, 0.0])
    assert jaxball.problems(bowl, state) == []
    acceleration, multipliers = jax.jit(lambda state: bowl.equations(jnp.array(0.0), state).solve())(state)
    np.testing.assert_allclose(acceleration[:2], [-0.3 * G, 0.4 * G], rtol=1e-15)
    np.testing.assert_allclose(multipliers, [G], rtol=1e-15)


def test_the_rate_of_the_energy_is_that_along_the_motion():
    """Of a system whose Lagrangian, constraint and force depend on time."""

    def lagrangian(t, q, qdot):
        return 0.5 * (1 + 0.3 * jnp.sin(t)) * jnp.sum(qdot**2) - q[0] * q[1] * jnp.cos(t)

    driven = LagrangianSystem(
        lagrangian,
        ("x", "y", "z"),
        constraints=lambda t, q, qdot: with_y(t, q, qdot) - jnp.sin(2 * t) * q[0],
        forces=lambda t, q, qdot: -0.2 * qdot,
    )
    t, q, qdot = jnp.array(0.4), jnp.array([0.3, -0.7, 0.2]), jnp.array([1.1, 0.4, 0.0])
    state = driven.consistent(t, LagrangianState(q, qdot))

    @jax.jit
    def rates_of_laws(state):
        rates = driven.field(t, state)
        along = jnp.ones_like(t), rates
        return jax.jvp(driven.laws, (t, state), along)[1], driven.law_rates(t, state)

    rate, expected = rates_of_laws(state)
    np.testing.assert_allclose(rate.energy, expected["energy"], rtol=0, atol=1e-14)
    np.testing.assert_allclose(rate.velocity_constraints, 0.0, rtol=0, atol=1e-15)
    assert abs(float(rate.energy)) > 0.05


def rods(t, q, p):
    x1, y1, x2, y2 = q
    return [0.5 * (x1**2 + y1**2 - p["l"] ** 2), 0.5 * ((x2 - x1) ** 2 + (y2 - y1) ** 2 - p["k"] ** 2)]


def of_masses(t, q, qdot, p):
    kinetic = 0.5 * jnp.sum(qdot[:2] ** 2) + 0.5 * p["m"] * jnp.sum(qdot[2:] ** 2)
    return kinetic - G * (q[1] + p["m"] * q[3])


def places(angles, p):
    s, c = jnp.sin(angles), -jnp.cos(angles)
    first = p["l"] * jnp.stack([s[0], c[0]])
    return jnp.concatenate([first, first + p["k"] * jnp.stack([s[1], c[1]])])


def of_angles(t, q, qdot, p):
    return of_masses(t, *jax.jvp(lambda q: places(q, p), (q,), (qdot,)), p)


def pendulum(p, **settings):
    return LagrangianSystem(of_masses, ("x1", "y1", "x2", "y2"), holonomic=rods, parameters=p, **settings)


def minimal(p):
    return LagrangianSystem(of_angles, ("first", "second"), parameters=p)


HANGING = LagrangianState(places(jnp.array(ANGLES), RODS))


@pytest.fixture(scope="module")
def swung():
    """The places of both masses, by minimal coordinates."""
    run = jaxball.simulate(minimal(RODS), np.linspace(0.0, 3.0, 31), LagrangianState(ANGLES), **TIGHT)
    return jax.vmap(lambda q: places(q, RODS))(run.state.q)


@pytest.mark.long
@pytest.mark.parametrize("solver", [None, RadauIIA(stages=5)], ids=["Dopri8", "RadauIIA"])
def test_a_double_pendulum_of_rods_moves_as_in_minimal_coordinates(solver, swung):
    run = jaxball.simulate(pendulum(RODS), np.linspace(0.0, 3.0, 31), HANGING, solver=solver, dense=True, **TIGHT)
    np.testing.assert_allclose(run.state.q, swung, rtol=0, atol=1e-10)
    np.testing.assert_allclose(run.laws.energy, run.laws.energy[0], rtol=0, atol=1e-9)
    # Rounding alone: each state is projected.
    np.testing.assert_allclose(run.laws.position_constraints, 0.0, rtol=0, atol=1e-15)
    np.testing.assert_allclose(run.laws.velocity_constraints, 0.0, rtol=0, atol=2e-14)
    np.testing.assert_allclose(jax.vmap(lambda q: rods(0.0, q, RODS)[0])(run.at([0.123]).q), 0.0, rtol=0, atol=1e-15)
    # The tension of the upper rod at rest: λ l, as drawn from both masses.
    assert run.multipliers.shape == (31, 2)


@pytest.mark.long
def test_without_projection_the_rods_grow(swung):
    run = jaxball.simulate(pendulum(RODS, always_projected=False), np.linspace(0.0, 3.0, 31), HANGING, throw=True)
    drift = np.max(np.abs(run.laws.position_constraints))
    assert 1e-13 < drift < 1e-8
    np.testing.assert_allclose(run.state.q, swung, rtol=0, atol=1e-8)


@pytest.fixture(scope="module")
def slope():
    """The derivative of a place by the length of a rod, in minimal coordinates, where nothing is projected."""

    def of_angle(length):
        p = RODS | {"l": length}
        run = jaxball.simulate(minimal(p), (0.0, 2.0), LagrangianState(ANGLES), rtol=1e-11, atol=1e-11)
        return places(run.state.q[-1], p)[2]

    return jax.jacfwd(of_angle)(jnp.array(1.0))


@pytest.mark.long
@pytest.mark.parametrize("differentiate", [jax.grad, jax.jacfwd])
def test_derivatives_by_the_length_of_a_rod(differentiate, slope):
    """Through the projection, in both modes."""

    def of_rods(length):
        p = RODS | {"l": length}
        start = LagrangianState(places(jnp.array(ANGLES), p))
        return jaxball.simulate(pendulum(p), (0.0, 2.0), start, rtol=1e-11, atol=1e-11).state.q[-1, 2]

    np.testing.assert_allclose(differentiate(of_rods)(jnp.array(1.0)), slope, rtol=0, atol=1e-9)


@pytest.mark.long
def test_many_at_once(swung):
    p = {"m": jnp.array([1.0, 1.5, 2.0]), "l": jnp.ones(3), "k": jnp.full(3, 0.7)}
    starts = LagrangianState(jnp.tile(HANGING.q, (3, 1)))
    many = simulate_ensemble(pendulum(p), np.linspace(0.0, 3.0, 31), starts, rtol=1e-12, atol=1e-12).trajectory
    np.testing.assert_allclose(many.state.q[1], swung, rtol=0, atol=1e-10)
    np.testing.assert_allclose(many.laws.position_constraints, 0.0, rtol=0, atol=1e-14)


@pytest.mark.long
def test_a_rod_on_a_pivot_that_moves():
    """φ(t, q) = 0 depends on time: compared with the angle of the rod as the only coordinate."""

    def pivot(t):
        return 0.4 * jnp.sin(1.7 * t)

    def of_mass(t, q, qdot):
        return free(t, q, qdot) - G * q[1]

    def of_angle(t, q, qdot):
        def place(t, q):
            return jnp.stack([pivot(t) + jnp.sin(q[0]), -jnp.cos(q[0])])

        return of_mass(t, *jax.jvp(place, (t, q), (jnp.ones_like(t), qdot)))

    shaken = LagrangianSystem(
        of_mass, ("x", "y"), holonomic=lambda t, q: 0.5 * ((q[0] - pivot(t)) ** 2 + q[1] ** 2 - 1.0)
    )
    times = np.linspace(0.0, 3.0, 31)
    angle = jaxball.simulate(LagrangianSystem(of_angle, ("angle",)), times, LagrangianState([0.5], [0.0]), **TIGHT)
    start = shaken.consistent(0.0, LagrangianState([jnp.sin(0.5), -jnp.cos(0.5)], [0.68, 0.0]))
    run = jaxball.simulate(shaken, times, start, **TIGHT)
    np.testing.assert_allclose(start.qdot, [0.68, 0.0], rtol=0, atol=1e-15)
    np.testing.assert_allclose(run.state.q[:, 0], pivot(times) + np.sin(angle.state.q[:, 0]), rtol=0, atol=1e-10)
    np.testing.assert_allclose(run.laws.position_constraints, 0.0, rtol=0, atol=1e-15)


@pytest.mark.long
def test_the_laws_hold_along_a_run():
    report = check_laws(pendulum(RODS), np.linspace(0.0, 2.0, 21), HANGING, quick=True)
    assert report.ok
    assert report["position_constraints"].ok
    assert report["energy"].residual < 1e-9


@pytest.mark.thorough
def test_saved_and_read_back_by_the_names_of_coordinates(tmp_path):
    run = jaxball.simulate(PARTICLE, [0.0, 1.0, 2.0], LagrangianState([0.0, 0.0, 0.0], [1.0, 1.0, 0.0]), throw=True)
    dataset = run.to_dataset()
    assert list(dataset["coordinate"].values) == ["x", "y", "z"]
    np.testing.assert_allclose(dataset["qdot"].sel(coordinate="x"), 1 / np.sqrt(1 + run.times**2), rtol=1e-8)
    back = jaxball.load_run(jaxball.save(run, str(tmp_path / "run.nc")), PARTICLE)
    np.testing.assert_array_equal(back.state.q, run.state.q)
    assert [line.get_label() for line in run.plot().axes[0].lines[:2]] != ["", ""]


SLEIGH = """
import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxball.physics.classical import AbstractLagrangianSystem


class Sleigh(AbstractLagrangianSystem):
    ahead: Float[Array, ""] = eqx.field(converter=jnp.asarray)

    coordinates = ("x", "y", "theta")

    def lagrangian(self, t, q, qdot):
        across = self.ahead * qdot[2]
        square = (qdot[0] - across * jnp.sin(q[2])) ** 2 + (qdot[1] + across * jnp.cos(q[2])) ** 2
        return 0.5 * square + 0.195 * qdot[2] ** 2

    def constraints(self, t, q, qdot):
        return qdot[0] * jnp.sin(q[2]) - qdot[1] * jnp.cos(q[2])
"""
SCENARIO = """
format = 1
kind = "my_sleigh:Sleigh"
body = { ahead = 0.5 }
initial = { q = [0.0, 0.0, 0.0], qdot = [0.0, 0.0, 1.0] }
time = { start = 0.0, end = 3.0, saves = 4 }
"""


@pytest.mark.thorough
def test_a_class_in_a_scenario_file(tmp_path, monkeypatch):
    (tmp_path / "my_sleigh.py").write_text(SLEIGH)
    monkeypatch.chdir(tmp_path)
    scenario = jaxball.read_scenario(SCENARIO)
    run = scenario.simulate()
    np.testing.assert_allclose(run.state.qdot[:, 2], 1 / np.cosh(0.625 * run.times), rtol=0, atol=1e-8)
    assert jaxball.read_scenario(jaxball.write_scenario(scenario)).state.qdot[2] == 1.0
    for wrong, named in {
        "qdot = [0.0, 1.0, 1.0]": "initial.qdot",
        "qdot = [0.0, 1.0]": "initial.qdot",
    }.items():
        with refuses(jaxball.ScenarioError, named):
            jaxball.read_scenario(SCENARIO.replace("qdot = [0.0, 0.0, 1.0]", wrong))


def test_times_at_which_a_force_jumps_are_found():
    pushed = LagrangianSystem(
        lambda t, q, qdot, start: free(t, q, qdot) + jnp.where(t > start, q[0], 0.0), ("x",), parameters=1.5
    )
    np.testing.assert_array_equal(pushed.driving_kinks(), [1.5])


def spun(*constraints, **given):
    return LagrangianSystem(free, ("x", "y", "z"), constraints=lambda t, q, v: [f(v) for f in constraints], **given)


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("system", "state", "names"),
    [
        (
            spun(lambda v: v[0], lambda v: v[1] + v[2], lambda v: 2 * v[0] - v[1] - v[2]),
            ([0.0, 0.0, 0.0],),
            ["constraints[2] 2"],
        ),
        (spun(lambda v: v[0], lambda v: v[0] - 1.0), ([0.0, 0.0, 0.0],), ["constraints[1]"]),
        (spun(lambda v: 0.0 * v[0]), ([0.0, 0.0, 0.0],), ["constraints[0]"]),
        (spun(lambda v: v[0] - v[1]), ([0.0, 0.0, 0.0], [1.0, 0.0, 0.0]), ["state.qdot 1"]),
        (spun(lambda v: v[0] * v[1]), ([0.0, 0.0, 0.0],), ["constraints[0] 1", "constraints[0]"]),
        (spun(lambda v: v[0] - v[1] ** 2), ([0.0, 0.0, 0.0],), ["constraints[0] -2"]),
        (FOUR_BAR, ([0.0, 0.0, 0.0],), ["holonomic[0]"]),
        (pendulum(RODS), ([1.1, 0.0, 1.8, 0.0],), ["state.q 0.105"]),
        (LagrangianSystem(lambda t, q, qdot: qdot[0] ** 2 - q[1], ("x", "y")), ([0.0, 0.0],), ["lagrangian"]),
    ],
    ids=[
        "redundant",
        "contradictory",
        "none",
        "violated",
        "product",
        "square",
        "flat four-bar",
        "longer rod",
        "no mass",
    ],
)
def test_what_does_not_fit_is_named(system, state, names):
    for sentence, name in zip(jaxball.problems(system, LagrangianState(*state)), names, strict=True):
        said(sentence, *name.split())


@pytest.mark.thorough
def test_the_nearest_state_that_keeps_constraints_moves_the_light_mass():
    """In the metric of the kinetic energy, Σ m |δ|² is least: masses 1 and 3 on a line close a gap as 3 to 1."""

    def lagrangian(t, q, qdot):
        return 0.5 * (qdot[0] ** 2 + 3.0 * qdot[1] ** 2)

    touching = LagrangianSystem(lagrangian, ("left", "right"), holonomic=lambda t, q: q[1] - q[0])
    state = touching.consistent(0.0, LagrangianState([0.0, 4.0], [0.0, -4.0]))
    np.testing.assert_allclose(state.q, [3.0, 3.0], rtol=1e-15)
    np.testing.assert_allclose(state.qdot, [-3.0, -3.0], rtol=1e-15)
    assert jaxball.problems(touching, state) == []


@pytest.mark.usefixtures("no_type_checks")
@pytest.mark.parametrize(
    ("make", "error", "named"),
    [
        (lambda: LagrangianSystem(free, "xyz"), TypeError, "coordinates"),
        (lambda: LagrangianSystem(free, ("x", "x")), ValueError, "coordinates"),
        (lambda: LagrangianSystem(free, ("x",), parameters=1.0), TypeError, "lagrangian"),
        (lambda: LagrangianSystem(1.0, ("x",)), TypeError, "lagrangian"),
        (
            lambda: LagrangianSystem(lambda t, q, qdot: qdot, ("x",)).laws(0.0, LagrangianState([0.0])),
            TypeError,
            "lagrangian",
        ),
        (
            lambda: spun(forces=lambda t, q, qdot: [1.0]).accelerations(0.0, LagrangianState([0.0, 0.0, 0.0])),
            TypeError,
            "forces",
        ),
        (lambda: jaxball.problems(PARTICLE, LagrangianState([0.0])), ValueError, "state.q"),
    ],
)
def test_sentences(make, error, named):
    with refuses(error, named):
        make()


def test_how_it_prints():
    assert repr(PARTICLE) == "LagrangianSystem(free, coordinates=('x', 'y', 'z'), constraints=with_y)"
    assert repr(LagrangianState([1.0, 2.0])) == "LagrangianState(q=(1.0, 2.0), qdot=(0.0, 0.0))"
    assert PARTICLE.describe() == "Lagrangian system in x, y, z"
