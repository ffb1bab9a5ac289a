"""Names of the labels with the zone and region of nodes and volumes, today's and the deprecated ones."""

from typing import Final

from robotapp_api.model.names import Label

ZONE: Final = str(Label.ZONE)
REGION: Final = "topology.kubernetes.io/region"
OLD_ZONE: Final = "failure-domain.beta.kubernetes.io/zone"
OLD_REGION: Final = "failure-domain.beta.kubernetes.io/region"
TODAY: Final = {OLD_ZONE: ZONE, OLD_REGION: REGION, ZONE: ZONE, REGION: REGION}
"""Each label → today's name of it."""
SEPARATOR: Final = "__"
"""Separates the zones in the label of a volume that is in several."""
