"""The units of a scenario in files of runs, figures and views."""

import re
import tomllib

import numpy as np
import pyarrow.parquet
import pytest
import xarray

from jaxball import ScenarioError, load_run, read_scenario, write_scenario
from jaxball.files.scenario import Units
from jaxball.files.scenario.sources import builtin_text
from jaxball.numerics.declare import OF_MASS
from jaxball.plot import time_series
from jaxball.plot.sweeps.rows import label_of
from jaxball.simulation import variables
from jaxball.studies.design import DesignSpace, Variable
from jaxball.studies.design.problem.space import default_scale
from jaxball.studies.design.report import with_unit
from jaxball.studies.sweep import open_store
from tests.scenario.documents import DISK
from tests.support.sentences import refuses
from tests.sweep.studies import pretend, study

SI = '[units]\nlength = "m"\nmass = "kg"\ntime = "s"\n'
# As UDUNITS reads them: names and whole powers, with a space for a product.
UNIT = r"1|rad|(rad )?[A-Za-z]+(\^-?\d+)?( [A-Za-z]+(\^-?\d+)?)*"


def stating(units):
    """The disk of the paper with a table of units."""
    return read_scenario(builtin_text("disk") + units)


def test_every_variable_of_a_run_has_a_unit(tmp_path):
    path = stating(SI).simulate().save(tmp_path / "run.nc")
    with xarray.open_dataset(path, engine="h5netcdf") as saved:
        assert saved.attrs["Conventions"] == "CF-1.11"
        units = {name: variable.attrs.get("units") for name, variable in saved.variables.items()}
        assert units["normal_force"] == "N"
        assert units["phidot"] == "rad s^-1"
        assert units["energy"] == "J"
        assert units["time"] == "s"
        assert units["z"] == "m"
        labelled = {name for name in saved.variables if name not in saved.dims or name == "time"}
        assert all(saved[name].attrs.get("comment") for name in labelled if not units[name])
        for unit in filter(None, units.values()):
            assert re.fullmatch(UNIT, unit), unit


def test_a_run_that_is_read_knows_its_units(tmp_path):
    run = load_run(stating(SI).simulate().save(tmp_path / "run.nc"))
    assert run.scenario.units == Units("m", "kg", "s")
    assert read_scenario(write_scenario(run.scenario)).units == run.scenario.units


def test_axes_of_figures_have_the_units_that_are_stated():
    run = read_scenario(builtin_text("draw-shot")).simulate()
    figures = (
        time_series.contact_force,
        time_series.slip_speed,
        time_series.centre_velocity,
        time_series.energies,
        time_series.angular_velocity,
    )
    labels = {draw.__name__: (ax.get_xlabel(), ax.get_ylabel()) for draw in figures for ax in [draw(run)]}
    assert {across for across, _ in labels.values()} == {"$t$ (s)"}
    assert {name: up for name, (_, up) in labels.items()} == {
        "contact_force": "contact force (N)",
        "slip_speed": r"$|\,\mathbf{v}_s|$ (m s$^{-1}$)",
        "centre_velocity": "$V_i$ (m s$^{-1}$)",
        "energies": "energy (J)",
        "angular_velocity": r"$\Omega_i$ (rad s$^{-1}$)",
    }
    unstated = stating("").simulate()
    assert unstated.plot("contact_force").get_ylabel() == "contact force"


def test_without_the_table_nothing_changes(tmp_path):
    scenario = stating("")
    assert scenario.units is None
    assert "units" not in write_scenario(scenario)
    with xarray.open_dataset(scenario.simulate().save(tmp_path / "run.nc"), engine="h5netcdf") as saved:
        assert saved.normal_force.attrs["units"] == "force"
        assert "Conventions" not in saved.attrs


def test_dimensionless_numbers():
    scenario = read_scenario('units = "dimensionless"\n' + builtin_text("disk"))
    assert str(scenario.units) == "dimensionless"
    assert scenario.units.of("force") == scenario.units.of("length/time") == "1"
    assert read_scenario(write_scenario(scenario)).units.is_dimensionless


def test_units_that_are_not_si():
    units = Units("cm", "g", "s")
    assert units.of("energy") == "g cm^2 s^-2"
    assert units.of("angular momentum * length") == "g cm^3 s^-1"
    assert units.of("rad/time^2") == "rad s^-2"
    assert units.of("torque or force") == units.of("") == ""
    assert units.of("V") == "V"  # of a sensor of one's own


def test_every_dimension_that_variables_have_is_known():
    tables = (getattr(variables, name) for name in dir(variables) if name.isupper())
    known = [v for table in tables if isinstance(table, dict) for v in table.values() if hasattr(v, "units")]
    assert len(known) > 50
    for variable in known:
        unit = Units("m", "kg", "s").of(variable.units)
        assert unit != variable.units or unit in ("", "1", "rad")


def test_figures_and_views_name_the_units():
    run = stating(SI).simulate()
    assert "in m, kg, s" in run.plot().get_suptitle()
    assert "in m, kg, s" in run.view().html


def test_a_study_of_the_scenario_has_its_units(tmp_path):
    units = 'units = { length = "m", mass = "kg", time = "s" }\n'
    rolling = study(tmp_path, scenario=units + DISK)
    with open_store(rolling.run(tmp_path / "s.zarr", engine=pretend).store).dataset() as data:
        assert data.phidot.attrs["units"] == "rad s^-1"
        assert data.reached.attrs["units"] == "s"
        assert data.z.attrs["units"] == "m"
        assert label_of(data, "phidot").endswith("(rad s$^{-1}$)")
        assert data["body.mass"].attrs["units"] == "kg"
        assert data["body.gravity"].attrs["units"] == "m s^-2"
    schema = pyarrow.parquet.read_schema(tmp_path / "s.parquet")
    units_of = {field.name: (field.metadata or {}).get(b"units", b"").decode() for field in schema}
    wanted = {"body.mass": "kg", "body.gravity": "m s^-2", "phidot": "rad s^-1", "row": ""}
    assert {name: units_of[name] for name in wanted} == wanted


def test_without_units_the_columns_of_a_table_have_none(tmp_path):
    study(tmp_path).run(tmp_path / "s.zarr", engine=pretend)
    assert all(field.metadata is None for field in pyarrow.parquet.read_schema(tmp_path / "s.parquet"))


def test_variables_and_values_of_a_design_have_units():
    variables = [Variable(("body.mass",), 0.5, 2.0), Variable(("time.end",), 1.0, 9.0)]
    stated = DesignSpace(tomllib.loads(DISK + SI), variables)
    assert stated.unit_of == {"body.mass": " kg", "time.end": " s"}
    plain = DesignSpace(tomllib.loads(DISK), variables)
    assert set(plain.unit_of.values()) == {""}
    np.testing.assert_array_equal(stated.bounds.scale, plain.bounds.scale)
    assert default_scale(OF_MASS, 7.0, plain.scenario.system) == default_scale(None, 7.0, plain.scenario.system) == 7.0
    units = Units("m", "kg", "s")
    assert with_unit("largest distance 0.4", units) == "largest distance 0.4 m"
    assert with_unit("time 1.2e-05", units) == "time 1.2e-05 s"
    for text in ("angle 0.4 rad", "", "a distance, unknown"):
        assert with_unit(text, units) == text
    assert with_unit("time 2", None) == with_unit("time 2", Units()) == "time 2"


@pytest.mark.parametrize(
    ("table", "named"),
    [
        ('[units]\nlength = "m"\nmass = "kg"\n', "units.time"),
        ('[units]\nlength = "m^2"\nmass = "kg"\ntime = "s"\n', "units.length"),
        ('[units]\nlength = 1.0\nmass = "kg"\ntime = "s"\n', "units.length"),
        ('[units]\nlength = "m"\nmass = "s"\ntime = "kg"\n', "units.mass"),
    ],
)
def test_a_wrong_table_is_a_sentence(table, named):
    with refuses(ScenarioError, named):
        stating(table)
