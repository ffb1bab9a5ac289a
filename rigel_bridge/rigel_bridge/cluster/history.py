"""The history of a RobotApp in the cluster, written with the rights of the user (role `robotapp-editor` has them)."""

import json
from collections.abc import Mapping, Sequence
from typing import Any, Final

from rigel_bridge.cluster.kubectl import ClusterError, Kubectl, Refusal
from rigel_bridge.cluster.revisions import Revision, belonging, recording
from rigel_bridge.names import APP_LABEL, MANAGER, REVISIONS

_ATTEMPTS: Final = 3


def read(kubectl: Kubectl, app: Mapping[str, Any]) -> list[Revision]:
    """The app's past specs, oldest first."""
    return belonging(_listed(kubectl, app), app)


def record(kubectl: Kubectl, app: Mapping[str, Any]) -> None:
    """Make the spec of a stored app the newest revision. After a conflict with another writer it is read and tried again."""
    for attempt in range(_ATTEMPTS):
        wanted = recording(_listed(kubectl, app), app)
        delete(kubectl, wanted.delete)
        if wanted.create is None:
            return
        try:
            kubectl.run("create", f"--field-manager={MANAGER}", "-f", "-", stdin=json.dumps(wanted.create))
        except ClusterError as error:
            if error.reason is not Refusal.EXISTS or attempt == _ATTEMPTS - 1:
                raise
        else:
            return


def delete(kubectl: Kubectl, names: Sequence[str]) -> None:
    if names:
        kubectl.run("delete", REVISIONS, *names, "--ignore-not-found", "--wait=false")


def _listed(kubectl: Kubectl, app: Mapping[str, Any]) -> list[dict[str, Any]]:
    return kubectl.items("get", REVISIONS, "-l", f"{APP_LABEL}={app['metadata']['name']}")
