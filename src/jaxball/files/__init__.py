"""Whatever is read and written: scenarios, results, and robots as files of MuJoCo and of ROS."""

TYPE_CHECKING = False

if TYPE_CHECKING:  # for type checkers and editors, the same interface
    from . import mjcf as mjcf, results as results, scenario as scenario, urdf as urdf
else:
    from ..interface.names import lazy_interface

    __all__, __dir__, __getattr__ = lazy_interface(__name__)
