"""Instances of a sweep as the caches show them: whose turn it is, and what the others are told."""

from datetime import UTC, datetime, timedelta
from typing import Any

import msgspec
import pytest
from tests.support.apiserver import FakeApiServer
from tests.support.claims import objects as make
from tests.support.clients import client_for
from tests.support.factories import UID, app_body, component
from tests.unit.operating.controlling import StubbedController
from tests.unit.operating.reconcile.test_instance_reconciler import ReconciledServer
from tests.unit.operating.watch.test_informers import InformedQueue

from robotapp_api.model.names import Annotation, Label
from robotapp_api.values.quantities.times import whole_seconds
from robotapp_claims.rules.objects import Claim, Pool
from robotapp_client import Change
from robotapp_client.api.resources import JOBS, ROBOTAPPS
from robotapp_operator.plan.spec.desired import App
from robotapp_operator.plan.spec.objects import Job
from robotapp_operator.queue.work import Work
from robotapp_operator.queue.workqueue import Key
from robotapp_operator.watch.cache import Cache
from robotapp_operator.watch.lister import admitted_instances, describe_turn

NOW = datetime(2026, 1, 1, tzinfo=UTC)
MATRIX = {"parameters": [{"name": "seed", "values": ["1", "2", "3"]}], "parallelism": 1}


def make_cache(completion: Any = None, *, count: int = 3, **matrix: Any) -> tuple[Cache, App]:
    cache = Cache()
    seeds = [str(number) for number in range(1, count + 1)]
    matrix["parameters"] = [{"name": "seed", "values": seeds}]
    return cache, put_app(cache, completion, **matrix)


def put_app(cache: Cache, completion: Any = None, **matrix: Any) -> App:
    spec = {"completion": completion} if completion else {}
    record = cache.update_app(app_body(components=[component("sim", job={})], matrix={**MATRIX, **matrix}, **spec))
    assert record.app is not None
    return record.app


def put_job(cache: Cache, app: App, instance: str, *, verdict: str = "", reason: str = "") -> None:
    metadata = {
        "name": f"job-{instance}",
        "namespace": "default",
        "uid": f"job-{instance}",
        "creationTimestamp": whole_seconds(NOW),
        "labels": {Label.APP_UID.value: UID, Label.INSTANCE.value: instance, Label.COMPONENT.value: "sim"},
        "annotations": {Annotation.RUN_HASH.value: app.run_hashes["sim"]},
        "ownerReferences": [{"kind": "RobotApp", "uid": UID, "controller": True}],
    }
    ended = {"type": verdict, "status": "True", "reason": reason, "lastTransitionTime": whole_seconds(NOW)}
    conditions = [ended] if verdict else []
    job = msgspec.convert({"metadata": metadata, "spec": {}, "status": {"conditions": conditions}}, Job)
    cache.jobs.put(UID, f"default/job-{instance}", job)


def put_claim(cache: Cache, instance: str, number: int, *, phase: str = "Reserved") -> Claim:
    claim = make.domain_claim(number, make.app_holder(UID, instance=instance), phase=phase)
    cache.claims.put(UID, claim.name, claim)
    return claim


def put_pool(cache: Cache, ids: str) -> None:
    cache.pools["default"] = msgspec.convert(make.pool_json(ids), Pool)


def test_the_first_instance_has_its_turn_and_the_others_are_told_the_number() -> None:
    cache, app = make_cache()
    first, second, third = app.sweep
    assert describe_turn(app, first, cache, now=NOW) == ""
    text = "waits for its turn: 1 of 3 instances run at once (matrix.parallelism)"
    assert [describe_turn(app, name, cache, now=NOW) for name in (second, third)] == [text, text]


def test_no_instance_of_a_refused_spec_waits_for_its_turn() -> None:
    cache, app = make_cache()
    _, second, _ = app.sweep
    assert describe_turn(app, second, cache, now=NOW).startswith("waits for its turn")
    refused = component("sim", job={}, args=["$(MATRIX_SPED)"])
    cache = Cache()
    record = cache.update_app(app_body(components=[refused], matrix=MATRIX))
    assert record.app is not None
    assert describe_turn(record.app, second, cache, now=NOW) == ""


def test_a_job_that_has_ended_gives_the_turn_to_the_next_instance() -> None:
    cache, app = make_cache()
    first, second, third = app.sweep
    put_job(cache, app, first)
    assert admitted_instances(app, cache, now=NOW) == {first}
    put_job(cache, app, first, verdict="Failed")
    assert admitted_instances(app, cache, now=NOW) == {second}
    put_job(cache, app, second, verdict="Complete")
    assert describe_turn(app, third, cache, now=NOW) == ""


def test_an_instance_that_has_begun_goes_on_when_the_number_falls() -> None:
    cache, app = make_cache(parallelism=2)
    first, second, third = app.sweep
    put_job(cache, app, first)
    put_job(cache, app, second)
    record = cache.update_app(app_body(generation=2, components=[component("sim", job={})], matrix=MATRIX))
    assert record.app is not None
    assert [describe_turn(record.app, name, cache, now=NOW) for name in (first, second)] == ["", ""]
    assert describe_turn(record.app, third, cache, now=NOW)


def test_an_instance_whose_deadline_is_over_gives_its_turn_although_its_failed_job_was_to_run_again() -> None:
    cache, app = make_cache({"deadline": "1h", "maxRestarts": 2})
    first, second, _ = app.sweep
    put_job(cache, app, first, verdict="Failed", reason="BackoffLimitExceeded")
    assert admitted_instances(app, cache, now=NOW + timedelta(minutes=59)) == {first}
    assert admitted_instances(app, cache, now=NOW + timedelta(minutes=60)) == {second}, "although the cache is the same"


def test_an_instance_whose_deadline_is_over_runs_until_its_job_has_ended() -> None:
    cache, app = make_cache({"deadline": "1h"})
    first, second, _ = app.sweep
    put_job(cache, app, first)
    late = NOW + timedelta(hours=2)
    assert admitted_instances(app, cache, now=late) == {first}
    put_job(cache, app, first, verdict="Failed", reason="DeadlineExceeded")
    assert admitted_instances(app, cache, now=late) == {second}


async def test_the_end_of_an_instance_by_its_deadline_begins_the_next_one_without_any_event() -> None:
    world = StubbedController()
    app = put_app(world.cache, {"deadline": "1h", "maxRestarts": 2})
    first, second, _ = app.sweep
    put_job(world.cache, app, first, verdict="Failed", reason="BackoffLimitExceeded")
    keys = Key(Work.CHILDREN, UID, first), Key(Work.CHILDREN, UID, second)
    world.now = NOW + timedelta(minutes=59)
    await world.handle(keys[0])
    assert keys[1] not in world.due()
    world.now = NOW + timedelta(minutes=60)
    await world.handle(keys[1])
    assert keys[1] not in world.due(), "an instance that waits would add its own key for ever"
    await world.handle(keys[0])
    assert keys[1] in world.due()


def test_domains_that_rest_after_a_run_count_until_they_are_free() -> None:
    cache, app = make_cache(parallelism=1)
    first, second, third = app.sweep
    put_pool(cache, "1-4")  # so the sweep holds two at most
    for number, instance in enumerate((first, second), start=1):
        put_job(cache, app, instance, verdict="Complete")
        put_claim(cache, instance, number, phase="Draining")
    assert admitted_instances(app, cache, now=NOW) == frozenset()
    text = describe_turn(app, third, cache, now=NOW)
    assert text.endswith("with at most 2 of 4 domains, counting those of ended runs, which rest 1 s")
    cache.claims.drop(UID, put_claim(cache, first, 1).name)
    assert admitted_instances(app, cache, now=NOW) == {third}


@pytest.mark.parametrize(("parallelism", "ids", "parked"), [(1, "1-3", 1), (2, "1-4", 2), (3, "1-2", 1)])
def test_domains_that_are_parked_for_a_lost_node_do_not_stop_a_sweep_while_others_are_free(
    parallelism: int, ids: str, parked: int
) -> None:
    cache, app = make_cache(parallelism=parallelism, count=8)
    names = [*app.sweep]
    put_pool(cache, ids)
    for number, instance in enumerate(names[:parked], start=1):
        put_job(cache, app, instance, verdict="Complete")
        put_claim(cache, instance, number, phase="Parked")
    free = int(ids[-1]) - parked
    assert admitted_instances(app, cache, now=NOW) == set(names[parked:][: min(parallelism, free)])


def test_who_waits_is_told_how_many_domains_are_parked() -> None:
    cache, app = make_cache(parallelism=1, count=8)
    first, *_, last = app.sweep
    put_pool(cache, "1-5")
    put_job(cache, app, first, verdict="Complete")
    put_claim(cache, first, 1, phase="Parked")
    text = describe_turn(app, last, cache, now=NOW)
    assert "with at most 2 of 4 domains" in text
    assert text.endswith("; parked until their nodes are seen again: 1")


def test_the_domain_of_a_run_that_is_parked_while_it_goes_on_is_counted_once() -> None:
    cache, app = make_cache(parallelism=2, count=8)
    first, second, *_ = app.sweep
    put_pool(cache, "1-2")
    put_job(cache, app, first)
    put_claim(cache, first, 1, phase="Parked")
    assert admitted_instances(app, cache, now=NOW) == {first, second}


def test_an_instance_with_a_domain_and_no_job_yet_keeps_its_turn() -> None:
    cache, app = make_cache(parallelism=1)
    _, second, _ = app.sweep
    put_pool(cache, "1-4")
    put_claim(cache, second, 1)
    assert admitted_instances(app, cache, now=NOW) == {second}


def test_a_small_quota_of_the_namespace_bounds_a_sweep_as_a_small_pool_does() -> None:
    cache, app = make_cache(parallelism=3)
    first, second, _ = app.sweep
    pool = make.pool_json("1-100", quota={"namespaces": {"default": 2}})
    cache.pools["default"] = msgspec.convert(pool, Pool)
    assert admitted_instances(app, cache, now=NOW) == {first, second}


def test_a_sweep_goes_on_when_a_domain_has_rested_after_the_apps_that_wait_for_it() -> None:
    watch = InformedQueue()
    record = watch.cache.update_app(app_body(components=[component("sim", job={})], matrix=MATRIX))
    assert record.app is not None
    first, second, third = record.app.sweep
    put_pool(watch.cache, "1-2")
    put_job(watch.cache, record.app, first, verdict="Complete")
    claim = put_claim(watch.cache, first, 1, phase="Draining")
    watch.informers._claim(Change("DELETED", claim.name, claim, None))
    assert Key(Work.CHILDREN, UID, second) not in watch.due(), "others that wait come first"
    watch.now_s += 2
    assert {key for key in watch.due() if key.work == Work.CHILDREN} == {Key(Work.CHILDREN, UID, second)}
    assert describe_turn(record.app, third, watch.cache, now=NOW)


def test_a_larger_pool_wakes_the_instances_that_may_run_now() -> None:
    watch = InformedQueue()
    record = watch.cache.update_app(
        app_body(components=[component("sim", job={})], matrix={**MATRIX, "parallelism": 2})
    )
    assert record.app is not None
    first, second, _ = record.app.sweep
    put_pool(watch.cache, "1")
    put_job(watch.cache, record.app, first)
    put_claim(watch.cache, first, 1)
    assert admitted_instances(record.app, watch.cache, now=NOW) == {first}
    larger = msgspec.convert(make.pool_json("1-9"), Pool)
    keys = watch.see("_pool", watch.cache.pools["default"], larger, key="default")
    assert Key(Work.CHILDREN, UID, second) in keys


def test_an_app_without_a_matrix_waits_for_nobody() -> None:
    cache = Cache()
    record = cache.update_app(app_body())
    assert record.app is not None
    assert describe_turn(record.app, "", cache, now=NOW) == ""


async def mirror_jobs(world: ReconciledServer) -> list[Job]:
    """Puts children, claims and Jobs into the cache, as the informers do, and returns the Jobs."""
    await world.mirror()
    jobs = (await world.client.list(JOBS, as_type=Job)).items
    for job in jobs:
        world.cache.jobs.put(job.metadata.labels[Label.APP_UID], job.metadata.name, job)
    return jobs


async def complete(world: ReconciledServer, job: Job) -> None:
    """Has a Job end as its controller would."""
    ended = {"type": "Complete", "status": "True", "lastTransitionTime": "2026-01-01T00:00:00Z"}
    await world.client.patch(JOBS, job.metadata.name, {"status": {"conditions": [ended]}}, namespace="default")


async def test_a_sweep_runs_whole_a_few_instances_at_a_time_and_an_operator_without_memory_goes_on_with_it() -> None:
    async with FakeApiServer() as api, client_for(api.endpoint, field_manager="robotapp-operator") as client:
        world = ReconciledServer(api, client)
        await world.pool()
        matrix = {"parameters": [{"name": "seed", "values": [str(number) for number in range(7)]}], "parallelism": 3}
        uid = await world.app(components=[component("sim", job={})], matrix=matrix)
        record = world.cache.apps[uid]
        assert record.app is not None
        rounds = 0
        while len([job for job in await mirror_jobs(world) if job.verdict]) < 7:
            rounds += 1
            for instance in record.app.sweep:
                assert await world.children.reconcile(uid, instance)
            jobs = await mirror_jobs(world)
            running = [job for job in jobs if job.verdict is None]
            assert 1 <= len(running) <= 3
            domains = {
                claim["spec"]["holder"]["instance"]: claim["spec"]["domain"]["id"] for claim in await world.claims()
            }
            own = {domains[job.metadata.labels[Label.INSTANCE]] for job in running}
            assert len(own) == len(running), "each in a domain of its own"
            await complete(world, running[-1])
            if rounds == 4:  # killed: its successor has only what the API server has
                world = ReconciledServer(api, client)
                (body,) = (await client.list(ROBOTAPPS)).items
                world.cache.update_app(body)
        assert rounds == 7
        uids = {job.metadata.uid for job in await mirror_jobs(world)}
        for instance in record.app.sweep:
            assert await world.children.reconcile(uid, instance)
        assert {job.metadata.uid for job in await mirror_jobs(world)} == uids, "what has ended is not run again"
