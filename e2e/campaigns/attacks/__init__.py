"""Every attack that the API server must refuse, as one table: `tests/live/attacks` runs it, docs/security.md prints it."""

from campaigns.attacks.attack import Attack, Road, Stop
from campaigns.attacks.escalations import ESCALATIONS
from campaigns.attacks.grants import GRANTS
from campaigns.attacks.stolen_agents import STOLEN

__all__ = ["ATTACKS", "ESCALATIONS", "GRANTS", "STOLEN", "Attack", "Road", "Stop"]

ATTACKS = (*ESCALATIONS, *GRANTS, *STOLEN)
