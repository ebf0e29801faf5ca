"""A smooth convex body that rolls on a plane, with all that a ball may have inside: an egg, an ellipsoid, a rattleback.

Its equations are those of the ball with another arm: from the contact to the geometric centre the body has ∇h(Γ) in the
place of rΓ, and where that changes in space the centre has an acceleration more, ω × the arm's rate, as on a surface.
"""

from collections.abc import Iterator, Sequence
from typing import Any, ClassVar

import equinox as eqx

from ..interface.arguments import require
from ..numerics.arrays import Numbers
from .body import AbstractBody, Ball
from .conditions import Condition
from .dynamics.parameters import BodyParameters, PointMass
from .feedback import AbstractLaw
from .forces.force import AbstractWrench
from .forces.resistance import AbstractResistance
from .grounds.ground import Ground
from .mechanisms import AbstractMechanism
from .own_states import OwnStates
from .shape import AbstractShape
from .state import BallState, ReducedState, RotationState


class ConvexBody(AbstractBody):
    """A smooth convex body with point masses inside, rolling without slipping on a plane.

    **Arguments:**

    - ``shape``: its surface. An :class:`~jaxball.physics.Ellipsoid`, or any by a
      :class:`~jaxball.physics.SupportFunction`.
    - ``mass``, ``inertia``, ``offset``, ``gravity``, ``force``, ``masses``, ``law``, ``mechanisms``, ``resistance`` and
      ``own_states``: as for a :class:`~jaxball.Ball`. The radius by which dry friction is multiplied is the height of
      the geometric centre over the plane.
    - ``ground``: a :class:`~jaxball.Ground` without a turntable, or None. On a curved one the contact would have to be
      searched for.

    Its states are those of a ball. The plane is where it is under a ball whose ``radius`` is how far the surface gets
    from the centre; masses are checked to be within that distance, not within the surface.

    **Raises:** as for a :class:`~jaxball.Ball`; ``TypeError`` for a surface as ``ground``, ``ValueError`` for a
    turntable. That ``shape`` is convex is checked as other values are; see :func:`jaxball.problems`.

    **Source:** J. I. Neimark & N. A. Fufaev, *Dynamics of Nonholonomic Systems*, American Mathematical Society 1972,
    chapter 3, for a body of any convex surface.

    **Example:**

    >>> from jaxball import BallState, ConvexBody, simulate
    >>> from jaxball.physics import Ellipsoid
    >>> egg = ConvexBody(shape=Ellipsoid((1.0, 1.0, 1.5)), mass=1.0, inertia=(0.65, 0.65, 0.4))
    >>> lying = BallState(q=(0.5**0.5, 0.5**0.5, 0.0, 0.0), Omega=(0.0, 0.0, 1.0))
    >>> round(float(simulate(egg, [0.0, 2.0], lying).state.z[-1, 0]), 6)  # it rolls about its long axis
    -2.0
    """

    shape: AbstractShape = eqx.field()  # pyright: ignore

    title: ClassVar[str] = "convex body"
    state_type: ClassVar[Any] = BallState
    other_state_types: ClassVar[tuple[Any, ...]] = (RotationState, ReducedState)
    derived: ClassVar[tuple[str, ...]] = ("radius",)

    def __init__(
        self,
        *,
        shape: AbstractShape,
        mass: Numbers,
        inertia: Numbers,
        offset: Numbers = (0.0, 0.0, 0.0),
        gravity: Numbers = 1.0,
        force: AbstractWrench | None = None,
        masses: Sequence[PointMass] = (),
        law: AbstractLaw | None = None,
        mechanisms: Sequence[AbstractMechanism] = (),
        ground: Ground | None = None,
        resistance: AbstractResistance | None = None,
        own_states: OwnStates | None = None,
    ):
        require("shape", shape, AbstractShape, "a shape, such as Ellipsoid((1.0, 1.0, 1.5))")
        require("ground", ground, (Ground, type(None)), "a Ground or None under a body that is no ball")
        if ground is not None and ground.turntable is not None:
            raise ValueError(
                "Argument `ground` must have no turntable under a ConvexBody, whose contact point is not under its "
                "centre; use a Ball."
            )
        self.shape = shape  # pyright: ignore
        BodyParameters.__init__(
            self,
            mass=mass,
            inertia=inertia,
            radius=shape.extent(),
            offset=offset,
            gravity=gravity,
            force=force,
            masses=masses,
            law=law,
            mechanisms=mechanisms,
            ground=ground,
            resistance=resistance,
            own_states=own_states,
        )

    require_state, is_reducible, phase_point = Ball.require_state, Ball.is_reducible, Ball.phase_point

    def conditions(self) -> Iterator[Condition]:
        yield from self.shape.conditions()  # first, because the radius follows from it
        yield from AbstractBody.conditions(self)

    @property
    def arguments(self) -> dict[str, Any]:
        others = {name: value for name, value in super().arguments.items() if name not in self.derived}
        return {"shape": self.shape, **others}
