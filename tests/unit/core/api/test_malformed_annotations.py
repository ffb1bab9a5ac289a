"""Every wrong annotation is refused in words that let its author mend it."""

import pytest
from tests.support.wrong_input.malformed_annotations import Wrong, malformed_annotations

from robotapp_scheduler.core.api.annotations import parse_annotations
from robotapp_scheduler.core.api.ros import InvalidAnnotation


def test_there_are_at_least_fifty_different_ones() -> None:
    assert len({(wrong.key, wrong.text) for wrong in malformed_annotations()}) >= 50


@pytest.mark.parametrize("wrong", malformed_annotations(), ids=str)
def test_a_wrong_annotation_is_refused_by_key_field_value_and_what_is_allowed(wrong: Wrong) -> None:
    refused = parse_annotations({str(wrong.key): wrong.text})
    assert isinstance(refused, InvalidAnnotation)
    for part in (wrong.key, wrong.field, wrong.shown, wrong.allowed):
        assert part in refused.message
