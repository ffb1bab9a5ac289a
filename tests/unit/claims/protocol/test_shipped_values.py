"""Rule 7 with the values we ship: everything is given back after the rest and two sweeps, woken by events or not."""

import asyncio
from pathlib import Path
from typing import Any

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st
from tests.support.claims.objects import app_holder, app_json, pod_json, pool_json
from tests.support.claims.store import Store
from tests.support.virtual_time import run_virtually

from robotapp_api.model.pool import PoolSpec
from robotapp_claims.protocol.devices import reserve_devices
from robotapp_claims.protocol.domains import ensure_domain
from robotapp_claims.protocol.sweep_snapshot import DEFAULT_QUARANTINE_S
from robotapp_claims.protocol.sweeper import HANDOVER_S, PERIOD_S, Sweeper
from robotapp_claims.rules.device import chosen
from robotapp_claims.rules.domain import DomainRequest
from robotapp_claims.rules.objects import PoolSpec as SweptPoolSpec
from robotapp_client.api.resources import DOMAINPOOLS, PODS, ROBOTAPPS, ROBOTCLAIMS
from robotapp_operator.settings import Settings
from robotapp_scheduler.config.flags import parse

VALUES: dict[str, Any] = yaml.safe_load(
    (Path(__file__).resolve().parents[4] / "helm" / "robotapp" / "values.yaml").read_text()
)
REST_S = VALUES["domainPool"]["quarantineSeconds"]


def test_chart_programs_and_schema_ship_the_same_values() -> None:
    assert PoolSpec().quarantine_seconds == SweptPoolSpec().quarantine_seconds == DEFAULT_QUARANTINE_S == REST_S == 60
    periods = {VALUES["operator"]["sweepSeconds"], VALUES["scheduler"]["sweepSeconds"], Settings().sweep_seconds}
    assert periods == {parse([], {}).sweep_seconds} == {PERIOD_S} == {30}
    assert Settings().handover_seconds == HANDOVER_S == 15


async def life(*, ends_after_s: float, suspended: bool, woken: bool) -> tuple[float, float]:
    """Seconds from the end of an app's last pod until its device and its domain are free."""
    clock = asyncio.get_running_loop().time
    store = Store()
    store.put(DOMAINPOOLS, pool_json("1-3", quarantine_s=REST_S))
    spec: dict[str, Any] = {"components": [{"name": "driver", "devices": [{"name": "bus", "type": "can"}]}]}
    app = store.put(ROBOTAPPS, app_json(**spec))
    holder, driver = (app_holder(app["metadata"]["uid"], component=name) for name in ("", "driver"))
    domain = await ensure_domain(store.client(), DomainRequest(holder))
    pod = store.put(PODS, pod_json(domain.id, name="p", uid=holder.uid))
    device = chosen(node="edge-1", device_id="can-can0", device_type="can", identity="")
    await reserve_devices(
        store.client(), holder=driver, pod_uid=pod["metadata"]["uid"], node="edge-1", devices=[device]
    )
    freed_s: dict[str, float] = {}

    async def note(what: str) -> None:
        if what.startswith("delete "):
            freed_s[what.rpartition(" ")[2]] = clock()

    sweeper = Sweeper(store.client(after=note), period_s=PERIOD_S, handover_s=HANDOVER_S, clock=clock)
    running = asyncio.create_task(sweeper.run())
    await asyncio.sleep(ends_after_s)
    if suspended:  # the claim of the domain stays; only the device is given back
        store.put(ROBOTAPPS, app | {"spec": app["spec"] | {"suspend": True}})
    else:
        store.remove(ROBOTAPPS, "teleop", "team")
    store.remove(PODS, "p", "team")
    if woken:
        sweeper.sweep_soon()
    ended_s = clock()
    await asyncio.sleep(REST_S + 3 * PERIOD_S)
    assert sweeper.counts["failed passes"] == 0
    running.cancel()
    assert {claim["metadata"]["name"] for claim in store.all(ROBOTCLAIMS)} == ({domain.claim} if suspended else set())
    took_s = [round(freed_s.get(name, ended_s) - ended_s, 6) for name in (device.claim, domain.claim)]
    return took_s[0], took_s[1]


@given(st.floats(0, 2 * PERIOD_S), st.booleans())
def test_nothing_is_left_after_the_rest_and_two_sweeps(ends_after_s: float, woken: bool) -> None:
    device_s, domain_s = run_virtually(life(ends_after_s=ends_after_s, suspended=False, woken=woken))
    assert REST_S <= domain_s <= REST_S + 2 * PERIOD_S
    assert device_s <= 2 * PERIOD_S
    if woken:
        assert domain_s <= REST_S + 1
        assert device_s <= 1


@pytest.mark.parametrize("woken", [True, False])
def test_a_suspended_app_gives_its_device_back_and_keeps_its_domain(woken: bool) -> None:
    device_s, _ = run_virtually(life(ends_after_s=3, suspended=True, woken=woken))
    assert device_s <= (1 if woken else PERIOD_S)
