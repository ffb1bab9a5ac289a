import msgspec
from tests.support.scheduling import make_core, make_info, make_node

from robotapp_scheduler.core.explain.record import MOST_REFUSALS, ExplainRing, Record, as_json


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


def test_large_records_push_older_ones_out_before_the_memory_is_used_up() -> None:
    ring = ExplainRing(kept=1000, kept_bytes=100_000)
    for i in range(100):
        ring.add(msgspec.structs.replace(record(f"p{i}", f"u{i}"), message="x" * 5000))
        assert ring.size_bytes <= 100_000
    assert 0 < len(ring) < 20
    assert ring.get("u99") is not None
    ring.add(msgspec.structs.replace(record("huge", "huge"), message="x" * 200_000))
    assert [found.uid for found in ring.latest(9)] == ["huge"], "the newest is kept whatever its size"


def test_two_thousand_ordinary_records_fit_with_room_to_spare() -> None:
    core = make_core(*(make_node(f"node-{i}", unschedulable=i % 3 == 0) for i in range(20)))
    core.schedule_one(make_info("p"))
    assert core.explain.size_bytes * 2000 < 20_000_000


def test_a_reason_of_its_own_on_every_node_does_not_grow_the_record() -> None:
    taints = [[{"key": f"only-{i}", "effect": "NoSchedule"}] for i in range(200)]
    core = make_core(*(make_node(f"node-{i}", taints=taint) for i, taint in enumerate(taints)))
    core.schedule_one(make_info("p"))
    found = core.explain.get("uid-p")
    assert found is not None
    assert len(found.refusals) <= MOST_REFUSALS
