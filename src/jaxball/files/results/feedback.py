"""A run under feedback in a file: the motion that it holds, its inputs, and what was estimated."""

import dataclasses
from collections.abc import Mapping
from typing import Any

import jax.numpy as jnp
import numpy as np

from ...control.estimation.estimate import Belief, Followed, LoopEstimate
from ...control.history import FeedbackHistory
from ...numerics.arrays import arrays_of, to_array
from ...physics.hybrid import AbstractHistory
from ...simulation.variables import Variable
from .variables import Variables, describe_fields, history_attributes, history_values

INPUTS, BIASES = "feedback_inputs", "estimate_biases"  # attributes that tell such runs, with names one after the other
BETWEEN = ", "
OF_FEEDBACK = {
    "inputs": Variable(("input",), "of effort or acceleration", "input from this time on"),
    "deviation": Variable(("coordinate",), "of the state", "local coordinate of the state around the motion"),
}
OF_ESTIMATE = {
    "covariance": Variable(("error", "error_beside"), "of the errors", "covariance of the errors of the estimate"),
    "bias": Variable(("bias",), "of the reading", "estimated bias of a sensor"),
    "nis": Variable((), "1", "normalised innovation squared"),
    "read": Variable((), "1", "number of readings"),
    "nees": Variable((), "1", "normalised estimation error squared"),
}


@history_values.register
def _of_feedback(history: FeedbackHistory, states: Any) -> Variables:
    variables = history_values(history.modes, states) | _of_states("nominal", "of the motion", history.nominal)
    variables["inputs"] = OF_FEEDBACK["inputs"], np.asarray(history.u)
    variables["deviation"] = OF_FEEDBACK["deviation"], np.asarray(history.deviations(states))
    if history.estimate is None:
        return variables
    estimate = history.estimate
    arrays = {"covariance": estimate.covariance, "bias": estimate.bias_values}
    arrays |= {"nis": estimate.nis, "read": estimate.read, "nees": estimate.nees(states)}
    variables |= _of_states("estimate", "as estimated", estimate.state)
    return variables | {
        f"estimate_{name}": (OF_ESTIMATE[name], np.asarray(array)) for name, array in arrays.items() if array.size
    }


def _of_states(prefix: str, words: str, states: Any) -> Variables:
    descriptions = describe_fields(states)
    return {
        f"{prefix}_{name}": (
            descriptions[name]._replace(meaning=f"{descriptions[name].meaning}, {words}"),
            np.asarray(leaf),
        )
        for name, leaf in arrays_of(states).items()
    }


@history_attributes.register
def _names(history: FeedbackHistory) -> dict[str, Any]:
    names: dict[str, Any] = {INPUTS: BETWEEN.join(history.inputs)} | history_attributes(history.modes)
    return names if history.estimate is None else names | {BIASES: BETWEEN.join(history.estimate.biases)}


def feedback_labels(history: AbstractHistory) -> dict[str, np.ndarray]:
    """Returns the names along the dimensions of feedback."""
    if not isinstance(history, FeedbackHistory):
        return {}
    labels = {"input": history.inputs, "coordinate": history.directions}
    if history.estimate is not None:
        errors = (*history.estimate.directions, *history.estimate.biases)
        labels |= {"error": errors, "error_beside": errors, "bias": history.estimate.biases}
    return {name: np.asarray(names) for name, names in labels.items() if names}


def read_feedback(
    about: Mapping[str, Any], arrays: Mapping[str, np.ndarray], states: Any, modes: AbstractHistory
) -> FeedbackHistory:
    """Reads the history of a run under feedback from a file with the attributes ``about``, the arrays, the ``states``
    and the history of the body's ``modes``.
    """

    def of(prefix: str) -> Any:
        return type(states)(**{name: to_array(arrays[f"{prefix}_{name}"]) for name in arrays_of(states)})

    u, inputs = to_array(arrays["inputs"]), names_in(about, INPUTS)
    history = FeedbackHistory(modes, of("nominal"), u, None, inputs)
    if BIASES not in about:
        return history
    times, biases = to_array(arrays["time"]), names_in(about, BIASES)
    fields = {name: arrays.get(f"estimate_{name}", np.zeros((times.size, 0))) for name in OF_ESTIMATE}
    bias, P, nis = (to_array(fields[name]) for name in ("bias", "covariance", "nis"))
    read = jnp.asarray(fields["read"], dtype=int)
    estimate = LoopEstimate(times, history.directions, biases, Followed(Belief(of("estimate"), bias, P), nis, read))
    return dataclasses.replace(history, estimate=estimate)


def names_in(about: Mapping[str, Any], attribute: str) -> tuple[str, ...]:
    """Returns the names in an attribute."""
    return tuple(name for name in str(about[attribute]).split(BETWEEN) if name)
