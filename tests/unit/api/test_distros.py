"""The table of ROS distributions."""

from datetime import date

import pytest

from robotapp_api.model.distros import DISTROS, nearest


def test_every_ros_2_distribution_has_a_middleware_and_no_ros_1_one_has() -> None:
    assert all(bool(distro.rmw) == (distro.version == 2) for distro in DISTROS.values())


def test_support_ends_after_its_last_day() -> None:
    noetic = DISTROS["noetic"]
    assert not noetic.is_past_end_of_life(date(2025, 5, 31))
    assert noetic.is_past_end_of_life(date(2025, 6, 1))
    assert not DISTROS["rolling"].is_past_end_of_life(date(2100, 1, 1))


@pytest.mark.parametrize(
    ("typo", "meant"), [("humbel", "humble"), ("Jazy", "jazzy"), ("neotic", "noetic"), ("quux", "")]
)
def test_the_nearest_name_is_offered_for_a_typo(typo: str, meant: str) -> None:
    assert nearest(typo) == meant
