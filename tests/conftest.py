"""Settings for all tests: no deadline for hypothesis, since these machines are noisy.

On a slow machine a command writes lines of progress; tests compare what else it writes. What is
thorough is slow too, so that ``-m 'not slow'`` leaves it out.

Hundreds of tests start processes. Where Python is told to keep no bytecode each of them would compile
all of cubepath anew, which takes as long as all else that it does, so these keep it in a folder that
goes with the session.
"""

from __future__ import annotations

import atexit
import os
from tempfile import TemporaryDirectory

import pytest
from hypothesis import HealthCheck, settings

os.environ["CUBEPATH_PROGRESS"] = "0"

if os.environ.pop("PYTHONDONTWRITEBYTECODE", ""):  # workers are started later, and inherit this
    _bytecode = TemporaryDirectory(prefix="cubepath-bytecode-")
    atexit.register(_bytecode.cleanup)
    os.environ["PYTHONPYCACHEPREFIX"] = _bytecode.name

settings.register_profile(
    "cubepath", deadline=None, suppress_health_check=[HealthCheck.too_slow], print_blob=True
)
settings.load_profile("cubepath")


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark what is thorough as slow, before any test is deselected."""
    for item in items:
        if item.get_closest_marker("thorough"):
            item.add_marker("slow")
