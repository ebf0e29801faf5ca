"""Times with which functions compare the time, against those with which they were written to."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxball.numerics.time_comparisons import MOST_TIMES, find_compared_times

P = 0.7
TABLE = np.array([0.0, 0.25, 0.5, 0.75, 1.0])
MANY = np.linspace(0.0, 1.0, MOST_TIMES + 1)


@jax.jit
def _before(t, p):
    return t < p


@jax.custom_jvp
def _own_rule(x):
    return jnp.where(x > 0, x, 0.0)


_own_rule.defjvp(lambda primals, tangents: (_own_rule(*primals), jnp.where(primals[0] > 0, tangents[0], 0.0)))


@jax.custom_vjp
def _own_reverse_rule(x):
    return jnp.where(x > 0, 1.0, 0.0)


_own_reverse_rule.defvjp(lambda x: (_own_reverse_rule(x), None), lambda _, g: (0.0 * g,))


# Of functions of (t, p): the times of their jumps and kinks at p = 0.7, and the derivatives of these by p.
RESOLVED = {
    "less": (lambda t, p: jnp.where(t < p, 1.0, 0.0), [P], [1]),
    "reversed": (lambda t, p: jnp.where(p >= t, 1.0, 0.0), [P], [1]),
    "between": (lambda t, p: jnp.where((t > p) & (t < 2 * p), 1.0, 0.0), [P, 2 * P], [1, 2]),
    "after a shift": (lambda t, p: jnp.where(t - 0.3 < p, 1.0, 0.0), [0.3 + P], [1]),
    "scaled": (lambda t, p: jnp.where(-2 * t / p > 3.0, 1.0, 0.0), [-1.5 * P], [-1.5]),
    "both sides": (lambda t, p: jnp.where(3 * t < t + p, 1.0, 0.0), [P / 2], [0.5]),
    "within another": (lambda t, p: jnp.where(t < p, 1.0, jnp.where(t < p + 1, 2.0, 3.0)), [P, P + 1], [1, 1]),
    "cond": (lambda t, p: jax.lax.cond(t < p, lambda: 1.0, lambda: t), [P], [1]),
    "in a branch": (lambda t, p: jax.lax.cond(p < 9, lambda: jnp.where(t < p, 1.0, 0.0), lambda: t), [P], [1]),
    "helper": (lambda t, p: jnp.where(_before(t, p), 1.0, 0.0), [P], [1]),
    "custom_jvp": (lambda t, p: _own_rule(t - p), [P], [1]),
    "custom_vjp": (lambda t, p: _own_reverse_rule(t - p), [P], [1]),
    "checkpoint": (lambda t, p: jax.checkpoint(lambda t: jnp.where(t < p, 1.0, 0.0))(t), [P], [1]),
    "derivative": (lambda t, p: jax.grad(lambda t: jnp.where(t < p, t**2, 0.0))(t), [P], [1]),
    "ramp": (lambda t, p: jnp.maximum(t - p, 0.0), [P], [1]),
    "clip": (lambda t, p: jnp.clip((t - p) / 0.5, 0.0, 1.0), [P, P + 0.5], [1, 1]),
    "clamp": (lambda t, p: jax.lax.clamp(p, t, 2 * p), [P, 2 * P], [1, 2]),
    "abs": (lambda t, p: jnp.abs(t - p), [P], [1]),
    "sign": (lambda t, p: jnp.sign(t - p), [P], [1]),
    "relu": (lambda t, p: jax.nn.relu(t - p), [P], [1]),
    "mask": (lambda t, p: (t < p).astype(float) * 3.0, [P], [1]),
    "piece of a ramp": (lambda t, p: jnp.where(jnp.maximum(t - p, 0.0) > 0.2, 1.0, 0.0), [P, P + 0.2], [1, 1]),
    "select": (lambda t, p: jnp.select([t < p, t < 2 * p], [1.0, 2.0], 3.0), [P, 2 * P], [1, 2]),
    "piecewise": (lambda t, p: jnp.piecewise(t, [t < p], [lambda t: t, lambda t: 2 * t]), [P], [1]),
    "stack": (lambda t, p: jnp.where(jnp.stack([t, t - p]) > 0.5, 1.0, 0.0), [0.5, 0.5 + P], [0, 1]),
    "table": (lambda t, p: jnp.sum(t > TABLE * p), TABLE * P, TABLE),
    "vmap": (lambda t, p: jax.vmap(lambda q: jnp.where(t < q * p, 1.0, 0.0))(TABLE), TABLE * P, TABLE),
    "searchsorted": (lambda t, p: jnp.asarray(TABLE)[jnp.searchsorted(TABLE + p, t)], TABLE + P, [1] * 5),
    "interp": (lambda t, p: jnp.interp(t, TABLE + p, TABLE), TABLE + P, [1] * 5),
    "digitize": (lambda t, p: jnp.asarray(TABLE)[jnp.digitize(t, TABLE + p) - 1], TABLE + P, [1] * 5),
    "scan": (
        lambda t, p: jax.lax.scan(lambda c, q: (c + jnp.where(t < q, 1.0, 0.0), None), 0.0, TABLE * p)[0],
        TABLE * P,
        TABLE,
    ),
    "fori_loop": (
        lambda t, p: jax.lax.fori_loop(0, 5, lambda i, s: s + jnp.where(t < (TABLE * p)[i], 1.0, 0.0), 0.0),
        TABLE * P,
        TABLE,
    ),
    "while_loop": (
        lambda t, p: jax.lax.while_loop(
            lambda c: c[0] < 3, lambda c: (c[0] + 1, c[1] + jnp.where(t < p, 1.0, 0.0)), (0, 0.0)
        )[1],
        [P],
        [1],
    ),
    "never": (lambda t, p: jnp.where(0.0 * t < p, 1.0, 0.0), [np.inf], [0]),
}


def _found(function, p=P):
    t, p = jnp.zeros(()), jnp.asarray(p)
    return find_compared_times(jax.make_jaxpr(function)(t, p), t, p)


@functools.cache
def _of_all():
    """Of each of these functions: the times, and their derivatives in both modes; in one program, mapped over two p."""

    def each(function):
        times = lambda p: _found(function, p).times  # noqa: E731
        return lambda p: (times(p), jax.jacfwd(times)(p), jax.jacrev(times)(p))

    every = {name: each(function) for name, (function, _, _) in RESOLVED.items()}
    return jax.jit(jax.vmap(lambda p: {name: one(p) for name, one in every.items()}))(jnp.full(2, P))


@pytest.mark.thorough
@pytest.mark.parametrize("name", RESOLVED)
def test_times_of_comparisons_and_their_derivatives(name):
    function, times, slopes = RESOLVED[name]
    found = _found(function)
    assert found.unresolved == ()

    def each(times, slopes):  # every time once
        pairs = {(round(float(time), 12), round(float(slope), 12)) for time, slope in zip(times, slopes, strict=True)}
        return sorted(pairs)

    within, moved, pulled = _of_all()[name]
    for row in (0, 1):
        np.testing.assert_allclose(within[row], found.times, rtol=1e-15)
        assert each(found.times, moved[row]) == each(times, slopes)
    np.testing.assert_array_equal(pulled, moved)


@pytest.mark.parametrize(
    ("function", "symbols"),
    [
        (lambda t, p: jnp.where(jnp.sin(t) > 0, 1.0, 0.0), (">",)),
        (lambda t, p: jnp.where(jnp.mod(t, p) < 0.1, 1.0, 0.0), ("<",)),
        (lambda t, p: jnp.floor(t / p), ("floor",)),
        (lambda t, p: (t / p).astype(int), ("astype(int)",)),
        (lambda t, p: jnp.sign(jnp.cos(t)), ("sign",)),
        (lambda t, p: jnp.asarray(MANY)[jnp.searchsorted(MANY, t)], ("searchsorted",)),
    ],
)
def test_jumps_whose_times_are_not_known(function, symbols):
    found = _found(function)
    assert found.unresolved == symbols
    assert found.times.size == 0


SMOOTH = {
    "no comparison": lambda t, p: jnp.sin(p * t) * jnp.exp(-t),
    "power": lambda t, p: t**p,
    "softplus": lambda t, p: jax.nn.softplus(t - p),
    "sinc": lambda t, p: jnp.sinc(t - p),
    "mod": lambda t, p: jnp.sin(2 * jnp.pi * jnp.mod(t, p) / p),
    "division": lambda t, p: jnp.where(jnp.sin(t) == 0, 0.0, 1 / jnp.where(jnp.sin(t) == 0, 1.0, jnp.sin(t))),
    "length": lambda t, p: jnp.sqrt(jnp.where(jnp.sin(t) ** 2 + p**2 > 0, jnp.sin(t) ** 2 + p**2, 1.0)),
    "floor of a length": lambda t, p: jnp.where(jnp.abs(jnp.sin(t)) < 1e-9, 1e-9, jnp.abs(jnp.sin(t))),
    "norm": lambda t, p: jnp.linalg.norm(jnp.stack([jnp.sin(t), p])),
    "of parameters": lambda t, p: jnp.where(p > 0.5, t, jnp.maximum(p, 0.1) * t),
    "random": lambda t, p: jax.random.uniform(jax.random.key(0)) * t,
    "polynomial": lambda t, p: jnp.polyval(TABLE, t),
    "iteration": lambda t, p: jax.lax.while_loop(
        lambda x: jnp.abs(jnp.cos(x) - x * t) > 1e-9, lambda x: x + (jnp.cos(x) - x * t) / (jnp.sin(x) + t), 0.5
    ),
}


@pytest.mark.parametrize("name", SMOOTH)
def test_guards_and_smooth_functions_are_not_taken_for_jumps(name):
    found = _found(SMOOTH[name])
    assert found.unresolved == ()
    assert found.times.size == 0


def _with_state(function):
    t, p, x = jnp.zeros(()), jnp.asarray(P), jnp.zeros(2)
    return find_compared_times(jax.make_jaxpr(function)(t, p, x), t, p)


def test_a_state_is_compared_without_a_time():
    def friction(t, p, x):
        speed = jnp.linalg.norm(x)
        return jnp.where(speed > p, 1.0, jnp.sin(t)) * jnp.sign(x[0]) + jnp.floor(x[1])

    assert _with_state(friction) == (pytest.approx(np.zeros(0)), ())
    assert _with_state(lambda t, p, x: jnp.where(x[0] > jnp.where(t < p, 1.0, 2.0), 1.0, 0.0)).unresolved == ()
    assert _with_state(lambda t, p, x: jnp.where(t < x[0], 1.0, 0.0)).unresolved == ("<",)


@pytest.mark.thorough
@pytest.mark.parametrize("comparison", [jnp.less, jnp.less_equal, jnp.greater, jnp.greater_equal])
def test_the_time_is_where_rounding_puts_the_change(comparison):
    """One floating-point number before it and one after it, the function is on its own sides."""
    rng = np.random.default_rng(7)
    sizes = rng.choice([1e-3, 1.0, 1e3, 1e5], 200)
    shifts, parameters = sizes * rng.normal(size=200), rng.uniform(0.1, 3.0, 200)

    def changed(t, p):
        return comparison((t - p[0]) / p[2], p[1])

    def beside(shift, parameter, scale):
        p = jnp.stack([shift, (parameter - shift) / scale, scale])
        t = jnp.zeros(())
        (time,) = find_compared_times(jax.make_jaxpr(changed)(t, p), t, p).times
        return time, changed(jnp.nextafter(time, -jnp.inf), p), changed(jnp.nextafter(time, jnp.inf), p)

    for scale in (1.0, 0.7):
        times, earlier, later = jax.vmap(beside, (0, 0, None))(shifts, parameters, scale)
        assert np.all(np.abs(times - parameters) <= 1e-15 * (1 + np.abs(shifts)))
        assert np.all(earlier == comparison(-1.0, 0.0))
        assert np.all(later == comparison(1.0, 0.0))


def test_a_table_of_too_many_times_is_interpolated_without_steps_to_each():
    found = _found(lambda t, p: jnp.interp(t, MANY, p * MANY))
    assert found.unresolved == ()
    assert set(found.times.tolist()) == {0.0, 1.0}  # where the interpolation ends
