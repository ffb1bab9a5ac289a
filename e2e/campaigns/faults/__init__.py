"""Our scheduler on a control plane that is hurt while thousands of pods wait: what must hold is checked all the time.

`scripts/bench faults` runs every fault at full size, tests/live/faults a small rotating sample.
"""
