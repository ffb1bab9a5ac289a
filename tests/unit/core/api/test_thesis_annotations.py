"""The annotations of the thesis' listings 3.3 to 3.10, through the reader of annotations: what each of them means here."""

from pathlib import Path
from typing import Any, Final

import pytest
import yaml
from tests.support.scheduling import make_cluster, node_json, to_node

from robotapp_scheduler.core.api.annotations import parse_annotations
from robotapp_scheduler.core.api.ros import Hardware, RosRequest, thesis_tier, tier
from robotapp_scheduler.core.cache.snapshot import Snapshot
from robotapp_scheduler.plugins.ros.latency_filter import SHUTTING_DOWN

LISTINGS = Path(__file__).resolve().parents[3] / "golden" / "thesis" / "scheduler"
MEANING: Final = {
    "3.3": RosRequest(latency_budget_us=25_000, deadline_us=40_000, qos_class="realtime", reliability="reliable"),
    "3.4": RosRequest(qos_class="realtime", reliability="reliable", liveliness="manual_by_topic"),
    "3.5": RosRequest(latency_budget_us=25_000),
    "3.6": RosRequest(hardware=(Hardware("gpu", model="nvidia"), Hardware("can", interface="can1"))),
    "3.7": RosRequest(peer_pods=("mapper",), volume_claims=("site-map",)),
    "3.8": RosRequest(master_node="edge-7", zones=("hall-a", "hall-b")),
    "3.9": RosRequest(latency_budget_us=25_000, deadline_us=40_000, qos_class="realtime"),
    "3.10": RosRequest(dds_domain="auto"),
}
"""Listing -> the pod's request. An empty master node and an empty list of zones (3.3) wish nothing."""


def objects(listing: str) -> dict[str, dict[str, Any]]:
    """The objects of a listing by kind."""
    text = (LISTINGS / f"listing-{listing}.yaml").read_text()
    return {each["kind"]: each for each in yaml.safe_load_all(text)}


@pytest.mark.parametrize("listing", MEANING)
def test_the_pod_of_a_listing_is_read_without_a_complaint(listing: str) -> None:
    assert parse_annotations(objects(listing)["Pod"]["metadata"]["annotations"]) == MEANING[listing]


def test_no_annotation_listing_is_left_out() -> None:
    chapter_3 = {path.stem.removeprefix("listing-") for path in LISTINGS.glob("listing-3.*.yaml")}
    assert chapter_3 - {"3.11"} == MEANING.keys()


def test_the_class_of_listing_3_4_is_not_lowered_by_its_liveliness_unless_the_thesis_order_is_chosen() -> None:
    found = MEANING["3.4"]
    rules = [
        rule(found.qos_class, reliability=found.reliability, liveliness=found.liveliness)
        for rule in (tier, thesis_tier)
    ]
    assert rules == [3, 2]


@pytest.mark.parametrize(("listing", "shutting_down"), [("3.5", True), ("3.10", False)])
def test_of_a_nodes_annotations_the_shutdown_is_read_and_the_thesis_claims_are_not(
    listing: str, *, shutting_down: bool
) -> None:
    node = objects(listing)["Node"]["metadata"]
    cluster = make_cluster(to_node(node_json(node["name"], annotations=node["annotations"])))
    assert [bool(each) for each in Snapshot(cluster).fact(SHUTTING_DOWN)] == [shutting_down]
