"""Runs of a study that end where the ball would leave the plane."""

import jax.numpy as jnp
import numpy as np
import pytest
import xarray
from scipy.integrate import quad
from scipy.optimize import brentq

from jaxball import Detachment, ScenarioError, Status, contact_extremes, simulate
from jaxball.files.scenario.sources import builtin_text
from jaxball.studies.sweep import open_store
from jaxball.studies.sweep.study import ends_at_detachment
from tests.support.sentences import refuses
from tests.sweep.studies import study

INERTIA, OFFSET = 0.3, 0.4
WHEEL = f"""
format = 1
kind = "disk"
body = {{ mass = 1.0, radius = 1.0, inertia = {INERTIA}, offset = [0.0, 0.0, -{OFFSET}], gravity = 1.0 }}
initial = {{ phi = 0.0, phidot = 1.0 }}
time = {{ start = 0.0, end = 5.0, saves = 6 }}
"""
SPEEDS = """
[[axes]]
path = "initial.phidot"
values = [0.5, 4.0, 1.0, 5.0]
"""
DETACHED = np.array([False, True, False, True])


def rate(start: float, phi: float) -> float:
    """dφ/dt by the conservation of energy."""
    height = OFFSET * (1 - np.cos(phi))
    return np.sqrt((inertia(0.0) * start**2 - 2 * height) / inertia(phi))


def inertia(phi: float) -> float:
    """The moment of inertia about the contact point."""
    return INERTIA + 1 + OFFSET**2 - 2 * OFFSET * np.cos(phi)


def normal_force(start: float, phi: float) -> float:
    """M (g + the vertical acceleration of the centre of mass), with d²φ/dt² from the derivative of the energy."""
    squared = rate(start, phi) ** 2
    acceleration = -OFFSET * np.sin(phi) * (1 + squared) / inertia(phi)
    return 1 + OFFSET * (np.cos(phi) * squared + np.sin(phi) * acceleration)


def detachment(start: float) -> float:
    """When N is zero first."""
    phi = brentq(lambda phi: normal_force(start, phi), 0.0, np.pi, xtol=1e-14)
    return quad(lambda phi: 1 / rate(start, phi), 0.0, phi, epsabs=1e-13)[0]


def solved(folder, settings):
    """The study by itself and its results."""
    whole = study(folder, axes=SPEEDS, settings=f"detachment = true\n{settings}", scenario=WHEEL)
    whole.run(folder / "s.zarr")
    return whole, xarray.open_zarr(folder / "s.zarr").load()


@pytest.mark.long
def test_rows_end_where_the_normal_force_is_zero(tmp_path):
    _, data = solved(tmp_path, "")
    np.testing.assert_array_equal(data["status"], np.where(DETACHED, Status.DETACHED, Status.SUCCESS))
    when = [detachment(start) if ends else 5.0 for start, ends in zip((0.5, 4.0, 1.0, 5.0), DETACHED, strict=True)]
    np.testing.assert_allclose(data["reached"], when, rtol=1e-6)
    np.testing.assert_array_equal(np.isnan(data["phi"]), DETACHED)
    store = tmp_path / "s.zarr"
    (again,) = open_store(store).scenarios([1])
    run = again.simulate(events=open_store(store).events())
    assert run.status == Status.DETACHED
    np.testing.assert_allclose(run.reached, data["reached"][1], rtol=1e-8)
    assert not ends_at_detachment(study(tmp_path, scenario=WHEEL).identity()["settings"])


@pytest.mark.slow
def test_a_row_is_the_run_that_an_event_ends(tmp_path):
    whole, data = solved(tmp_path, 'contact = true\nfind = ["distance"]\nsave = "times"')
    for row in range(len(DETACHED)):
        scenario, seen = whole.scenario(row), data.isel(row=row)
        run = simulate(
            scenario.system,
            jnp.asarray(scenario.times),
            scenario.state,
            rtol=scenario.rtol,
            atol=scenario.atol,
            dense=True,
            events={"detachment": Detachment()},
        )
        np.testing.assert_allclose(seen["reached"], run.reached, rtol=1e-10)
        np.testing.assert_allclose(seen["phi"], run.state.phi, rtol=1e-9, atol=1e-12)
        np.testing.assert_allclose(seen["least_normal_force"], contact_extremes(run).least_normal_force, atol=1e-9)
        if DETACHED[row]:
            # A wheel that never turns back has come as far as it has turned.
            phi = run.events["detachment"].state.phi[0]
            np.testing.assert_allclose(seen["distance"], abs(phi - scenario.state.phi), rtol=1e-6)


def test_what_touches_no_plane_cannot_detach(tmp_path):
    with refuses(ScenarioError, "detachment"):
        study(tmp_path, settings="detachment = true", scenario=builtin_text("free-rigid-body"))
