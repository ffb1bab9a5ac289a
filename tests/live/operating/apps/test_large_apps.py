"""Apps as large as they may be, suspended ones too, cost the operator little, and larger ones are refused with what counts."""

from campaigns.common.process_use import tree_rss_bytes
from campaigns.rigs.live import Tenant, eventually, part
from robotapp_testbed.processes.process import Process

MIB = 1 << 20
COUNT = 12


def texts(number: int) -> list[dict[str, object]]:
    """Components with two variables of 30 kB each."""
    variables = [{"name": name, "value": "x" * 30_000} for name in ("A", "B")]
    return [part(f"c{index}", env=variables) for index in range(number)]


def devices(number: int) -> list[dict[str, object]]:
    """Components whose JSON is short and whose objects in memory are many."""
    each = [{"name": f"d{index}", "type": "video"} for index in range(8)]
    return [part(f"c{index}", devices=each) for index in range(number)]


def test_suspended_apps_of_the_largest_size_take_little_of_the_operators_memory(
    operator: Process, tenant: Tenant
) -> None:
    tenant.apply("usual", part("a"), suspend=True)
    tenant.wait("usual", "Accepted", "True")
    before = tree_rss_bytes(operator.pid)
    for index in range(COUNT):
        tenant.apply(f"texts-{index}", *texts(8), suspend=True)
        tenant.apply(f"devices-{index}", *devices(36), suspend=True)
    for index in range(COUNT):
        tenant.wait(f"texts-{index}", "Accepted", "True")
        tenant.wait(f"devices-{index}", "Accepted", "True")
    grown = (tree_rss_bytes(operator.pid) - before) / MIB
    assert grown < 2 * COUNT + 32, "a mebibyte for each, and what was decoded last"
    assert operator.running


def test_a_larger_app_is_not_accepted_and_says_what_counts(operator: Process, tenant: Tenant) -> None:
    tenant.apply("large", *texts(10))
    message = tenant.wait("large", "Accepted", "False", reason="TooLarge")["message"]
    assert "at most 512 KiB are allowed: its text 58" in message
    assert "10 components 40 KiB" in message
    assert tenant.deployments() == []
    tenant.edit("large", components=texts(2))
    tenant.wait("large", "Accepted", "True")
    eventually(tenant.deployments, what=tenant.children)
    assert operator.running
