"""The report and the picture, from results made by hand."""

from collections.abc import Callable
from dataclasses import replace

from defusedxml.ElementTree import fromstring
from hypothesis import given, settings
from hypothesis import strategies as st

from campaigns.teleop import analysis, plot
from campaigns.teleop.design import CLOUD, FAR, NEAR, ROBOT, Arm, Turn, plan_turns
from campaigns.teleop.metrics import NO_TRIP, Figures
from campaigns.teleop.records import Deployment, Header, Load, Results

TURNS = plan_turns(3)
SVG = "{http://www.w3.org/2000/svg}"


def results(
    make: Callable[[Turn], tuple[str, Figures]], turns: list[Turn] = TURNS, *, busy: float = 0.5, pilot: bool = False
) -> Results:
    deployments = []
    for turn in turns:
        node, figures = make(turn)
        deployments.append(Deployment(turn, 1, "", node=node, figures=figures, load=Load(1.0, busy, 0.0)))
    return Results(Header(3, 4, pilot=pilot), deployments=tuple(deployments))


def figures(missed: float, p95_ms: float = 8.0, first_trip_s: float = 4.0) -> Figures:
    return Figures(first_trip_s, 5.0, p95_ms, p95_ms, missed_share=missed, sent=160, answered=160)


def place_well(turn: Turn) -> tuple[str, Figures]:
    """Ours avoids what is disturbed; affinity stays; kube-scheduler goes to the cloud every third time."""
    if turn.arm is Arm.OURS:
        return (FAR if turn.condition.worse_link or turn.condition.ballast else NEAR), figures(0.0)
    if turn.arm is Arm.AFFINITY:
        return NEAR, figures(1.0 if turn.condition.worse_link else 0.0)
    return (CLOUD, figures(1.0, 62.0)) if turn.block % 3 == 0 else (NEAR, figures(0.0))


def verdicts(made: Results) -> dict[tuple[str, int], str]:
    blocks = analysis.list_blocks(made.deployments)
    return {
        (one.hypothesis, one.ros): one.verdict for ros in (1, 2) for one in analysis.examine_hypotheses(blocks, ros)
    }


def test_an_arm_that_misses_fewer_deadlines_is_better() -> None:
    named = verdicts(results(place_well))
    assert {named[key, ros] for key in ("H1", "H2") for ros in (1, 2)} == {"better"}
    assert {named[key, ros] for key in ("H3", "H4") for ros in (1, 2)} == {"holds"}


def test_a_loss_and_a_tie_are_named_as_such() -> None:
    lost = verdicts(results(lambda turn: (NEAR, figures(0.4 if turn.arm is Arm.OURS else 0.0, first_trip_s=4))))
    assert {lost["H1", 1], lost["H2", 2]} == {"worse"}
    assert lost["H3", 1] == "not shown"
    tied = verdicts(results(lambda _: (NEAR, figures(0.25))))
    assert {tied["H1", 1], tied["H2", 2]} == {"equivalent"}


def test_ours_may_not_be_a_second_later() -> None:
    late = verdicts(results(lambda turn: (NEAR, figures(0.0, first_trip_s=5.2 if turn.arm is Arm.OURS else 4.0))))
    assert late["H4", 1] == late["H4", 2] == "not shown"


def test_a_block_without_every_arm_is_no_pair_but_is_described() -> None:
    made = results(place_well, TURNS[:5])
    assert len(analysis.list_blocks(made.deployments)) == 1
    text = "\n".join(analysis.report(made))
    assert "UNFINISHED: 5 of 192 deployments." in text
    assert "5 deployments, 1 complete blocks" in text


def test_ours_beyond_the_budget_contradicts_h5() -> None:
    assert "| 0 of 64 | **holds** |" in "\n".join(analysis.report(results(place_well)))
    beyond = "\n".join(analysis.report(results(lambda _: (CLOUD, figures(1.0)))))
    assert "| 64 of 64 | **contradicted** |" in beyond
    unplaced = "\n".join(analysis.report(results(lambda _: ("", NO_TRIP))))
    assert "| 0 of 0 | **not shown** |" in unplaced


def test_placements_are_counted_with_those_within_the_budget() -> None:
    text = analysis.report(results(place_well))
    assert "| ROS 2 | worse link | affinity | 4 | 0 | 0 | 0 | 0 of 4 |" in text
    assert "| ROS 1 | undisturbed | ours | 12 | 0 | 0 | 0 | 12 of 12 |" in text


def test_operator_sides_that_are_on_the_robot_or_nowhere_are_counted_elsewhere() -> None:
    text = analysis.report(results(lambda turn: (ROBOT if turn.arm is Arm.OURS else "", figures(1.0))))
    assert "| ROS 2 | all conditions | ours | 0 | 0 | 0 | 32 | 32 of 32 |" in text
    assert "| ROS 2 | all conditions | affinity | 0 | 0 | 0 | 32 | 0 of 32 |" in text


def test_busy_blocks_are_left_out_of_the_sensitivity_analysis() -> None:
    text = "\n".join(analysis.report(results(place_well, busy=0.95)))
    assert "CPU time was busy (64):" in text
    assert text.count("| H1 |") == 2


def test_a_pilot_is_marked_in_the_report_and_in_the_picture() -> None:
    made = results(place_well, TURNS[:6], pilot=True)
    assert analysis.report(made)[0] == "PILOT: these deployments count for nothing."
    assert "pilot: counts for nothing" in plot.draw(made)


def test_nothing_is_reported_as_nothing() -> None:
    assert "0 deployments, 0 complete blocks" in "\n".join(analysis.report(Results(Header(3, 4, pilot=False))))
    fromstring(plot.draw(Results(Header(3, 4, pilot=False))))


def test_the_picture_has_a_box_and_the_dots_of_every_arm() -> None:
    picture = fromstring(plot.draw(results(place_well)))
    assert len(list(picture.iter(f"{SVG}circle"))) == 3 * 192
    assert len([one for one in picture.iter(f"{SVG}rect") if one.get("fill-opacity")]) == 3 * 2 * 3


def test_deployments_without_a_round_trip_stay_in_the_sensitivity_analysis() -> None:
    silent = replace(results(lambda _: ("", NO_TRIP)).deployments[0], load=None)
    assert not analysis.was_busy(silent)


VALUES = st.lists(st.floats(0, 1e6), min_size=1, max_size=40)


@given(VALUES)
def test_a_box_is_in_order_and_within_its_values(values: list[float]) -> None:
    box = plot.summarise_box(values)
    assert min(values) <= box.low <= box.first <= box.median <= box.third <= box.high <= max(values)


@settings(max_examples=20, deadline=None)
@given(st.floats(0, 1), st.floats(0, 5000), st.floats(-1, 100))
def test_every_mark_is_inside_of_its_panel(missed: float, p95_ms: float, first_trip_s: float) -> None:
    made = results(lambda _: (NEAR, figures(missed, p95_ms, first_trip_s)), TURNS[:3])
    for circle in fromstring(plot.draw(made)).iter(f"{SVG}circle"):
        assert 0 <= float(circle.get("cy", "nan")) <= plot.PANEL_HEIGHT
