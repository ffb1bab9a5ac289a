"""From answers to exceptions."""

import json

import pytest

from robotapp_client.transport import errors
from robotapp_client.transport.errors import ApiError, Status, describe, error_from_response, error_from_status


def answer(code: int, **status: object) -> ApiError:
    return error_from_response(code, {}, json.dumps({"kind": "Status", "code": code, **status}).encode())


@pytest.mark.parametrize(
    ("code", "reason", "kind"),
    [
        (400, "BadRequest", errors.BadRequest),
        (401, "Unauthorized", errors.Unauthorized),
        (403, "Forbidden", errors.Forbidden),
        (404, "NotFound", errors.NotFound),
        (409, "Conflict", errors.Conflict),
        (409, "AlreadyExists", errors.AlreadyExists),
        (410, "Expired", errors.Gone),
        (415, "UnsupportedMediaType", ApiError),
        (422, "Invalid", errors.Invalid),
        (429, "TooManyRequests", errors.TooManyRequests),
        (500, "InternalError", errors.ServerError),
        (503, "ServiceUnavailable", errors.ServerError),
        (504, "Timeout", errors.ServerError),
        (302, "", ApiError),
    ],
)
def test_each_status_has_its_exception(code: int, reason: str, kind: type[ApiError]) -> None:
    error = answer(code, reason=reason, message="m")
    assert type(error) is kind
    assert (error.status, error.reason, error.message) == (code, reason, "m")


def test_an_existing_name_is_not_a_conflict() -> None:
    assert not issubclass(errors.AlreadyExists, errors.Conflict)


def test_a_namespace_that_is_being_deleted_is_more_than_a_missing_right() -> None:
    cause = {
        "field": "metadata.namespace",
        "reason": "NamespaceTerminating",
        "message": "namespace a is being terminated",
    }
    error = answer(403, reason="Forbidden", details={"causes": [cause]})
    assert type(error) is errors.NamespaceTerminating
    assert isinstance(error, errors.Forbidden), "who treats all refusals alike need not have heard of it"


def test_causes_name_the_fields() -> None:
    cause = {"field": "spec.x", "reason": "FieldValueInvalid", "message": "too big"}
    assert answer(422, details={"causes": [cause]}).causes == (("spec.x", "FieldValueInvalid", "too big"),)


@pytest.mark.parametrize(
    ("error", "another"),
    [
        (answer(409, message="Precondition failed: UID in precondition: a, UID in object meta: b"), True),
        (
            answer(
                409, message='pods/binding "x": the UID in the precondition (a) does not match the UID in record (b)'
            ),
            True,
        ),
        (answer(409, message='pods "guide-robot": the object has been modified'), False),
        (answer(422, details={"causes": [{"field": "metadata.uid", "message": "field is immutable"}]}), True),
        (answer(422, details={"causes": [{"field": "spec.uid", "message": "too long"}]}), False),
        (answer(404, message='pods "uid" not found'), False),
    ],
)
def test_a_write_that_names_its_uid_learns_that_the_name_is_another_objects(error: ApiError, another: bool) -> None:
    assert errors.means_another(error) is another


@pytest.mark.parametrize(
    ("status", "passes"), [(500, True), (504, True), (429, True), (409, True), (403, False), (422, False)]
)
def test_a_refusal_may_pass_where_the_server_or_others_are_the_reason(status: int, *, passes: bool) -> None:
    assert errors.may_pass(answer(status)) is passes
    assert errors.may_pass(errors.Unreachable("nobody there", maybe_applied=False))


def test_the_header_wins_over_the_details_for_retry_after() -> None:
    body = json.dumps({"details": {"retryAfterSeconds": 9}}).encode()
    assert error_from_response(429, {"Retry-After": "2"}, body).retry_after_s == 2
    assert error_from_response(429, {}, body).retry_after_s == 9
    assert error_from_response(429, {}, b"{}").retry_after_s is None


@pytest.mark.parametrize("header", ["soon", "Wed, 21 Oct 2015 07:28:00 GMT", "-1", "nan", "inf"])
def test_an_unreadable_retry_after_is_none(header: str) -> None:
    assert error_from_response(503, {"Retry-After": header}, b"").retry_after_s is None


@pytest.mark.parametrize("body", [b"", b"<html>bad gateway", b"\xff\xfe", b"[1]", b'{"message": 7}', b"null"])
def test_any_body_makes_an_error(body: bytes) -> None:
    error = error_from_response(502, {}, body)
    assert isinstance(error, errors.ServerError)
    assert str(error)


def test_only_server_errors_may_have_been_applied() -> None:
    assert answer(504).maybe_applied
    assert not answer(429).maybe_applied
    assert not answer(409).maybe_applied


def test_an_error_event_carries_its_own_code() -> None:
    assert isinstance(error_from_status(Status(code=410, reason="Expired")), errors.Gone)
    assert isinstance(error_from_status(Status()), errors.ServerError)


def test_log_fields_are_the_same_for_every_error() -> None:
    assert describe(answer(504, reason="Timeout", message="m")) == {
        "error": "ServerError",
        "message": "m",
        "status": 504,
        "reason": "Timeout",
        "maybe_applied": True,
    }
    assert describe(errors.Unreachable("x", maybe_applied=True))["maybe_applied"] is True
    assert "ServerError(504" in repr(answer(504))
