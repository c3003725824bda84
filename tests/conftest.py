"""Settings for all tests: no deadline for hypothesis, since these machines are noisy."""

from hypothesis import HealthCheck, settings

settings.register_profile(
    "cubepath", deadline=None, suppress_health_check=[HealthCheck.too_slow], print_blob=True
)
settings.load_profile("cubepath")
