"""Settings for all tests: no deadline for hypothesis, since these machines are noisy.

On a slow machine a command writes lines of progress; tests compare what else it writes.
"""

import os

from hypothesis import HealthCheck, settings

os.environ["CUBEPATH_PROGRESS"] = "0"

settings.register_profile(
    "cubepath", deadline=None, suppress_health_check=[HealthCheck.too_slow], print_blob=True
)
settings.load_profile("cubepath")
