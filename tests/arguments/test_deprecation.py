"""Old names work, give what the new ones give, and warn at the line that uses them, once where Python shows it once."""

import inspect
import sys
import types
import warnings

import equinox as eqx
import pytest

from jaxball.interface.deprecation import OldAttribute, keep_old_argument, keep_old_names, removal


class Wheel(eqx.Module):
    """A class as those of jaxball are: its ``__init__`` is made from its fields, and equinox calls it."""

    width: float
    radius: float = 1.0

    @property
    def volume(self):
        return self.width * self.radius**2

    contents = OldAttribute("volume", since="0.2")


class Tyre(Wheel):
    @property
    def volume(self):
        return 7.0


@keep_old_argument("thickness", "width", since="0.2")
class Roller(eqx.Module):
    width: float
    radius: float = 1.0


@keep_old_argument("speed", "rate", since="1.4")
def roll(body, rate=2.0):
    return body, rate


@pytest.fixture
def package(monkeypatch):
    """A package of which ``Sphere`` was renamed to ``Ball``, and which has a ``__getattr__`` of its own."""
    module = types.ModuleType("rollers")

    def load(name):
        if name == "late":
            return 3
        raise AttributeError(name)

    module.Ball = Roller
    module.__getattr__ = keep_old_names("rollers", {"Sphere": "Ball"}, since="0.2", load=load)
    monkeypatch.setitem(sys.modules, "rollers", module)
    return module


def warned(function):
    """What ``function`` returns, and the only warning that it gives."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        value = function()
    (warning,) = caught
    assert warning.category is DeprecationWarning
    assert warning.filename == __file__
    return value, warning


def line_of(function):
    """The number of the first line of a function of one line."""
    return function.__code__.co_firstlineno


def test_an_old_name_is_the_new_object(package):
    use = lambda: package.Sphere  # noqa: E731
    value, warning = warned(use)
    assert value is Roller
    assert warning.lineno == line_of(use)
    assert str(warning.message) == (
        "rollers.Sphere is deprecated since jaxball 0.2, and will be removed in 0.4; use rollers.Ball."
    )


def test_new_names_and_those_of_the_package_do_not_warn(package):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert package.Ball is Roller
        assert package.late == 3
        with pytest.raises(AttributeError, match="Cube"):
            _ = package.Cube


def test_a_package_without_a_getattr_says_which_name_it_lacks(monkeypatch):
    module = types.ModuleType("rollers")
    module.__getattr__ = keep_old_names("rollers", {"Sphere": "Ball"}, since="0.2")
    monkeypatch.setitem(sys.modules, "rollers", module)
    with pytest.raises(AttributeError, match="module 'rollers' has no attribute 'Cube'"):
        _ = module.Cube


def test_importing_an_old_name_warns_at_the_import(package):
    program = "\n\nfrom rollers import Sphere\n"
    with pytest.warns(DeprecationWarning, match=r"use rollers\.Ball") as caught:
        exec(compile(program, "script", "exec"), {"__name__": "script"})
    assert {(warning.filename, warning.lineno) for warning in caught} == {("script", 3)}


def test_an_old_argument_of_a_function_is_the_new_one():
    use = lambda: roll("ball", speed=5.0)  # noqa: E731
    value, warning = warned(use)
    assert value == ("ball", 5.0)
    assert warning.lineno == line_of(use)
    assert str(warning.message) == (
        "Argument `speed` of roll is deprecated since jaxball 1.4, and will be removed in 1.6; use `rate`."
    )


def test_an_old_argument_of_a_class_warns_at_the_users_line_and_not_at_that_of_equinox():
    use = lambda: Roller(thickness=5.0)  # noqa: E731
    value, warning = warned(use)
    assert (value.width, value.radius) == (5.0, 1.0)
    assert warning.lineno == line_of(use)
    assert "Argument `thickness` of Roller is deprecated" in str(warning.message)


def test_a_call_through_jaxball_is_blamed_on_who_called_it():
    """A caller that belongs to jaxball is passed over: its user cannot see that line."""
    inside = {"__name__": "jaxball.somewhere", "roll": roll}
    exec("def call():\n    return roll('ball', speed=5.0)", inside)
    use = lambda: inside["call"]()  # noqa: E731
    _, warning = warned(use)
    assert warning.lineno == line_of(use)


def test_new_names_and_places_do_not_warn():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert roll("ball", rate=5.0) == roll("ball", 5.0) == ("ball", 5.0)
        assert Roller(5.0, radius=3.0).radius == 3.0


def test_the_signature_has_the_new_name_alone():
    assert list(inspect.signature(roll).parameters) == ["body", "rate"]
    assert list(inspect.signature(Roller).parameters) == ["width", "radius"]


def test_both_names_are_refused():
    with pytest.raises(TypeError, match="roll got `speed` and `rate`, which are one argument; give `rate` alone"):
        roll("ball", rate=1.0, speed=2.0)


def test_a_wrong_decoration_is_refused_where_it_stands():
    with pytest.raises(ValueError, match="`new` must be an argument of roll, but it is 'pace'"):
        keep_old_argument("velocity", "pace", since="0.2")(roll)
    with pytest.raises(ValueError, match="`old` must be no argument of roll, but it is 'body'"):
        keep_old_argument("body", "rate", since="0.2")(roll)


def test_an_old_attribute_is_read_through_the_new_one():
    use = lambda: Wheel(2.0, 3.0).contents  # noqa: E731
    value, warning = warned(use)
    assert value == 18.0
    assert warning.lineno == line_of(use)
    assert str(warning.message) == (
        "Wheel.contents is deprecated since jaxball 0.2, and will be removed in 0.4; use Wheel.volume."
    )
    assert warned(lambda: Tyre(2.0).contents)[0] == 7.0


def test_python_shows_it_once_for_each_line():
    """As with any deprecation: a loop does not repeat it, another line does."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("default")
        for _ in range(3):
            roll("ball", speed=5.0)
        roll("ball", speed=5.0)
    assert len(caught) == 2


@pytest.mark.parametrize(("since", "until"), [("0.2", "0.4"), ("0.9", "0.11"), ("1.0", "1.2")])
def test_two_minor_releases_warn(since, until):
    assert removal(since) == until
