"""What several requirements ask of a run is computed once: the operations of both are those of one, and little more."""

import jax
import jax.numpy as jnp
import numpy as np

import jaxball
from jaxball.studies import design
from jaxball.studies.design.problem.run import Run

TIMES = jnp.linspace(0.0, 1.0, 4)


def rolling(Omega):
    """A uniform ball's run, z = r t (Ω2, −Ω1), without a simulation."""
    q = jnp.broadcast_to(jnp.array([1.0, 0.0, 0.0, 0.0]), (4, 4))
    z = TIMES[:, None] * jnp.stack([Omega[1], -Omega[0]])[None]
    nothing = jnp.zeros((4, 0))
    state = jaxball.BallState(q, jnp.broadcast_to(Omega, (4, 3)), z, nothing, nothing)
    ball = jaxball.Ball(mass=1.0, inertia=(0.4, 0.4, 0.4), radius=1.0, gravity=2.0)
    return Run(ball, TIMES, state, jnp.asarray(0))


def end_of(run):
    return run.observables.geometric_centre[-1, :2]


def operations(*requirements):
    """How many operations their values and their gradients take, and how many loops over the times among these."""

    def total(Omega):
        run = rolling(Omega)
        return sum(jnp.sum(requirement(run)) for requirement in requirements)

    text = str(jax.make_jaxpr(jax.grad(total))(jnp.array([0.1, 0.5, 0.0])))
    return text.count(" = "), text.count(" = scan[")


def test_two_requirements_share_what_both_need():
    friction, normal = design.Friction(0.3), design.NormalForce(0.2)
    (alone, loops), (together, of_both) = operations(normal), operations(normal, friction)
    assert of_both == loops
    assert together < 1.2 * alone


def test_a_requirement_that_traces_does_not_keep_what_it_traced():
    """As a function of a user may; it has other tracers than what comes after it."""
    ends = []
    for around in (jax.jit, jax.vmap, lambda function: function):

        def total(Omega, around=around):
            run = rolling(Omega)
            inner = around(lambda x: x * jnp.sum(end_of(run)))(jnp.ones(1))
            return inner[0] + jnp.sum(end_of(run))

        ends.append(float(jax.jit(total)(jnp.array([0.1, 0.5, 0.0]))))
        np.testing.assert_allclose(jax.jit(jax.grad(total))(jnp.array([0.1, 0.5, 0.0])), [-2.0, 2.0, 0.0])
    np.testing.assert_allclose(ends, 2 * (0.5 - 0.1))


def test_a_run_that_is_not_traced_keeps_its_numbers_and_its_leaves():
    run = rolling(jnp.array([0.1, 0.5, 0.0]))
    before = jax.tree.leaves(run)
    assert run.observables is run.observables
    assert all(map(np.array_equal, jax.tree.leaves(run), before))
    doubled = jax.tree.map(lambda leaf: 2 * leaf, run)
    np.testing.assert_allclose(end_of(doubled), 2 * end_of(run))
