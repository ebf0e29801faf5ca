"""Charts of the largest exponent: cells known in closed form, cells that leave the plane, and cells that fail."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import xarray
from matplotlib.colors import to_rgba

import jaxball
from jaxball import plot
from jaxball.analysis.chaos import chaplygin_top, chart, rolling_robot
from jaxball.analysis.chaos.result import LyapunovSpectrum
from jaxball.plot.chaos import FAILED, LIFTED
from jaxball.programs import operation
from tests.support.sentences import refuses

D = np.array([0.5, 3.0, 3.1])
SPINS, HEIGHTS = np.array([0.0, 5.0]), np.array([0.05, 0.1, 1.5])


def top_heavy(spin, height):
    """Upright, the centre of mass above the centre; 1.5 is outside the shell."""
    zero = jnp.zeros_like(spin)
    ball = jaxball.Ball(mass=1.0, inertia=D, offset=jnp.stack([zero, zero, height]))
    return ball, jaxball.BallState(Omega=jnp.stack([zero, spin, zero]))


@pytest.fixture(scope="module")
def charted():
    seen = []
    dataset = chart(
        top_heavy,
        {"spin": SPINS, "height": HEIGHTS},
        (0.0, 120.0),
        transient=100.0,
        chunk=4,
        progress=lambda done, total: seen.append((done, total)),
    )
    return dataset, seen


@pytest.mark.thorough
def test_cells_at_rest_have_the_growth_rate_of_falling(charted):
    """√( M g ℓ / (d1 + M (r + ℓ)²) ), and N = M g while nothing moves."""
    dataset, _ = charted
    heights = HEIGHTS[:2]
    rates = np.sqrt(heights / (D[0] + (1 + heights) ** 2))
    np.testing.assert_allclose(dataset["exponent"][0, :2], rates, atol=1e-5)
    np.testing.assert_allclose(dataset["least_normal_force"][0, :2], 1.0, atol=1e-12)


@pytest.mark.thorough
def test_cells_that_leave_the_plane_are_masked(charted):
    """Over the top N = M (g − ℓ Ω²) and less, which is negative for Ω = 5 and ℓ = 0.05 and more."""
    dataset, _ = charted
    assert np.all(dataset["least_normal_force"][1, :2] <= 1 - HEIGHTS[:2] * 25 + 1e-9)
    assert np.all(np.isnan(dataset["exponent"][1, :2]))
    assert np.all(np.isfinite(dataset["exponent_regardless"][1, :2]))
    assert np.all(dataset["status"][1, :2] == 0)


@pytest.mark.thorough
def test_cells_that_fail_are_visible(charted):
    dataset, _ = charted
    assert np.all(dataset["status"][:, 2] == jaxball.Status.IMPOSSIBLE)
    assert np.all(np.isnan(dataset["exponent_regardless"][:, 2]))
    assert "3 IMPOSSIBLE" in dataset.attrs["statuses"]


@pytest.mark.thorough
def test_cells_lie_over_both_parameters_and_progress_is_told(charted):
    dataset, seen = charted
    assert dataset["exponent"].dims == ("spin", "height")
    np.testing.assert_array_equal(dataset["height"], HEIGHTS)
    assert (dataset.attrs["averaged_from"], dataset.attrs["end"]) == (100.0, 120.0)
    assert seen == [(4, 6), (6, 6)]


@pytest.mark.thorough
def test_the_figure_marks_what_left_the_plane_and_what_failed(charted):
    dataset, _ = charted
    ax = plot.chart(dataset)
    values, lifted, failed = (mesh.get_array() for mesh in ax.collections[:3])
    np.testing.assert_array_equal(np.ma.getmaskarray(values), np.isnan(dataset["exponent"]))
    np.testing.assert_array_equal(~np.ma.getmaskarray(lifted), [[False, False, False], [True, True, False]])
    np.testing.assert_array_equal(~np.ma.getmaskarray(failed), [[False, False, True], [False, False, True]])
    keys = {text.get_text(): patch.get_facecolor() for text, patch in zip(*_legend(ax), strict=True)}
    assert keys == {"leaves the plane": to_rgba(LIFTED), "solve failed": to_rgba(FAILED)}
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("height", "spin")


def _legend(ax):
    legend = ax.get_legend()
    return legend.get_texts(), legend.get_patches()


def test_the_figure_of_a_chart_where_nothing_is_known():
    nothing = np.full((2, 2), np.nan)
    dataset = xarray.Dataset(
        {
            "exponent": (("a", "b"), nothing),
            "least_normal_force": (("a", "b"), nothing),
            "status": (("a", "b"), np.ones((2, 2), int)),
        },
        {"a": [0.0, 1.0], "b": [0.0, 1.0]},
    )
    assert plot.chart(dataset, largest=0.1).collections[0].get_clim() == (0.0, 0.1)


def test_the_figure_of_the_convergence():
    times, running = np.arange(1.0, 4.0), np.arange(6.0).reshape(3, 2)
    two, unit, zero = jnp.zeros(2), jnp.eye(2), jnp.asarray(0)
    running_means = jnp.asarray(running)
    spectrum = LyapunovSpectrum(
        two,
        two,
        jnp.asarray(times),
        running_means,
        running_means,
        two,
        unit,
        zero,
        jnp.asarray(3.0),
        zero,
        jnp.asarray(0.0),
        jnp.asarray(0.0),
    )
    lines = spectrum.plot().get_lines()
    np.testing.assert_array_equal([line.get_ydata() for line in lines[:2]], running.T)
    np.testing.assert_array_equal(lines[0].get_xdata(), times)


def test_the_rolling_robot_is_a_shell_with_a_mass_that_goes_round():
    """At θ = −π/2 + rate t on the circle: at −E3 first, and a quarter of a turn later on the E1 axis."""
    robot = rolling_robot(0.7, rate=2.0, mass=0.4)
    motion = robot.point_masses[0].motion
    place = jax.jit(lambda t: motion.prepare().kinematics(t).chi)
    np.testing.assert_allclose(place(0.0), [0.0, 0.0, -0.7], atol=1e-15)
    np.testing.assert_allclose(place(np.pi / 4), [0.7, 0.0, 0.0], atol=1e-15)
    np.testing.assert_array_equal(robot.inertia, [2 / 3] * 3)
    assert jaxball.problems(robot) == []
    assert jaxball.problems(chaplygin_top()) == []


@pytest.mark.parametrize(
    ("parameters", "named"),
    [
        ({"a": [1.0]}, "parameters"),
        ({"a": [1.0], "b": 2.0}, "b"),
    ],
)
def test_wrong_arguments(parameters, named):
    with refuses(ValueError, named):
        chart(top_heavy, parameters, (0.0, 1.0))


@pytest.mark.slow
def test_the_rolling_robot_is_chaotic_where_its_orbit_is_wide():
    """Ilin, Moffatt & Vladimirov: chaos as the radius of the orbit grows, in contact for a range of initial spins."""

    def make(orbit, spin):
        zero = jnp.zeros_like(spin)
        return rolling_robot(orbit), jaxball.physics.ReducedState(Omega=jnp.stack([spin, zero, zero]))

    dataset = chart(make, {"orbit": [0.1, 0.85], "spin": [0.5, 0.6, 3.0]}, (0.0, 600.0), transient=100.0)
    exponent = dataset["exponent"].values
    assert np.all(exponent[1, :2] > 0.05)
    assert np.all(exponent[0, :2] < 0.02)
    assert np.isnan(exponent[1, 2])


@pytest.mark.thorough
def test_cells_are_rows_of_a_native_program(monkeypatch):
    """XLA took 40 s for such a chart where diffrax checked the first step by a callback to Python."""
    reached = []
    monkeypatch.setattr(operation, "_compile", lambda *which: reached.append(which))
    dataset = chart(top_heavy, {"spin": SPINS, "height": HEIGHTS[:1]}, (0.0, 10.0), chunk=4)
    assert not reached
    assert np.all(dataset["status"] == 0)


@pytest.mark.usefixtures("no_type_checks")
@pytest.mark.parametrize(
    ("named", "error", "sentence"),
    [
        ({"chunk": 0}, ValueError, "chunk"),
        ({"chunk": 2.5}, TypeError, "chunk"),
        ({"workers": 0}, ValueError, "workers"),
    ],
)
def test_counts_that_cannot_be(named, error, sentence):
    with refuses(error, sentence):
        chart(top_heavy, {"spin": SPINS, "height": HEIGHTS}, (0.0, 1.0), **named)


@pytest.mark.thorough
def test_cells_are_the_same_however_they_are_shared_out():
    """To the last bit with any number of threads and of cells at a time; by XLA to the tolerance of the solve."""
    arguments = top_heavy, {"spin": SPINS, "height": HEIGHTS[:2]}, (0.0, 10.0)
    told = [chart(*arguments, chunk=chunk, workers=workers) for chunk, workers in ((2, 1), (2, 2), (4, 3), (128, 2))]
    for other in told[1:]:
        assert other.equals(told[0])
    with jaxball.compiler("xla"):
        by_xla = chart(*arguments, chunk=4)
    np.testing.assert_allclose(by_xla["exponent_regardless"], told[0]["exponent_regardless"], atol=1e-6)
