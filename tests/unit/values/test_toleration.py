import pytest

from robotapp_api.values.toleration import tolerates
from robotapp_scheduler.core.api.core_v1 import Taint, Toleration

TAINT = Taint(key="gpu", value="yes", effect="NoSchedule")


@pytest.mark.parametrize(
    ("toleration", "expected"),
    [
        (Toleration(operator="Exists"), True),
        (Toleration(key="gpu", operator="Exists"), True),
        (Toleration(key="gpu", operator="Exists", value="ignored"), True),
        (Toleration(key="gpu", value="yes"), True),
        (Toleration(key="gpu", operator="Equal", value="no"), False),
        (Toleration(key="gpu", operator="Exists", effect="NoExecute"), False),
        (Toleration(key="other", operator="Exists"), False),
        (Toleration(key="gpu", operator="Gt", value="0"), False),
    ],
)
def test_a_toleration_covers_a_taint_as_upstream_says(toleration: Toleration, expected: bool) -> None:
    assert tolerates(toleration, TAINT) is expected
