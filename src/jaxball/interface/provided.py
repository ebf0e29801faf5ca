"""Lets a class declare methods whose functions a higher package provides, so that the class does not import it.

``Trajectory`` declares its methods to save, draw and view a run in this way, and ``methods`` provides them.
"""

from collections.abc import Callable

TYPE_CHECKING = False  # as in jaxball/__init__.py, which imports this module

if TYPE_CHECKING:
    from typing import TypeVar

    Method = TypeVar("Method", bound=Callable[..., object])
else:
    Method = Callable

_functions: dict[str, Callable[..., object]] = {}  # by the qualified names of the methods


def leave_to_above(method: Method) -> Method:
    """Makes a method that calls the function provided for it; its class has the signature and the docstring."""
    import functools  # here, because it would double the time to import jaxball

    @functools.wraps(method)
    def call(*args: object, **options: object) -> object:
        return _functions[method.__qualname__](*args, **options)

    return call  # pyright: ignore[reportReturnType]


def provide(class_name: str, *functions: Callable[..., object]) -> None:
    """Provides functions, which import what they need when called, for the methods of a class that have their names."""
    _functions.update({f"{class_name}.{function.__name__}": function for function in functions})
