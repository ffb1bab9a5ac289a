"""An app whose components work on one volume: the one that mounts it and one that only has to be beside it."""

import pytest
from tests.support.apiobjects import app, component

from campaigns.rigs.simulated_site import SimulatedSite
from campaigns.rigs.storage_live import VOLUMES, claim, claims_path, delete_volume, volume
from robotapp_api.model.names import Label
from robotapp_testbed.machines.nodes import Tier

pytestmark = pytest.mark.live

PATIENCE_S = 60.0


def test_components_run_where_the_volume_is_and_the_one_that_mounts_it_has_it(world: SimulatedSite) -> None:
    home = next(node.name for node in world.nodes if node.tier is Tier.EDGE)
    full = f"{world.namespace}-site-map"
    world.cp.api.create(VOLUMES, volume(full, "", node=home))
    wanted = claim("site-map", "")
    wanted["spec"]["volumeName"] = full
    world.cp.api.create(claims_path(world.namespace), wanted)
    shared = {"claimNames": ["site-map"]}
    mounted = {"spec": {"volumes": [{"name": "map", "persistentVolumeClaim": {"claimName": "site-map"}}]}}
    mapper = component(
        "mapper", sharedData=shared, template=mounted, volumeMounts=[{"name": "map", "mountPath": "/map"}]
    )
    try:
        world.create(app("survey", components=[mapper, component("planner", sharedData=shared)]))
        world.watch.until_ready("survey", within_s=PATIENCE_S)
        labels = ((pod["metadata"]["labels"].get(str(Label.COMPONENT)), pod["spec"]) for pod in world.pods())
        pods = {name: spec for name, spec in labels if name}  # without the discovery servers
        assert {name: spec["nodeName"] for name, spec in pods.items()} == {"mapper": home, "planner": home}
        (container,) = pods["mapper"]["containers"]
        assert {"name": "map", "mountPath": "/map"} in container["volumeMounts"]
    finally:
        delete_volume(world.cp, full)
