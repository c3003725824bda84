"""Settings for all tests: no deadline for hypothesis, since these machines are noisy.

On a slow machine a command writes lines of progress; tests compare what else it writes. What is
thorough or nightly is slow too, so that ``-m 'not slow'`` leaves it out.

Hundreds of tests start processes. Where Python is told to keep no bytecode, each of these would
compile all of cubepath anew, which takes as long as all else that it does; so they are not told.
Nor do they inherit that an interrupt is ignored, as it is where tests run in the background.
"""

import gc
import os
import signal
from collections import Counter
from collections.abc import Generator
from importlib.util import find_spec

import pytest
from hypothesis import HealthCheck, Phase, settings

# These need what no other test does; .ci/run installs it, names them, and fails if none was found.
_EXTRAS = {
    "sb3_contrib": "agents/environments/test_sb3.py",
    "rerun": "coordinator/tools/exports/test_rerun.py",
}
collect_ignore = [path for module, path in _EXTRAS.items() if find_spec(module) is None]

os.environ["CUBEPATH_PROGRESS"] = "0"

os.environ.pop("PYTHONDONTWRITEBYTECODE", None)

if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

settings.register_profile(
    "cubepath",
    max_examples=50,  # half of the default; what needs more says so
    deadline=None,
    phases=set(Phase) - {Phase.explain},  # which takes seconds wherever something is to be found
    suppress_health_check=[HealthCheck.too_slow],
    print_blob=True,
)
settings.load_profile("cubepath")


_cases: Counter[str] = Counter()


def pytest_itemcollected(item: pytest.Item) -> None:
    """Mark what is thorough, and that and the nightly as slow: cases still come in their order."""
    few, nightly = map(item.get_closest_marker, ("few", "nightly"))
    if few is not None and nightly is None:
        test = item.nodeid.partition("[")[0]
        _cases[test] += 1
        if _cases[test] > few.args[0]:
            item.add_marker("thorough")
    if nightly is not None or item.get_closest_marker("thorough"):
        item.add_marker("slow")


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, object, object]:
    """Spare the garbage collector what stays until the end: thousands of tests, and all modules.

    They are collected in four fifths of the time, and explorations that hold millions of states
    take a quarter less time with fewer collections.
    """
    gc.disable()
    found = yield
    gc.collect()
    gc.freeze()
    gc.set_threshold(50_000, 20, 20)
    gc.enable()
    return found
