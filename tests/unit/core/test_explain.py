import msgspec
from tests.support.scheduling import make_core, make_info, make_node

from robotapp_scheduler.core.explain import ExplainRing, Record, as_json


def record(name: str, uid: str) -> Record:
    return Record(
        namespace="default", name=name, uid=uid, at_s=0.0, profile="p", config_hash="h", attempt=1, node=None,
        message="", nodes=0, feasible=0,
    )  # fmt: skip


def test_the_ring_keeps_the_latest_pods_and_one_record_each() -> None:
    ring = ExplainRing(kept=3)
    for i in range(5):
        ring.add(record(f"p{i}", f"u{i}"))
    ring.add(record("p4", "u4"))
    assert len(ring) == 3
    assert [found.name for found in ring.latest(2)] == ["p4", "p3"]
    assert ring.get("u0") is None
    assert ring.find("default", "p0") is None


def test_a_name_finds_the_pod_that_was_tried_last_even_when_an_older_one_leaves() -> None:
    ring = ExplainRing(kept=2)
    for uid in ("old", "new"):
        ring.add(record("p", uid))
    ring.add(record("other", "x"))
    found = ring.find("default", "p")
    assert found is not None
    assert found.uid == "new"


def test_a_record_is_plain_json_in_camel_case() -> None:
    core = make_core(make_node("a"), make_node("b", unschedulable=True), make_node("c"))
    core.schedule_one(make_info("p"))
    found = core.explain.get("uid-p")
    assert found is not None
    plain = as_json(found)
    assert msgspec.json.decode(msgspec.json.encode(plain)) == plain
    assert {"configHash", "runnerUp", "refusals", "top"} <= plain.keys()
    assert plain["refusals"][0]["examples"][0]["node"] == "b"
