"""The environment of the tests: float64, or float32, strict promotion, and shapes checked at run time."""

import gc
import os
import signal
import zlib

import hypothesis
import jax
import jaxtyping
import numpy as np
import pytest

from tests.support import checked, sentences

X64 = os.environ.get("JAXBALL_TESTS_X64", "1") != "0"  # with 0, the tests marked any_precision run, in float32
os.environ["JAXBALL_NO_CACHE"] = "1"  # where pytest has no folder for programs; the user's is left alone
jax.config.update("jax_enable_x64", X64)
jax.config.update("jax_numpy_dtype_promotion", "strict")
jax.config.update("jax_numpy_rank_promotion", "raise")
jax.config.update("jax_traceback_in_locations_limit", 0)  # About a tenth of the time that lowering takes.

# Compiling counts as part of an example's time, and a test must give the same answer each time.
hypothesis.settings.register_profile("compiled", deadline=None, derandomize=True, database=None)
hypothesis.settings.load_profile("compiled")

# Commands and examples that tests start read what the first of them has compiled of jaxball's own files.
os.environ["PYTHONDONTWRITEBYTECODE"] = ""

# Tracing makes many objects that live on, which the collector would look through again and again.
gc.freeze()
gc.set_threshold(50_000, 50, 50)

SECONDS = np.linspace(0.0, 20.0, 21)


def _checks_shapes(config) -> bool:
    """Shapes are checked wherever the default tests run, not where others alone do: it takes a fifth of their time.

    The process that hands tests out to others runs none.
    """
    with_default_tests = not config.option.markexpr or config.option.markexpr.startswith("not ")
    hands_out = getattr(config.option, "numprocesses", None) and not hasattr(config, "workerinput")
    return with_default_tests and not hands_out


def pytest_addoption(parser):
    parser.addoption(
        "--part", metavar="K/N", help="of N parts of the chosen modules, the one with the number K, from 0 on"
    )


def pytest_configure(config):
    """Compiling takes most of the default run; only long studies gain more from optimised programs than they cost."""
    unoptimised = "not slow" in config.option.markexpr
    if _checks_shapes(config):
        checked.install()
    from tests.support import programs

    jax.config.update("jax_disable_most_optimizations", unoptimised)
    os.environ["JAX_DISABLE_MOST_OPTIMIZATIONS"] = str(int(unoptimised))  # of examples and commands
    programs.compile_quickly()
    if getattr(config, "cache", None):  # pytest's own, which `-p no:cacheprovider` switches off
        programs.keep_in(config.cache.mkdir("programs"))
    if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:
        # A shell lets what it runs in the background ignore Ctrl-C, and all that this starts; tests press it.
        signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_runtest_teardown(item, nextitem):
    from tests.support import programs

    programs.forget_if_many(module_ends=nextitem is None or nextitem.path != item.path)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call(item):
    with sentences.listened(item.nodeid):
        return (yield)


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(config, items):
    collected = {item.nodeid for item in items}
    config.stash[sentences.COLLECTED] = collected
    named = {argument.partition("::")[0] for argument in config.args if "::" in argument}
    sentences.forget_others({test for test in collected if sentences.module_of(test) not in named})
    if not X64:
        _choose(config, items, lambda item: item.get_closest_marker("any_precision"))
    if config.option.part:
        number, parts = _part(config.option.part)
        # By modules, whose tests share programs; by a hash that is the same in every process.
        _choose(config, items, lambda item: zlib.crc32(item.nodeid.split("::")[0].encode()) % parts == number)


def _part(text):
    number, slash, parts = text.partition("/")
    if not (slash and number.isdecimal() and parts.isdecimal() and int(number) < int(parts)):
        raise pytest.UsageError(f"Option --part must be K/N with K from 0 to N - 1, such as 0/8, but it is {text!r}.")
    return int(number), int(parts)


def _choose(config, items, is_chosen):
    """Leaves those items for which ``is_chosen`` says so."""
    chosen = list(filter(is_chosen, items))
    config.hook.pytest_deselected(items=[item for item in items if not is_chosen(item)])
    items[:] = chosen


@pytest.fixture
def no_type_checks():
    """The sentences that a user reads, who does not check types at run time as these tests do."""
    jaxtyping.config.update("jaxtyping_disable", True)
    yield
    jaxtyping.config.update("jaxtyping_disable", False)


@pytest.fixture
def command_line(monkeypatch):
    """The command line sets XLA_FLAGS; other tests must not see it."""
    monkeypatch.setenv("XLA_FLAGS", os.environ.get("XLA_FLAGS", ""))


@pytest.fixture
def command_folder(command_line, monkeypatch, tmp_path):
    """The folder in which commands are called."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture(scope="module")
def browser():
    """Chromium, which draws WebGL in software."""
    from tests.support.browser import SOFTWARE, chromium

    with chromium(*SOFTWARE) as driver:
        yield driver


@pytest.fixture(scope="session")
def ball_trajectory():
    """The paper's ball at t = 0, 1, ..., 20, at the tolerance of the paper."""
    import jaxball
    from tests.support.paper import paper_ball

    return jaxball.simulate(paper_ball(), SECONDS, rtol=1e-10, atol=1e-10, step_to_times=True).raise_if_failed()


@pytest.fixture(scope="session")
def disk_trajectory():
    """The paper's disk at t = 0, 1, ..., 20, at tolerance 1e-12."""
    import jaxball
    from tests.support.paper import paper_disk

    return jaxball.simulate(paper_disk(), SECONDS, rtol=1e-12, atol=1e-12, step_to_times=True).raise_if_failed()
