"""The compiler is a guest: taken out of jaxball, under another name, it compiles what knows nothing of balls."""

import shutil
from pathlib import Path

import pytest

from tests.support.scripts import printed_by

SOURCE = Path(__file__).parents[2] / "src/jaxball"
# As its README says; that these import nothing else, `lint-imports` holds.
TAKEN = ("programs", "interface")

PENDULUM = """
import sys

sys.modules["jaxball"] = None  # wherever it is installed, an import of it fails

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
from scipy.special import ellipk

from guest.programs.native import compiler
from guest.programs.users_functions import jit

jax.config.update("jax_enable_x64", True)
ANGLE, END = 1.2, 3.0
TOLERANCE = 1e-10


def swing(t, y, length):
    return jnp.stack([y[1], -9.81 / length * jnp.sin(y[0])])


def end(length, time=END):
    run = diffrax.diffeqsolve(
        diffrax.ODETerm(swing), diffrax.Dopri8(), 0.0, time, 0.1, jnp.array([ANGLE, 0.0]), args=length,
        stepsize_controller=diffrax.PIDController(rtol=TOLERANCE, atol=TOLERANCE),
    )
    return run.ys[-1]


lengths = jnp.linspace(0.5, 2.0, 7)
gradient = jax.grad(lambda length: end(length)[0])
with compiler("native"):  # which warns where XLA would compile a program
    for function, argument in [(end, 1.0), (gradient, 1.0), (jax.vmap(end), lengths), (jax.vmap(gradient), lengths)]:
        np.testing.assert_allclose(jit(function)(argument), jax.jit(function)(argument), rtol=1e-10, atol=1e-10)
    period = 4 * np.sqrt(1 / 9.81) * ellipk(np.sin(ANGLE / 2) ** 2)  # Legendre's
    np.testing.assert_allclose(jit(end)(1.0, period), [ANGLE, 0.0], atol=1e-8)
assert not [name for name in sys.modules if name.startswith("jaxball")][1:]
"""


@pytest.mark.thorough
def test_a_pendulum_of_diffrax_by_the_compiler_alone(tmp_path):
    pytest.importorskip("llvmlite")
    package = tmp_path / "guest"
    package.mkdir()
    (package / "__init__.py").touch()
    for name in TAKEN:
        copy = shutil.copytree if (SOURCE / name).is_dir() else shutil.copy
        copy(SOURCE / name, package / name)
    (tmp_path / "pendulum.py").write_text(PENDULUM)
    printed_by("-W", "error", "pendulum.py", cwd=tmp_path, env={"PATH": ""}, timeout=300)
