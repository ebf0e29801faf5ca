"""The laws checked on runs of balls and disks: which apply, that they hold, and that wrong equations break them."""

import functools

import numpy as np
import pytest

import jaxball
from jaxball import Scenario
from jaxball.analysis.verify import check_laws
from jaxball.analysis.verify.case import Case
from jaxball.analysis.verify.laws import LAWS
from jaxball.analysis.verify.run import UNSAID
from jaxball.files.scenario import builtin_scenarios
from jaxball.files.scenario.sources import builtin_text
from jaxball.numerics.vectors import cross
from jaxball.paper import reference
from jaxball.physics.dynamics import locked
from jaxball.programs.store import current
from jaxball.simulation import DEFAULT_TOLERANCE, simulate as simulation
from tests.support.paper import paper_ball, paper_disk
from tests.support.sentences import refuses, said

INTEGRALS = ("energy", "chaplygin", "jellett-rate", "jellett", "routh")
TIMES = np.linspace(0.0, 10.0, 11)


def sphere(*, inertia=(0.4, 0.4, 0.5), places=((0.0, 0.0, 0.6), (0.0, 0.0, -0.2)), Omega=(0.4, -0.3, 0.9), rtol=1e-10):
    """A ball with two fixed masses, of 0.3 and 0.1: one structure, so that one program serves all of these tests."""
    masses = [jaxball.PointMass(m, jaxball.Fixed(place)) for m, place in zip((0.3, 0.1), places, strict=True)]
    ball = jaxball.Ball(mass=1.0, inertia=inertia, masses=masses)
    start = jaxball.BallState(q=[0.9, 0.3, -0.3, 0.1], Omega=Omega)
    return Scenario("a sphere", ball, start, TIMES, rtol=rtol, atol=rtol)


@functools.cache
def routh_sphere():
    return check_laws(sphere(), quick=True)


@pytest.mark.thorough
def test_all_laws_that_apply_hold_for_a_routh_sphere():
    report = routh_sphere()
    assert report.ok
    applying = {row.law for row in report.rows if row.applies}
    assert applying == {
        "energy", "momentum", "jellett-rate", "jellett", "routh", "norm", "rolling", "contact", "error", "convergence",
    }  # fmt: skip
    assert report["contact"].at_least
    said(report["chaplygin"].reason, "centre of mass")
    assert "the centre of mass is up to 0.114" in report["chaplygin"].reason


@pytest.mark.thorough
def test_the_table_names_each_law_with_its_numbers_and_verdict():
    lines = str(routh_sphere()).splitlines()
    assert lines[0] == "a sphere"
    (routh,) = (line for line in lines if line.split()[0] == "routh")
    assert routh.endswith("holds")
    assert "e-fold in" in lines[-1]


@pytest.mark.thorough
def test_a_report_is_plain_data():
    content = routh_sphere().as_dict()
    assert content["ok"] is True
    assert content["rows"][0]["law"] == "energy"
    assert content["trust"]["growth"] > 1


@pytest.mark.thorough
def test_jellett_and_routh_do_not_apply_where_the_moments_differ_and_do_change():
    report = check_laws(sphere(inertia=(0.4, 0.5, 0.5)), laws=INTEGRALS)
    assert report.ok
    for law in ("jellett", "routh"):
        assert not report[law].applies
        said(report[law].reason)
        assert report[law].residual > 1e-3
    assert report["energy"].residual < 1e-8
    assert report["jellett-rate"].residual < 1e-8


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("inertia", "direction"), [((0.5, 0.4, 0.4), (1, 0, 0)), ((0.4, 0.5, 0.4), (0, -1, 0)), ((0.4,) * 3, (0.6, 0, 0.8))]
)
def test_jellett_and_routh_hold_about_any_axis(inertia, direction):
    places = [0.6 * np.array(direction), -0.2 * np.array(direction)]
    report = check_laws(sphere(inertia=inertia, places=places), laws=INTEGRALS)
    assert report.ok
    assert report["jellett"].applies
    assert report["routh"].applies


def test_chaplygins_integral_is_found_to_apply_where_the_masses_balance():
    report = check_laws(sphere(inertia=(0.3, 0.4, 0.5), places=[(0.2, 0.0, 0.1), (-0.6, 0.0, -0.3)]), laws=INTEGRALS)
    assert report.ok
    assert report["chaplygin"].applies
    assert not report["routh"].applies


@pytest.mark.thorough
def test_a_ball_that_would_lift_off_is_not_trusted():
    """The centre of mass, 0.114 from the centre, needs more than its weight to turn at 8 radians a unit of time."""
    report = check_laws(sphere(Omega=(8.0, 0.0, 0.0)), laws=["contact", "energy"])
    assert report["energy"].ok
    assert report["contact"].residual < 0
    assert report.doubts[0].startswith("contact fails: ")
    assert "must be above 0" in report.doubts[0]


def test_a_loose_tolerance_is_not_trusted():
    report = check_laws(sphere(rtol=1e-2), laws=["error"])
    assert not report.ok
    assert report.trust.error > 1e-3
    assert report.trust.horizon < 10
    assert "tighten the tolerances" in str(report)
    assert "Do not trust this run" in str(report)


@pytest.fixture
def thousandth_wrong(monkeypatch):
    """The term (rΓ × Ω) × P of the momentum's rate too small by a thousandth."""
    right_rate = locked.contact_momentum_rate

    def rate(at, r, acting, Pi, Omega):
        P = locked.linear_momentum(at, r, Omega, acting.Gamma)
        return right_rate(at, r, acting, Pi, Omega) - 1e-3 * cross(r * cross(acting.Gamma, Omega), P)

    monkeypatch.setattr(locked, "contact_momentum_rate", rate)
    # Programs that were compiled from right equations are set aside.
    monkeypatch.setattr(simulation, "_compile_program", functools.cache(simulation._compile_program.__wrapped__))
    with current.keep_within(None):
        yield


@pytest.mark.thorough
@pytest.mark.usefixtures("thousandth_wrong")
def test_a_term_that_is_wrong_by_a_thousandth_breaks_the_laws():
    report = check_laws(sphere(), laws=["energy", "momentum", "jellett-rate", "jellett", "routh", "norm", "rolling"])
    assert not report.ok
    failing = {row.law for row in report.rows if not row.ok}
    assert failing == {"energy", "momentum", "jellett-rate", "jellett", "routh"}
    assert "Do not trust this run: energy fails" in str(report)


def test_a_failed_solve_is_the_reports_failure():
    report = check_laws(sphere(inertia=(0.1, 0.1, 0.9)), quick=True)
    assert not report.ok
    assert report.rows == ()
    assert "Do not trust this run: The solve did not start" in str(report)


@pytest.mark.slow
def test_a_disk_with_moving_masses_keeps_the_balances():
    report = check_laws(
        paper_disk(), np.linspace(0.0, 20.0, 21), laws=["energy", "momentum", "rolling", "norm", "routh"]
    )
    assert report.ok
    assert all(report[law].applies for law in ("energy", "momentum", "rolling"))
    assert "versor" in report["norm"].reason
    said(report["routh"].reason)


@pytest.mark.parametrize(
    ("arguments", "kind", "named"),
    [
        ({"times": [0.0, 1.0]}, ValueError, "times"),
        ({"laws": ["enrgy"]}, ValueError, "laws"),
    ],
)
def test_arguments_for_a_scenario(arguments, kind, named):
    with refuses(kind, named):
        check_laws(sphere(), **arguments)


def test_arguments_for_a_system():
    with refuses(ValueError, "times"):
        check_laws(paper_disk())
    with refuses(TypeError, "in_space"):
        check_laws(paper_ball(), TIMES, jaxball.physics.RotationState())


@pytest.mark.slow
def test_the_error_is_that_against_the_reference_of_thirty_digits():
    exact = reference.ball()
    case = Case(Scenario("", paper_ball(), jaxball.BallState(), np.asarray(exact.times)))
    names = ("q", "Omega", "z")
    states = np.concatenate([np.asarray(getattr(case.run.state, name)) for name in names], axis=1)
    true = np.concatenate([exact.columns(name) for name in names], axis=1)
    errors = np.max(np.abs(states - true) / case.weights[None], axis=1)
    np.testing.assert_allclose(case.errors.max(), errors.max(), rtol=0.01)


@pytest.mark.thorough
def test_the_difference_from_a_run_at_a_hundredth_of_the_tolerance_is_the_error():
    """By the 30-digit reference. The error falls with the tolerance, so the finer run has far less than a tenth."""
    exact = reference.ball()
    times = np.asarray(exact.times)
    finer = DEFAULT_TOLERANCE / 100
    run, again = (jaxball.simulate(paper_ball(), times, rtol=rtol, atol=rtol) for rtol in (DEFAULT_TOLERANCE, finer))
    z = np.asarray(run.state.z)
    true = np.linalg.norm(z - exact.columns("z"), axis=1)
    measured = np.linalg.norm(z - np.asarray(again.state.z), axis=1)
    assert true[1:].min() > 1e-13  # far above rounding
    np.testing.assert_allclose(measured[1:], true[1:], rtol=0.1)


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name in builtin_scenarios() if "\n[contact]" not in builtin_text(name)])
def test_every_built_in_scenario_that_always_rolls_keeps_every_law(name):
    report = check_laws(jaxball.load_scenario(name))
    assert report.ok, str(report)
    if isinstance(jaxball.load_scenario(name).system, jaxball.Ball | jaxball.Disk):
        assert {row.law for row in report.rows} | {*UNSAID} == {*LAWS}
