"""The dictionary of a view of a rigid body or a particle, against states, closed forms and moments of inertia."""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array, Float
from scipy.spatial.transform import Rotation

import jaxball
from jaxball.physics.classical import (
    AbstractClassicalState,
    AbstractClassicalSystem,
    FreeRigidBody,
    HarmonicAxis,
    HeavyTop,
    NonholonomicParticle,
    ParticleState,
    RigidBodyState,
    SuslovProblem,
    VakonomicParticle,
    VakonomicState,
)
from jaxball.plot.view.free import ellipsoid_of
from jaxball.plot.view.page import view_document
from tests.support.pages import arrays_of
from tests.support.sentences import refuses

TIGHT = {"rtol": 1e-10, "atol": 1e-10}
TIMES = np.linspace(0.0, 4.0, 41)
TILTED = RigidBodyState(q=(np.cos(0.3), np.sin(0.3), 0.0, 0.0), Omega=(0.4, 0.1, 3.0))


@pytest.fixture(scope="module")
def top_run():
    return jaxball.simulate(HeavyTop(inertia=(1.2, 1.2, 0.5), chi=(0.0, 0.0, 0.6), mass=1.5), TIMES, TILTED, **TIGHT)


@pytest.fixture(scope="module")
def free_run():
    return jaxball.simulate(FreeRigidBody(inertia=(1.0, 2.0, 2.5)), TIMES, TILTED, **TIGHT)


@pytest.fixture(scope="module")
def particle_run():
    return jaxball.simulate(NonholonomicParticle(), TIMES, ParticleState(y=1.0, xdot=1.0, ydot=1.0), **TIGHT)


@pytest.mark.parametrize("run", ["top_run", "free_run"])
def test_the_pose_is_that_of_the_state(run, request):
    """Λ of q, the scalar first, by the polynomial that turns a vector: v + 2 w (u × v) + 2 u × (u × v)."""
    run = request.getfixturevalue(run)
    arrays, state = arrays_of(view_document(run)), run.state
    np.testing.assert_array_equal(arrays["time"], TIMES)
    q = np.asarray(state.q)
    w, u = q[:, :1], q[:, 1:]
    for vector in np.eye(3):
        expected = vector + 2 * w * np.cross(u, vector) + 2 * np.cross(u, np.cross(u, vector))
        np.testing.assert_allclose(Rotation.from_quat(arrays["quaternion"]).apply(vector), expected, atol=1e-6)
    np.testing.assert_allclose(arrays["angular_velocity"], state.Omega, atol=1e-6)
    assert not np.any(arrays["centre"])
    assert np.ptp(arrays["quaternion"][:, 3]) > 0.1


def test_the_momentum_of_a_free_body_stays_in_space_and_that_of_a_top_about_the_vertical(free_run, top_run):
    free, top = arrays_of(view_document(free_run)), arrays_of(view_document(top_run))
    start = Rotation.from_rotvec([0.6, 0.0, 0.0]).apply(np.array([1.0, 2.0, 2.5]) * [0.4, 0.1, 3.0])
    np.testing.assert_allclose(free["momentum_in_space"], np.tile(start, (41, 1)), atol=1e-6)
    in_space = Rotation.from_quat(free["quaternion"]).apply(free["angular_momentum"])
    np.testing.assert_allclose(in_space, free["momentum_in_space"], atol=1e-5)
    np.testing.assert_allclose(top["momentum_in_space"][:, 2], top["momentum_in_space"][0, 2], atol=1e-6)
    assert np.ptp(top["momentum_in_space"][:, 0]) > 0.1
    np.testing.assert_allclose(top["energies"].sum(axis=1), top["energies"][0].sum(), atol=1e-5)
    height = Rotation.from_quat(top["quaternion"]).apply([0.0, 0.0, 0.6])[:, 2]
    assert np.ptp(height) > 0.01
    np.testing.assert_allclose(top["energies"][:, 1], 1.5 * height, atol=1e-5)
    np.testing.assert_allclose(top["laws"], 0.0, atol=1e-7)


@pytest.mark.parametrize("chi", [(0.0, 0.0, 0.6), (0.2, -0.1, 0.5)])
def test_the_ellipsoid_of_a_top_has_its_moments(chi):
    """Mass whose standard deviations are the semi-axes, at χ, has the moments (d1, d2, d3) about the fixed point."""
    mass, inertia = 1.5, np.array([1.3, 1.2, 0.5])
    shape = ellipsoid_of(HeavyTop(inertia=inertia, chi=chi, mass=mass), inertia)
    second = mass * (shape.turn @ np.diag(shape.semi_axes**2) @ shape.turn.T + np.outer(chi, chi))
    np.testing.assert_allclose(np.trace(second) * np.eye(3) - second, np.diag(inertia), atol=1e-6)
    assert np.linalg.det(shape.turn) == pytest.approx(1.0)
    np.testing.assert_array_equal(shape.centre, np.asarray(chi, dtype=shape.centre.dtype))


@pytest.mark.parametrize(
    ("semi_axes", "moments"),
    [
        ((1.0, 0.5, 0.2), (0.29, 1.04, 1.25)),  # of a solid ellipsoid (b² + c², c² + a², a² + b²), times m / 5
        ((1.0, 1.0, 0.04), (1.0, 1.0, 2.0)),  # of a plate, which is drawn thin
        ((np.sqrt(2 / 11), 1.0, 0.04), (1.0, 0.1, 1.3)),  # of no body: s = (0.2, 1.1, −0.1)
    ],
)
def test_the_ellipsoid_of_a_free_body_is_in_proportion(semi_axes, moments):
    shape = ellipsoid_of(None, np.array(moments))
    np.testing.assert_allclose(shape.semi_axes, semi_axes, rtol=1e-12)
    np.testing.assert_array_equal((shape.centre, shape.turn.diagonal()), ((0, 0, 0), (1, 1, 1)))


@pytest.mark.thorough
def test_a_suslov_problem_has_its_vector_across_the_angular_velocity():
    xi = HarmonicAxis((0.5, -0.4, 0.7), [(0.3, 0.0, -0.2)], [1.3])
    start = RigidBodyState(Omega=(0.4, 0.5, 0.0))
    run = jaxball.simulate(SuslovProblem(inertia=(1.0, 1.6, 2.1), xi=xi), TIMES, start, **TIGHT)
    arrays = arrays_of(view_document(run))
    expected = np.array([0.5, -0.4, 0.7]) + np.outer(np.sin(1.3 * TIMES), [0.3, 0.0, -0.2])
    expected /= np.linalg.norm(expected, axis=1)[:, None]
    np.testing.assert_allclose(arrays["xi"], expected, atol=1e-6)
    np.testing.assert_allclose(np.sum(arrays["xi"] * arrays["angular_velocity"], axis=1), 0.0, atol=1e-6)


def test_a_particle_is_where_its_closed_form_says(particle_run):
    """y = 1 + t and, with A = √2, x = A (arsinh y − arsinh 1) and z = A (√(1 + y²) − √2)."""
    arrays, y = arrays_of(view_document(particle_run)), 1.0 + TIMES
    A = np.sqrt(2.0)
    expected = np.stack([A * (np.arcsinh(y) - np.arcsinh(1.0)), y, A * (np.sqrt(1 + y**2) - A)], axis=1)
    np.testing.assert_allclose(arrays["centre"], expected, atol=1e-6)
    np.testing.assert_allclose(arrays["velocity"][:, 2], y * arrays["velocity"][:, 0], atol=1e-6)
    assert "multiplier" not in arrays


def test_graphs_name_columns_that_there_are(top_run, free_run, particle_run):
    start = VakonomicState(y=1.0, xdot=1.0, ydot=1.0)
    vakonomic = jaxball.simulate(VakonomicParticle(), TIMES, start, **TIGHT)
    titles = {
        "top": ["Angular velocity", "Energies", "Angular momentum, space axes", "Vertical, body axes"],
        "free": ["Angular velocity", "Kinetic energy", "Angular momentum, space axes"],
        "both": ["Coordinates", "Velocity", "Multiplier"],
        "three": ["Angular speed", "Energy", "Angular momentum", "Vertical"],
        "particles": ["x", "y", "z", "Speed"],
    }
    laws = ["Laws, change since the start"]
    for runs, expected in (
        (top_run, titles["top"] + laws),
        (free_run, titles["free"] + laws),
        (particle_run, titles["both"][:2] + laws),
        ({"a": particle_run, "b": vakonomic}, titles["both"]),
        (dict.fromkeys("abc", top_run), titles["three"]),
        (dict.fromkeys("abc", particle_run), titles["particles"]),
    ):
        document = view_document(runs)
        assert [plot["title"] for plot in document["plots"]] == expected
        found = [arrays_of(document, body) for body in range(len(document["bodies"]))]
        for plot in document["plots"]:
            for one in plot["series"]:
                sizes = [np.shape(arrays[one["array"]])[1] for arrays in found if one["array"] in arrays]
                assert sizes
                assert max(one["columns"]) < min(sizes)


def test_rigid_bodies_are_side_by_side_and_particles_are_where_they_are(top_run, free_run, particle_run):
    document = view_document({"top": top_run, "free": free_run})
    first, second = (arrays_of(document, body)["centre"] for body in range(2))
    reach = sum(body["radius"] for body in document["bodies"])
    assert np.all(second[:, 0] - first[:, 0] > 1.25 * reach)
    particles = view_document({"a": particle_run, "b": particle_run})
    assert particles["bodies"][0]["arrays"] == particles["bodies"][1]["arrays"]
    assert particles["floor"] is None


class PlaneState(AbstractClassicalState):
    """A place in the plane."""

    place: Float[Array, "2"] = eqx.field(converter=jnp.asarray, default=(1.0, 0.0))


class Spiral(AbstractClassicalSystem[PlaneState]):
    """A system without a picture."""

    title: ClassVar[str] = "spiral"
    state_type: ClassVar[type[PlaneState]] = PlaneState

    def field(self, t, state):
        return PlaneState(place=-state.place)

    def laws(self, t, state):
        return ()


class Turntable(AbstractClassicalSystem[RigidBodyState]):
    """A rigid body that turns as it did, and states neither moments nor laws."""

    title: ClassVar[str] = "body"
    state_type: ClassVar[type[RigidBodyState]] = RigidBodyState

    def field(self, t, state):
        return FreeRigidBody(inertia=(1.0, 1.0, 1.0)).field(t, state)

    def laws(self, t, state):
        return jaxball.physics.system.NoLaws()


def test_a_system_of_ones_own_with_the_state_of_a_rigid_body_is_shown():
    run = jaxball.simulate(Turntable(), [0.0, 1.0], RigidBodyState(Omega=(0.0, 0.0, 0.5)), **TIGHT)
    document = view_document(run)
    assert [plot["title"] for plot in document["plots"]] == ["Angular velocity"]
    np.testing.assert_allclose(arrays_of(document)["quaternion"][1], [0, 0, np.sin(0.25), np.cos(0.25)], atol=1e-6)
    assert document["bodies"][0]["ellipsoid"]["semi_axes"] == [1.0, 1.0, 1.0]


def test_what_cannot_be_shown_is_refused_in_a_sentence(top_run, particle_run, ball_trajectory):
    spiral = jaxball.simulate(Spiral(), [0.0, 1.0], PlaneState(), **TIGHT)
    for runs, options, named in (
        (spiral, {}, "trajectory"),
        ({"a": top_run, "b": particle_run}, {}, "trajectories"),
        ({"a": ball_trajectory, "b": top_run}, {}, "trajectories"),
        (top_run, {"friction": 0.3}, "friction"),
        (top_run, {"discs": [(np.zeros(2), 1.0)]}, "discs"),
        (particle_run, {"wanted": np.zeros((2, 2))}, "wanted"),
    ):
        with refuses(ValueError, named):
            view_document(runs, **options)
    batch = eqx.tree_at(lambda run: run.status, top_run, jnp.zeros((2,), dtype=int))
    with refuses(ValueError, "A picture"):
        view_document(batch)
