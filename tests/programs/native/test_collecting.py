"""How often Python searches for garbage: as the user wants it, but less often while a program is made."""

import gc
import threading

import jax.numpy as jnp
import pytest

import jaxball
from jaxball.programs.native.tracing import SELDOM, seldom_collected


@pytest.fixture(autouse=True)
def pythons_own():
    before = gc.get_threshold()
    gc.set_threshold(700, 10, 10)
    yield
    gc.set_threshold(*before)


@pytest.mark.thorough
def test_while_a_program_is_made_and_not_while_it_runs():
    seen = []

    def function(x):
        seen.append(gc.get_threshold())
        return 2.0 * x

    assert jaxball.jit(function)(jnp.asarray(3.0)) == 6.0
    assert seen == [SELDOM]
    assert gc.get_threshold() == (700, 10, 10)


def test_after_an_error_too():
    def function(_):
        raise ValueError("Not this one.")

    with pytest.raises(ValueError, match="Not this one"):
        jaxball.jit(function)(jnp.asarray(3.0))
    assert gc.get_threshold() == (700, 10, 10)


@pytest.mark.parametrize("wanted", [(0, 10, 10), (200_000, 100, 100)])
def test_a_search_that_is_more_seldom_or_none_stays_so(wanted):
    gc.set_threshold(*wanted)
    with seldom_collected():
        assert gc.get_threshold() == wanted
    assert gc.get_threshold() == wanted


def test_what_the_user_sets_within_stays():
    with seldom_collected():
        gc.set_threshold(1000, 20, 20)
    assert gc.get_threshold() == (1000, 20, 20)


def test_the_last_of_the_threads_ends_it():
    entered, left = threading.Event(), threading.Event()

    def other():
        with seldom_collected():
            entered.set()
            left.wait()

    thread = threading.Thread(target=other)
    with seldom_collected():
        thread.start()
        entered.wait()
    assert gc.get_threshold() == SELDOM
    left.set()
    thread.join()
    assert gc.get_threshold() == (700, 10, 10)
