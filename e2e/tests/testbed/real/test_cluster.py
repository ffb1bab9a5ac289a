import pytest

from robotapp_testbed import TestbedError
from robotapp_testbed.real import RealNodes


@pytest.mark.parametrize(
    ("names", "delays", "reason"),
    [
        ([], {}, "a cluster has 1 to 200 real nodes, not 0"),
        ([f"n{number}" for number in range(201)], {}, "a cluster has 1 to 200 real nodes, not 201"),
        (["Robot_1"], {}, "'Robot_1' is no node name: use up to 40 small letters, digits and dashes"),
        (["a", "b", "a"], {}, "nodes need different names: a is there twice"),
        (["a", "b"], {("a", "a"): 5}, "a delay is between two nodes, not from a to itself"),
        (["a", "b"], {("a", "c"): 5}, "a delay names c, but the nodes are a, b"),
        (["a", "b"], {("a", "b"): -5}, "the delay between a and b: -5 is not between 0 and 60000"),
        (["a", "b"], {("a", "b"): float("nan")}, "the delay between a and b: nan is not between 0 and 60000"),
        (
            ["a", "b"],
            {("a", "b"): 5, ("b", "a"): 6},
            "the delay between b and a is there twice: it is that of both ways",
        ),
    ],
)
def test_names_are_checked_before_anything_starts(
    names: list[str], delays: dict[tuple[str, str], float], reason: str
) -> None:
    with pytest.raises(TestbedError) as refused:
        RealNodes(names, delays)
    assert str(refused.value) == reason
