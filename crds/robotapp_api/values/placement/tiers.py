"""Tiers of nodes, as `runsOn` names them, and what follows from them."""

from collections.abc import Sequence
from typing import Final

ROBOT: Final = "Robot"
KEEP: Final = "Keep"
FAILOVER: Final = "Failover"


def on_disconnect(runs_on: Sequence[str], written: str | None) -> str:
    """What happens to a pod of the component on a lost node: as written, else Keep on the robot and Failover elsewhere."""
    return written or (KEEP if tuple(runs_on) == (ROBOT,) else FAILOVER)
