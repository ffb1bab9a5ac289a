"""Eighteen published examples, written anew as RobotApps, run on a live control plane as their authors wrote them.

The account that applies them may write RobotApps, pods and Services and use the node; docs/peer-examples.md lists the verdicts.
"""

import secrets
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import pytest
from tests.live.peer_examples import compose_files, manifests, open_rmf, platforms, spot
from tests.live.peer_examples.example import Example, Json, Running, Verdict

from campaigns.rigs.appwatch import is_ready
from campaigns.rigs.simulated_site import SimulatedSite
from campaigns.rigs.storage_live import VOLUMES, claim, claims_path, delete_volume, volume
from robotapp_api.checks.host_access.table import HostRight
from robotapp_testbed import ControlPlane, wait_until
from robotapp_testbed.control_plane.api import Api
from robotapp_testbed.failures import ApiStatusError
from robotapp_testbed.machines.network import Topology
from robotapp_testbed.machines.topology import cloud, edge, robot

pytestmark = pytest.mark.live

EXAMPLES: tuple[Callable[[], Example], ...] = (
    platforms.fogros_talker,
    platforms.fogros_segmentation,
    platforms.kuberos_hello_world,
    platforms.kuberos_navigation,
    platforms.kuberos_batch_job,
    manifests.robotkube,
    manifests.robotkube_ros1,
    platforms.robolaunch_robot,
    manifests.canonical_talkers,
    manifests.autoware,
    open_rmf.open_rmf,
    compose_files.husarion_autonomy,
    compose_files.open_ad_kit,
    manifests.connext_shared_memory,
    manifests.connext_gateway,
    spot.spot,
    platforms.rapyuta_rosbag,
    compose_files.turtlebot_behaviors,
)
"""In the order of the table in docs/peer-examples.md."""
PAGE = Path(__file__).parents[3] / "docs" / "peer-examples.md"
PATHS = {
    "ConfigMap": "/api/v1/namespaces/{}/configmaps",
    "Secret": "/api/v1/namespaces/{}/secrets",
    "Service": "/api/v1/namespaces/{}/services",
    "ServiceAccount": "/api/v1/namespaces/{}/serviceaccounts",
    "Ingress": "/apis/networking.k8s.io/v1/namespaces/{}/ingresses",
}
PATIENCE_S = 120.0
FIXED = "fixed"
SETTLED_S = 20.0
ROLES = ("edit", "robotapp-editor", *(f"robotapp-use-{right.value}" for right in HostRight))


def make_nodes(mark: str) -> Topology:
    """Two robots of one fleet, of which both have the bus that Spot asks for, two edge servers and a cloud node."""
    graphics = {"extended_resources": {"nvidia.com/gpu": "4"}}
    labels = {"peer.example/fleet": "lab", "peer.example/i2c-bus": "1"}
    robots = [robot(f"amr-{mark}-{number}", cpu="32", memory="128Gi", labels=labels, **graphics) for number in range(2)]
    return Topology(
        [
            *robots,
            *(edge(f"edge-{mark}-{number}", **graphics) for number in range(2)),
            cloud(f"cloud-{mark}", **graphics),
        ]
    )


@dataclass(frozen=True, slots=True)
class Applied:
    """The site after all examples were applied, and the refusals by name of the app."""

    site: SimulatedSite
    refusals: dict[str, str] = field(default_factory=dict)

    def running(self, example: Example) -> Running:
        names = {app["metadata"]["name"] for app in example.apps}
        root = f"/apis/robotics.io/v1alpha1/namespaces/{self.site.namespace}"

        def of_example(items: list[Json]) -> list[Json]:
            return [item for item in items if item["metadata"].get("labels", {}).get("robotics.io/app") in names]

        services = self.site.cp.api.get(PATHS["Service"].format(self.site.namespace))["items"]
        beside = {item["metadata"]["name"] for item in example.beside}
        kept = [item for item in services if item["metadata"]["name"] in beside]
        return Running(
            pods=of_example(self.site.pods()),
            services=[*of_example(services), *kept],
            instances=of_example(self.site.cp.api.get(f"{root}/robotappinstances")["items"]),
            tiers={node.name: node.tier.value for node in self.site.nodes},
        )

    def read_promises(self, example: Example) -> dict[str, object]:
        running = self.running(example)
        return {promise.what: promise.read(running) for promise in example.promises}


@pytest.fixture(scope="module")
def applied(installed_plane: ControlPlane) -> Iterator[Applied]:
    """All examples at once, applied by an account of the namespace; the volumes are the administrator's."""
    mark = secrets.token_hex(2)
    examples = [make() for make in EXAMPLES]
    pools = {f"peers-{mark}": "16-60", f"peers-{FIXED}-{mark}": "1-15"}
    with SimulatedSite(installed_plane, make_nodes(mark), pools=pools) as site:
        writer = _make_writer(site)
        volumes = []
        applied = Applied(site)
        try:
            for example in examples:
                for item in example.beside:
                    if item["kind"] == "PersistentVolumeClaim":
                        volumes.append(_claim_volume(site, item["metadata"]["name"]))
                    else:
                        writer.create(PATHS[item["kind"]].format(site.namespace), item)
                for app in example.apps:
                    applied.refusals[app["metadata"]["name"]] = _apply(writer, site, app, mark=mark)
            yield applied
        finally:
            writer.close()
            for name in volumes:
                delete_volume(site.cp, name)


def _make_writer(site: SimulatedSite) -> Api:
    """Returns the API as seen by an account that may write RobotApps, what `edit` may, and use the node."""
    plane, account = site.cp, f"--serviceaccount={site.namespace}:author"
    plane.kubectl("create", "serviceaccount", "author", "-n", site.namespace)
    for role in ROLES:
        plane.kubectl("create", "rolebinding", role, f"--clusterrole={role}", account, "-n", site.namespace)
    token = plane.kubectl("create", "token", "author", "-n", site.namespace).strip()
    return Api(plane.server_url, ca_file=plane.ca_file, token=token)


def _claim_volume(site: SimulatedSite, name: str) -> str:
    """Makes a claim and its volume, which every node reaches, and returns the volume's name."""
    full = f"{site.namespace}-{name}"
    site.cp.api.create(VOLUMES, volume(full, ""))
    body = claim(name, "")
    body["spec"]["volumeName"] = full
    site.cp.api.create(claims_path(site.namespace), body)
    return full


def _apply(writer: Api, site: SimulatedSite, app: Json, *, mark: str) -> str:
    """Creates an app with a domain from the test's own pools. Returns the refusal, "" without one.

    A domain that the authors fix is of a pool from which no app gets a free one, which might be this.
    """
    spec = app["spec"]
    if spec["ros"]["distro"] not in ("none", "noetic"):
        pool = f"peers-{FIXED}-{mark}" if "domain" in spec.get("ros2", {}) else f"peers-{mark}"
        spec = {**spec, "ros2": {"pool": pool, **spec.get("ros2", {})}}
    try:
        writer.create(f"{site.apps_path}?fieldValidation=Strict", {**app, "spec": spec})
    except ApiStatusError as error:
        return str(error)
    return ""


@pytest.mark.parametrize("make_example", [make for make in EXAMPLES if make().apps], ids=lambda make: make.__name__)
def test_an_example_is_accepted_ready_and_keeps_what_its_authors_wrote(
    applied: Applied, make_example: Callable[[], Example]
) -> None:
    example = make_example()
    names = [app["metadata"]["name"] for app in example.apps]
    assert [applied.refusals[name] for name in names] == [""] * len(names)
    applied.site.watch.until(
        lambda apps: all(name in apps and is_ready(apps[name]) for name in names),
        within_s=PATIENCE_S,
        what=example.title,
    )
    expected = {promise.what: promise.expected for promise in example.promises}
    wait_until(lambda: applied.read_promises(example) == expected, timeout_s=SETTLED_S)  # links follow the Services
    assert applied.read_promises(example) == expected


def test_the_page_lists_each_example_with_its_verdict_and_fifteen_run_as_written() -> None:
    rows = [line.split("|")[1:-1] for line in PAGE.read_text(encoding="utf-8").splitlines() if line.startswith("| ")]
    listed = [tuple(cell.strip() for cell in row[:3]) for row in rows if row[0].strip() != "example"]
    examples = [make() for make in EXAMPLES]
    assert listed == [(example.title, example.source, example.verdict.value) for example in examples]
    assert sum(example.verdict is Verdict.YES for example in examples) >= 15
