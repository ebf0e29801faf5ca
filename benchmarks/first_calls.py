"""What a user waits for before the first result, stage by stage, with nothing kept from earlier processes.

    python benchmarks/first_calls.py [--cases ball "contact ball"] [--json FILE]

Each row is a process of its own: a first run, or the first gradient of a loss under ``jaxball.jit``. The columns are
seconds of its processor time, so that other processes disturb them little: imports; JAX traces the functions, and
lowers them to StableHLO; the compiler reads that, writes LLVM's text, has LLVM make machine code of it, and loads that;
and the rest, in which JAX compiles what stands around, and the program runs. "programs" says how many were compiled.
"""

import collections
import contextlib
import functools
import json
import os
import subprocess
import sys
import time
from collections.abc import Callable
from typing import Any

import harness

STAGES = "imports", "tracing", "lowering", "reading", "writing", "LLVM", "loading", "rest"


def ball() -> tuple[Callable, Any]:
    """The paper's ball; the gradient by its angular velocity at the start."""
    import jax.numpy as jnp

    import jaxball

    body = jaxball.paper.ball()

    def run(Omega):
        return jaxball.simulate(body, (0.0, 2.0), jaxball.BallState(Omega=Omega)).state.z[-1].sum()

    return run, jnp.asarray([0.1, 0.2, 0.3])


def contact_disk() -> tuple[Callable, Any]:
    """A disk with an offset on a plane, on which it may slide and from which it may lift off."""
    import jax.numpy as jnp

    import jaxball

    body = jaxball.Disk(mass=1.0, inertia=0.4, offset=(0.0, 0.0, 0.2), gravity=9.81)
    law = jaxball.Contact(friction=0.3, restitution=0.5)

    def run(speed):
        start = jaxball.DiskState(phidot=speed)
        return jaxball.simulate(body, (0.0, 2.0), start, contact=law).state.z[-1]

    return run, jnp.asarray(-4.0)


def contact_ball() -> tuple[Callable, Any]:
    """The same of a ball."""
    import jax.numpy as jnp

    import jaxball

    body = jaxball.Ball(mass=1.0, inertia=(0.4, 0.45, 0.5), offset=(0.0, 0.0, -0.1), gravity=9.81)
    law = jaxball.Contact(friction=0.3, restitution=0.5)

    def run(Omega):
        start = jaxball.BallState(Omega=Omega)
        return jaxball.simulate(body, (0.0, 2.0), start, contact=law).state.z[-1].sum()

    return run, jnp.asarray([0.1, 4.0, 0.2])


def field() -> tuple[Callable, Any]:
    """A ball on hills."""
    import jax.numpy as jnp

    import jaxball

    body = jaxball.Ball(
        mass=1.0,
        inertia=(0.4, 0.45, 0.5),
        radius=0.1,
        gravity=9.81,
        ground=jaxball.HeightField(lambda t, x, y: 0.1 * jnp.sin(x) * jnp.cos(y)),
    )

    def run(Omega):
        return jaxball.simulate(body, (0.0, 2.0), jaxball.BallState(Omega=Omega)).state.z[-1].sum()

    return run, jnp.asarray([0.1, 4.0, 0.2])


def plate() -> tuple[Callable, Any]:
    """A ball on a plate that tilts, with sliding friction that acts against its spin as well."""
    import jax.numpy as jnp

    import jaxball
    from jaxball.physics import LimitSurface, ReleasedState, TiltingPlane

    body = jaxball.Ball(
        mass=1.0,
        inertia=(0.4, 0.45, 0.5),
        offset=(0.0, 0.0, -0.1),
        gravity=9.81,
        ground=TiltingPlane(about_e2=jaxball.ConstantRate(0.1)),
    )
    law = jaxball.Contact(LimitSurface(0.25, 0.1), restitution=0.3)

    def run(Omega):
        start = ReleasedState(jaxball.BallState(Omega=Omega), V=(-1.5, 0.7, 0.5))
        return jaxball.simulate(body, (0.0, 2.0), start, contact=law).state.z[-1].sum()

    return run, jnp.asarray([1.0, 3.0, 5.0])


def event() -> tuple[Callable, Any]:
    """When the paper's ball would slip."""
    import jax.numpy as jnp

    import jaxball

    body, events = jaxball.paper.ball(), {"slip": jaxball.Slip(0.1)}

    def run(Omega):
        return jaxball.simulate(body, (0.0, 2.0), jaxball.BallState(Omega=Omega), events=events).events["slip"].times[0]

    return run, jnp.asarray([0.1, 0.2, 0.3])


def extremes() -> tuple[Callable, Any]:
    """How much friction a disk with a driven pendulum needs, at most."""
    import jax.numpy as jnp

    import jaxball

    def run(mass):
        pendulum = jaxball.planar_pendulum(mass, 0.4, drive=jaxball.Motor(0.1) + jaxball.Damper(0.02))
        body = jaxball.Disk(mass=1.0, inertia=0.5, gravity=2.0, mechanisms=[pendulum])
        start = jaxball.DiskState(theta=[0.2], thetadot=[0.0])
        return jaxball.contact_extremes(jaxball.simulate(body, (0.0, 2.0), start, dense=True)).friction_needed

    return run, jnp.asarray(0.3)


CASES = {
    "ball": ball,
    "contact disk": contact_disk,
    "contact ball": contact_ball,
    "field": field,
    "plate": plate,
    "event": event,
    "extremes": extremes,
}
KINDS = "run", "gradient"


class _Clock:
    """Processor time by stages, of which the innermost counts."""

    def __init__(self) -> None:
        self.spent: dict[str, float] = collections.defaultdict(float)
        self.stack, self.since = ["rest"], time.process_time()
        self.programs = 0

    @contextlib.contextmanager
    def stage(self, name: str):
        self._note()
        self.stack.append(name)
        try:
            yield
        finally:
            self._note()
            self.stack.pop()

    def _note(self) -> None:
        now = time.process_time()
        self.spent[self.stack[-1]] += now - self.since
        self.since = now

    def watch(self, place: Any, name: str, stage: str) -> None:
        """Counts the time of a function, or of a cached property, as that of a stage."""
        found = vars(place)[name] if isinstance(place, type) else getattr(place, name)
        inner = found.func if isinstance(found, functools.cached_property) else found

        @functools.wraps(inner)
        def watched(*args, **kwargs):
            self.programs += stage == "LLVM"
            with self.stage(stage):
                return inner(*args, **kwargs)

        if isinstance(found, functools.cached_property):
            found.func = watched
        else:
            setattr(place, name, watched)


def measure(case: str, kind: str) -> dict[str, float]:
    """The seconds of each stage, in this process, which must be a new one."""
    clock = _Clock()
    with clock.stage("imports"):
        harness.set_up_jax(cpu_settings=False)
        import jax

        import jaxball
        from jaxball.programs.native import executable, pipeline, tracing

        for name in ("simulate", "jit", "Contact", "HeightField", "Slip"):
            getattr(jaxball, name)
    clock.watch(tracing.Lowered, "trace", "tracing")
    clock.watch(tracing.Lowered, "_lower", "lowering")
    clock.watch(pipeline, "read_functions", "reading")
    clock.watch(pipeline, "emit", "writing")
    clock.watch(pipeline, "cpu_text", "writing")
    clock.watch(pipeline, "object_code", "LLVM")
    clock.watch(executable.Code, "__init__", "loading")
    run, argument = CASES[case]()
    call = run if kind == "run" else jaxball.jit(jax.grad(run))
    jax.block_until_ready(call(argument))
    clock._note()
    return {**{stage: clock.spent[stage] for stage in STAGES}, "programs": clock.programs}


def main() -> None:
    parser = harness.parser(__doc__ or "")
    parser.add_argument("--cases", nargs="+", choices=list(CASES), default=list(CASES))
    parser.add_argument("--kinds", nargs="+", choices=KINDS, default=list(KINDS))
    parser.add_argument("--alone", action="store_true", help="measure the one case in this process and print JSON")
    options = parser.parse_args()
    if options.alone:
        print(json.dumps(measure(options.cases[0], options.kinds[0])))
        return
    print(f"{'':24}" + "".join(f"{stage:>10}" for stage in (*STAGES, "programs", "sum")))
    rows = []
    for case in options.cases:
        for kind in options.kinds:
            command = [sys.executable, __file__, "--alone", "--cases", case, "--kinds", kind]
            environment = {**os.environ, "JAXBALL_NO_CACHE": "1"}
            found = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
            row = json.loads(found.stdout.splitlines()[-1])
            rows.append({"case": case, "kind": kind, **row})
            numbers = [row[stage] for stage in STAGES]
            print(
                f"{case + ', ' + kind:24}" + "".join(f"{n:10.2f}" for n in numbers) + f"{row['programs']:10d}"
                f"{sum(numbers):10.2f}",
                flush=True,
            )
    harness.write_json(options.json, {"benchmark": "first calls", **harness.description(), "rows": rows})


if __name__ == "__main__":
    main()
