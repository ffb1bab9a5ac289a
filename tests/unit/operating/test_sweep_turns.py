"""Instances of a sweep as the caches show them: whose turn it is, and what the others are told."""

from typing import Any

import msgspec
from tests.support.factories import UID, app_body, component

from robotapp_api.model.names import Annotation, Label
from robotapp_operator.plan.spec.desired import App
from robotapp_operator.plan.spec.objects import Job
from robotapp_operator.watch.cache import Cache
from robotapp_operator.watch.lister import admitted_instances, describe_turn

MATRIX = {"parameters": [{"name": "seed", "values": ["1", "2", "3"]}], "parallelism": 1}


def make_cache(**matrix: Any) -> tuple[Cache, App]:
    cache = Cache()
    record = cache.update_app(app_body(components=[component("sim", job={})], matrix={**MATRIX, **matrix}))
    assert record.app is not None
    return cache, record.app


def put_job(cache: Cache, app: App, instance: str, *, verdict: str = "") -> None:
    metadata = {
        "name": f"job-{instance}",
        "namespace": "default",
        "uid": f"job-{instance}",
        "labels": {Label.APP_UID.value: UID, Label.INSTANCE.value: instance, Label.COMPONENT.value: "sim"},
        "annotations": {Annotation.RUN_HASH.value: app.run_hashes["sim"]},
        "ownerReferences": [{"kind": "RobotApp", "uid": UID, "controller": True}],
    }
    conditions = [{"type": verdict, "status": "True"}] if verdict else []
    job = msgspec.convert({"metadata": metadata, "spec": {}, "status": {"conditions": conditions}}, Job)
    cache.jobs.put(UID, f"default/job-{instance}", job)


def test_the_first_instance_has_its_turn_and_the_others_are_told_the_number() -> None:
    cache, app = make_cache()
    first, second, third = app.sweep
    assert describe_turn(app, first, cache) == ""
    text = "waits for its turn: 1 of 3 instances run at once (matrix.parallelism)"
    assert [describe_turn(app, name, cache) for name in (second, third)] == [text, text]


def test_a_job_that_has_ended_gives_the_turn_to_the_next_instance() -> None:
    cache, app = make_cache()
    first, second, third = app.sweep
    put_job(cache, app, first)
    assert admitted_instances(app, cache) == {first}
    put_job(cache, app, first, verdict="Failed")
    assert admitted_instances(app, cache) == {second}
    put_job(cache, app, second, verdict="Complete")
    assert describe_turn(app, third, cache) == ""


def test_an_instance_that_has_begun_goes_on_when_the_number_falls() -> None:
    cache, app = make_cache(parallelism=2)
    first, second, third = app.sweep
    put_job(cache, app, first)
    put_job(cache, app, second)
    record = cache.update_app(app_body(generation=2, components=[component("sim", job={})], matrix=MATRIX))
    assert record.app is not None
    assert [describe_turn(record.app, name, cache) for name in (first, second)] == ["", ""]
    assert describe_turn(record.app, third, cache)


def test_an_app_without_a_matrix_waits_for_nobody() -> None:
    cache = Cache()
    record = cache.update_app(app_body())
    assert record.app is not None
    assert describe_turn(record.app, "", cache) == ""
