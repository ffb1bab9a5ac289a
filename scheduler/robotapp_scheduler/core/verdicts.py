"""What the filters of one pod class say, as its totals need it."""

from typing import NamedTuple

from robotapp_scheduler.core.filter_column import Codes


class Verdicts(NamedTuple):
    """What the filters say: first reason per row (0 = feasible), how many are feasible, and when that changed."""

    reason: Codes
    feasible: int
    revision: int
    """Grows whenever `reason` changes."""
    combines: int
    """Grows when any row may have changed."""
