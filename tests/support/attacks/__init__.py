"""Every attack that the API server must refuse, as one table: `tests/integration/attacks` runs it, docs/security.md prints it."""

from tests.support.attacks.attack import Attack, Road, Stop
from tests.support.attacks.escalations import ESCALATIONS
from tests.support.attacks.grants import GRANTS

__all__ = ["ATTACKS", "ESCALATIONS", "GRANTS", "Attack", "Road", "Stop"]

ATTACKS = (*ESCALATIONS, *GRANTS)
