import json

from hypothesis import given
from hypothesis import strategies as st

from robotapp_scheduler.core.api.annotations import READ, parse_annotations
from robotapp_scheduler.core.api.ros import InvalidAnnotation, RosRequest

JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=20),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=12), inner, max_size=4),
    max_leaves=20,
)
FIELDS = st.sampled_from(
    (
        "latency_budget",
        "deadline",
        "qos_class",
        "preferred_zones",
        "hardware_requirements",
        "peer_pods",
    )
)
TEXTS = st.one_of(
    st.text(max_size=60),
    JSON.map(json.dumps),
    st.dictionaries(FIELDS, JSON, max_size=3).map(json.dumps),
    st.binary(max_size=40).map(lambda raw: raw.decode("utf-8", "surrogateescape")),
)


@given(st.dictionaries(st.sampled_from([str(key) for key in READ]), TEXTS, min_size=1))
def test_any_text_gives_a_request_or_a_refusal_that_can_be_shown(annotations: dict[str, str]) -> None:
    found = parse_annotations(annotations)
    assert isinstance(found, RosRequest | InvalidAnnotation)
    if isinstance(found, InvalidAnnotation):
        assert found.message
        assert found.allowed
    else:
        assert hash(found) == hash(parse_annotations(annotations))
