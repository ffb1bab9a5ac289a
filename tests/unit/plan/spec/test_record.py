"""A RobotApp as read: parsed once per generation, unreadable ones explained."""

from tests.support.factories import app_body

from robotapp_api.model.names import Reason
from robotapp_operator.plan.spec.record import parse_record


def test_identity_and_wish_are_read() -> None:
    record = parse_record(app_body(generation=3))
    assert (record.name, record.namespace, record.uid, record.generation) == ("teleop", "default", "uid-1", 3)
    assert record.app is not None
    assert [component.name for component in record.app.spec.components] == ["operator", "driver"]
    assert not record.deleting


def test_a_spec_this_version_cannot_read_becomes_problems_with_fields() -> None:
    record = parse_record(app_body(components="none", suspend="perhaps"))
    assert record.app is None
    fields = {problem.field for problem in record.problems}
    assert fields == {"spec.components", "spec.suspend"}
    assert {problem.reason for problem in record.problems} == {Reason.INVALID_SPEC}
    assert "kubectl explain" in record.problems[0].message


def test_an_object_without_a_spec_is_no_crash() -> None:
    assert parse_record({"metadata": {"name": "x", "uid": "u"}}).problems


def test_a_status_write_reuses_the_parsed_spec() -> None:
    first = parse_record(app_body())
    second = parse_record(app_body() | {"status": {"phase": "Running"}}, known=first)
    assert first.app is not None
    assert second.app is not None
    assert second.app.spec is first.app.spec
    assert second.spec_version == first.spec_version


def test_an_app_that_names_no_scheduler_gets_the_operators() -> None:
    silent = parse_record(app_body(), default_scheduler="volcano").app
    named = parse_record(app_body(schedulerName="default-scheduler"), default_scheduler="volcano").app
    assert silent is not None
    assert named is not None
    assert (silent.scheduler_name, silent.our_scheduler) == ("volcano", False)
    assert named.scheduler_name == "default-scheduler"


def test_another_generation_is_parsed_anew() -> None:
    first = parse_record(app_body())
    second = parse_record(app_body(generation=2, suspend=True), known=first)
    assert second.app is not None
    assert second.app.spec.suspend is True
    assert second.spec_version != first.spec_version


def test_versions_that_are_no_numbers_are_older_than_all() -> None:
    body = app_body()
    body["metadata"]["resourceVersion"] = "opaque"
    assert parse_record(body).version_number == 0
