"""Which topics are recorded, with which service."""

import pytest

from robotapp_recorder.definitions import list_used_types, write_definition
from robotapp_recorder.settings import read_settings
from robotapp_recorder.topics import Offer, Selection, Wanted, choose_subscriptions, describe_qos

STRING = "std_msgs/msg/String"
BOUNDS = ["--folder", "/b", "--name", "n", "--split-bytes", "10", "--retain-bytes", "100"]


@pytest.mark.parametrize(
    ("selection", "topic", "wanted"),
    [
        (Selection(frozenset({"/scan"})), "/scan", True),
        (Selection(frozenset({"/scan"})), "/scan/raw", False),
        (Selection(regex="/camera/.*"), "/camera/image", True),
        (Selection(regex="/camera"), "/camera/image", False),
        (Selection(regex=".*", exclude="/rosout|/camera/.*"), "/camera/image", False),
        (Selection(frozenset({"/scan"}), exclude="/scan"), "/scan", False),
    ],
)
def test_a_whole_name_must_match_and_exclude_wins(selection: Selection, topic: str, *, wanted: bool) -> None:
    assert selection.wants(topic) is wanted


def test_a_subscription_asks_for_what_all_publishers_offer() -> None:
    offers = {
        "/a": [Offer(STRING, True, True), Offer(STRING, True, True)],
        "/b": [Offer(STRING, True, True), Offer(STRING, False, False)],
        "/c": [],
        "/d": [Offer(STRING, True, False)],
    }
    wanted, problems = choose_subscriptions(Selection(regex=".*"), offers, ["/d"])
    assert wanted == [Wanted("/a", STRING, True, True), Wanted("/b", STRING, False, False)]
    assert problems == []


def test_a_topic_of_two_types_is_named_with_both() -> None:
    offers = {"/a": [Offer(STRING, True, False), Offer("std_msgs/msg/Int32", True, False)]}
    wanted, problems = choose_subscriptions(Selection(regex=".*"), offers, [])
    assert wanted == []
    assert problems == [
        "/a is not recorded: its publishers have different types (std_msgs/msg/Int32, std_msgs/msg/String)"
    ]


def test_the_offered_service_is_written_as_rosbag2_writes_it() -> None:
    text = describe_qos(Wanted("/a", STRING, False, True), depth=5)
    assert "reliability: best_effort" in text
    assert "durability: transient_local" in text


FILES = {
    ("geometry_msgs", "Twist"): "Vector3  linear # m/s\nVector3  angular\n",
    ("geometry_msgs", "Vector3"): "float64 x\nfloat64 y\nfloat64 z\n",
    ("p", "All"): "int8 ONE=1\nstring<=5 a\nfloat32[<=3] b\ngeometry_msgs/Twist[] c\nnot_there/X d\n",
}


def read(package: str, name: str) -> str | None:
    return FILES.get((package, name))


def test_a_definition_holds_the_types_it_uses_once() -> None:
    text = write_definition("geometry_msgs/msg/Twist", read)
    assert text is not None
    assert text.count("MSG: geometry_msgs/Vector3") == 1
    assert text.startswith("Vector3  linear")


def test_a_definition_without_a_part_of_it_is_none() -> None:
    assert list_used_types(FILES["p", "All"], "p") == ["geometry_msgs/Twist", "not_there/X"]
    assert write_definition("p/msg/All", read) is None


@pytest.mark.parametrize(
    ("arguments", "error"),
    [
        ([*BOUNDS], "nothing would be recorded"),
        ([*BOUNDS, "--regex", "("], "--regex is no regular expression"),
        (["--folder", "/b", "--name", "n", "--split-bytes", "10", "--retain-bytes", "5", "--topic", "/a"], "at most"),
    ],
)
def test_wrong_arguments_are_named(arguments: list[str], error: str) -> None:
    with pytest.raises(ValueError, match=error):
        read_settings(arguments)


def test_arguments_become_settings() -> None:
    settings = read_settings([*BOUNDS, "--topic", "/a", "--topic", "/b", "--exclude", "/x", "--split-seconds", "1.5"])
    assert settings.selection == Selection(frozenset({"/a", "/b"}), "", "/x")
    assert settings.limits.split_ns == 1_500_000_000
