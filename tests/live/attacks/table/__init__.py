"""Every attack that the API server must refuse, as one table: `tests/live/attacks` runs it, docs/security.md prints it."""

from tests.live.attacks.table.attack import Attack, Road, Stop
from tests.live.attacks.table.devices import DEVICES
from tests.live.attacks.table.escalations import ESCALATIONS
from tests.live.attacks.table.grants import GRANTS
from tests.live.attacks.table.host_access import HOST
from tests.live.attacks.table.sizes import SIZES
from tests.live.attacks.table.stolen_agents import STOLEN

__all__ = ["ATTACKS", "DEVICES", "ESCALATIONS", "GRANTS", "HOST", "SIZES", "STOLEN", "Attack", "Road", "Stop"]

ATTACKS = (*ESCALATIONS, *GRANTS, *HOST, *SIZES, *STOLEN, *DEVICES)
