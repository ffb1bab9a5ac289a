"""Every attack that the API server must refuse, as one table: `tests/integration/attacks` runs it, docs/security.md prints it."""

from tests.support.attacks.attack import Attack, Road, Stop
from tests.support.attacks.escalations import ESCALATIONS
from tests.support.attacks.grants import GRANTS
from tests.support.attacks.stolen_agents import STOLEN

__all__ = ["ATTACKS", "ESCALATIONS", "GRANTS", "STOLEN", "Attack", "Road", "Stop"]

ATTACKS = (*ESCALATIONS, *GRANTS, *STOLEN)
