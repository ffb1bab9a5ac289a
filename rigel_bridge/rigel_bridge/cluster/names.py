"""Names on cluster objects, equal to those of robotapp_api, which Rigel's environment does not have (a test compares them)."""

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
