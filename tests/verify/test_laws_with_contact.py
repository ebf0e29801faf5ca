"""The laws checked on runs of bodies that slip, fly and bounce: which apply, and that they hold."""

import jax.numpy as jnp
import numpy as np
import pytest

from jaxball import (
    Ball,
    BallState,
    Bowl,
    Contact,
    Disk,
    DiskState,
    FunctionSchedule,
    OnRail,
    PointMass,
    Resistance,
    Tube,
    simulate,
)
from jaxball.analysis.verify import check_laws
from jaxball.physics import ReleasedState

TIMES = np.linspace(0.0, 12.0, 13)
HOOP = ReleasedState(DiskState(phidot=5.0), V=(1.0, 0.0, 0.0), height=0.5)  # it lands at 1, one of the times


@pytest.mark.thorough
def test_laws_of_a_hoop_with_backspin():
    """It bounces, slips and rolls; its embedding in space does, too."""
    law = Contact(friction=0.25, restitution=0.5, slowest=0.01)
    report = check_laws(Disk(mass=1.0, inertia=0.5), TIMES, HOOP, contact=law)
    assert report.ok, str(report)
    applying = {row.law for row in report.rows if row.applies}
    momenta = {"momentum", "chaplygin"}
    assert applying == {"energy", "contact", "error", "convergence", "solvers", "embedding"} | momenta
    assert report["energy"].residual < 1e-9
    assert report["momentum"].residual < 1e-9
    assert report["jellett"].reason.startswith("a disk rolls in a plane")
    assert report["rolling"].reason == "the body has a law of contact"
    assert report["estimate"].reason.startswith("a saved time is that of an impact")
    between = check_laws(Disk(mass=1.0, inertia=0.5), TIMES + 0.1 * (TIMES > 0), HOOP, contact=law, laws=["estimate"])
    assert between["estimate"].applies
    assert between.ok, str(between)
    run = simulate(Disk(mass=1.0, inertia=0.5), TIMES, HOOP, contact=law)
    assert run.contact.friction_loss[-1] > 1  # which the law accounts for


@pytest.mark.long
def test_energy_of_a_ball_that_bounces_and_comes_to_rest_in_a_bowl():
    bowl = Ball(
        mass=2.0,
        radius=0.3,
        inertia=(0.07, 0.07, 0.08),
        gravity=9.81,
        ground=Bowl(2.0),
        resistance=Resistance(dry=0.12, exact=True),
    )
    thrown = ReleasedState(BallState(z=(0.5, 0.1), Omega=(1.0, 2.0, 3.0)), V=(0.6, 0.8, 0.0), height=0.2)
    law = Contact(0.2, restitution=0.4, slowest=0.1)
    report = check_laws(bowl, np.linspace(0.0, 4.0, 9), thrown, contact=law, laws=["energy", "norm", "contact"])
    assert report.ok, str(report)
    assert report["energy"].residual < 1e-7


@pytest.mark.thorough
def test_the_energy_does_not_balance_where_a_schedule_does_work_in_an_impact():
    swing = FunctionSchedule(lambda t, _: 0.3 * np.pi * t)
    ball = Ball(mass=1.0, inertia=(0.4,) * 3, masses=[PointMass(0.3, OnRail(Tube(direction=(0.0, 0.0, 1.0)), swing))])
    thrown = ReleasedState(BallState(), height=0.1)
    report = check_laws(ball, [0.0, 0.5, 0.8], thrown, contact=Contact(0.2), laws=["energy"])
    assert report["energy"].reason == "what is moved by schedules or a law does work in impacts"


@pytest.mark.long
def test_momenta_of_a_top_that_is_thrown_slips_and_rolls():
    """Jellett's integral, and both balances of momentum, hold through strikes, slip and rolling; Routh's does not."""
    top = Ball(mass=1.0, inertia=(0.4, 0.4, 0.5), gravity=9.81, offset=(0.0, 0.0, -0.1))
    thrown = ReleasedState(BallState(Omega=(0.5, 2.0, 8.0)), V=(0.6, 0.3, 0.0), height=0.1)
    laws = ["energy", "momentum", "chaplygin", "jellett-rate", "jellett", "routh"]
    report = check_laws(top, np.linspace(0.0, 1.0, 5), thrown, contact=Contact(0.2, restitution=0.5), laws=laws)
    assert report.ok, str(report)
    for name in ("momentum", "jellett-rate", "jellett"):
        assert report[name].applies
        assert report[name].residual < 1e-9
    assert report["chaplygin"].residual > 1e-3
    assert report["chaplygin"].reason.startswith("the centre of mass is")
    assert report["routh"].reason == "the body has a law of contact"


@pytest.mark.long
def test_momentum_of_a_ball_with_a_moving_mass_on_a_surface():
    """A schedule does work in impacts, but has no moment about the contact point."""
    swing = FunctionSchedule(lambda t, _: 0.2 * jnp.sin(3 * t))
    inside = [PointMass(0.1, OnRail(Tube(direction=(0.0, 0.3, 1.0)), swing))]
    ball = Ball(mass=1.0, radius=0.3, inertia=(0.07, 0.07, 0.08), gravity=9.81, ground=Bowl(2.0), masses=inside)
    thrown = ReleasedState(BallState(z=(0.5, 0.1), Omega=(1.0, 2.0, 3.0)), V=(0.6, 0.8, 0.0), height=0.2)
    law = Contact(0.2, restitution=0.4, slowest=0.1)
    report = check_laws(ball, np.linspace(0.0, 1.0, 5), thrown, contact=law, laws=["energy", "momentum"])
    assert report.ok, str(report)
    assert report["momentum"].residual < 1e-7
    assert not report["energy"].applies
