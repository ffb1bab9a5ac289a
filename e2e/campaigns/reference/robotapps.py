"""The RobotApps of examples/reference as they are committed, changed only in what a testbed and a comparison need."""

from collections.abc import Mapping, Sequence
from typing import Any, Final

import yaml

from robotapp_api.model.names import Label
from robotapp_testbed import images
from robotapp_testbed.images.reference import FOLDER

Json = dict[str, Any]
VOLUMES: Final = "/var/lib/robotapp-volumes"
"""Folder of a real node that has its volumes."""


def read_app(
    name: str, runs_on: Mapping[str, Sequence[str]] | None = None, *, scheduler: str = "", use_images: bool = True
) -> Json:
    """Returns the committed RobotApp, some components on some kinds of nodes, with another scheduler where one is given.

    With `use_images` the images are those of the testbed; the discovery server or master has the application's, which has what
    it takes.
    """
    app: Json = yaml.safe_load((FOLDER / name / "robotapp.yaml").read_text())
    for component in app["spec"]["components"]:
        if component["name"] in (runs_on or {}):
            component["runsOn"] = list((runs_on or {})[component["name"]])
    if use_images:
        image = {"image": images.reference(name), "imagePullPolicy": "IfNotPresent"}
        for component in app["spec"]["components"]:
            component.update(image)
        app["spec"].update({"ros1": image} if name.endswith("ros1") else {"ros2": {"discovery": image}})
    if scheduler:
        app["spec"]["schedulerName"] = scheduler
    return app


def read_claims(name: str) -> list[Json]:
    """Returns the PersistentVolumeClaims that the application's page applies before the app."""
    path = FOLDER / name / "claim.yaml"
    return [claim for claim in yaml.safe_load_all(path.read_text()) if claim] if path.exists() else []


def make_volume(claim: Json, namespace: str, node: str) -> Json:
    """Returns a volume for this claim that only `node` has: a folder of its disk."""
    name = claim["metadata"]["name"]
    term = {"matchExpressions": [{"key": str(Label.HOSTNAME), "operator": "In", "values": [node]}]}
    return {
        "apiVersion": "v1",
        "kind": "PersistentVolume",
        "metadata": {"name": f"{namespace}-{name}"},
        "spec": {
            "capacity": claim["spec"]["resources"]["requests"],
            "accessModes": claim["spec"]["accessModes"],
            "persistentVolumeReclaimPolicy": "Retain",
            "local": {"path": f"{VOLUMES}/{namespace}-{name}"},
            "nodeAffinity": {"required": {"nodeSelectorTerms": [term]}},
            "claimRef": {"apiVersion": "v1", "kind": "PersistentVolumeClaim", "namespace": namespace, "name": name},
        },
    }
