import pytest

from robotapp_api.model.names import Label
from robotapp_testbed import TestbedError
from robotapp_testbed.nodes import robot
from robotapp_testbed.real import RealNodes


@pytest.mark.parametrize(
    "names", [[], ["a", "a"], [f"n{number}" for number in range(201)]], ids=["none", "twice", "many"]
)
def test_names_are_checked_before_anything_starts(names: list[str]) -> None:
    with pytest.raises(TestbedError, match="1 to 200 real nodes with different names"):
        RealNodes(names)


def test_a_node_of_the_factories_keeps_its_labels_but_for_those_of_the_machine() -> None:
    (description,) = RealNodes([robot("amr-07", zone="hall-2", labels={"colour": "red"})])._descriptions
    assert description.name == "amr-07"
    assert description.labels[Label.ZONE] == "hall-2"
    assert description.labels["colour"] == "red"
    assert not {Label.SIMULATED, Label.HOSTNAME, "kubernetes.io/arch"} & description.labels.keys()


def test_what_is_not_started_says_so() -> None:
    plane = RealNodes(["a"])
    plane.close()
    with pytest.raises(TestbedError, match="not started"):
        _ = plane.addresses
    with pytest.raises(TestbedError, match="no node b"):
        plane.node("b")
    with pytest.raises(TestbedError, match="pass delays"):
        _ = plane.switch
