"""Parameters of a ball estimated from a recorded path: a mass, a radius and an offset with their uncertainties."""

import tomllib

import jax
import numpy as np

jax.config.update("jax_enable_x64", True)

from jaxball.files.scenario.sources import builtin_text  # noqa: E402
from jaxball.studies.design import DesignSpace, Variable  # noqa: E402

document = tomllib.loads(builtin_text("ball"))
document["time"] = {"start": 0.0, "end": 10.0, "saves": 201}
truth = {"masses[0].mass": 1.0, "masses[1].rail.radius": 0.9, "body.offset[2]": -0.05}

space = DesignSpace(document, [Variable((path,), start=1.04 * value) for path, value in truth.items()])
path = np.asarray(space.scenario.simulate().state.z)
noise = 1e-3 * np.random.default_rng(7).normal(size=path.shape)

fit = space.identify(path + noise)
print(fit)
for (name, value), (low, high) in zip(truth.items(), fit.intervals(0.99), strict=True):
    print(f"{name:24} {value:6.3f} in {low:.4f} to {high:.4f}: {low < value < high}")
    assert low < value < high
