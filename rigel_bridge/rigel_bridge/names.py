"""Words of the API, equal to those of robotapp_api, which Rigel's environment does not have (a test compares them)."""

from typing import Final

API_VERSION: Final = "robotics.io/v1alpha1"
APPS: Final = "robotapps.robotics.io"
INSTANCES: Final = "robotappinstances.robotics.io"
REVISIONS: Final = "controllerrevisions.apps"
MANAGER: Final = "rigel-bridge"
APP_LABEL: Final = "robotics.io/app"
APP_UID_LABEL: Final = "robotics.io/app-uid"
COMPONENT_LABEL: Final = "robotics.io/component"
PROVENANCE: Final = "rigel.robotics.io/"
"""Prefix of the bridge's own labels and annotations."""
RUN_RENEWED: Final = f"{PROVENANCE}run-renewed"
"""When the run of a sequence that made an app last showed that it lives. Not of its past specs: a rollback revives no run."""
BRIDGE_APP_LABEL: Final = f"{PROVENANCE}app"
"""On what stands beside the RobotApp: volume claims, which nothing owns, so that deleting the app keeps the data."""
INSTANCE_LABEL: Final = "robotics.io/instance"
SCHEDULER: Final = "ros-aware-scheduler"
THESIS_SCHEDULER: Final = "kubernetes-scheduler"
DEFAULT_SCHEDULER: Final = "default-scheduler"
"""Kubernetes' own."""
GRANTED_DOMAIN: Final = "granted.robotics.io/dds-domain"
"""Annotation in which our scheduler writes the domain that a pod got."""
SCHEDULER_PREFIX: Final = "scheduler.robotics.io/"
"""Prefix of the thesis' annotations of pods and nodes."""
QOS_CLASSES: Final = ("realtime", "sensor_data", "system_default", "best_effort")
"""The most demanding first."""
SAFE_DOMAINS: Final = ((1, 101), (215, 232))
"""First and last DDS domain of each range that needs no `allowUnsafeDomain`."""
MAX_DOMAIN: Final = 232
