"""Settings of every test."""

from hypothesis import settings

# How long an example takes says something about the machine's other work, not about the rule under test.
settings.register_profile("untimed", deadline=None)
settings.load_profile("untimed")
