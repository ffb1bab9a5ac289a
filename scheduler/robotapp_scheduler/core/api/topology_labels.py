"""Labels with the zone and region of nodes and volumes: those of today and the old ones."""

from typing import Final

from robotapp_api.model.names import Label

ZONE: Final = str(Label.ZONE)
REGION: Final = "topology.kubernetes.io/region"
OLD_ZONE: Final = "failure-domain.beta.kubernetes.io/zone"
OLD_REGION: Final = "failure-domain.beta.kubernetes.io/region"
TODAY: Final = {OLD_ZONE: ZONE, OLD_REGION: REGION, ZONE: ZONE, REGION: REGION}
"""The name of today by each of them."""
SEPARATOR: Final = "__"
"""Between the zones of a volume that is in several."""
