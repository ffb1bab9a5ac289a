"""When it pays to leave rows in doubt, and for how long nothing is doubted where it did not."""

from robotapp_scheduler.core.runtime.score_bounds import MOST_LOOKS, REST, SOON, WINDOW, BoundsPayoff


def pause(patience: BoundsPayoff) -> int:
    """Decisions until rows may be doubted again."""
    decisions = 0
    while patience.rest():
        decisions += 1
    return decisions


def test_it_pays_while_at_most_half_of_the_changed_rows_are_looked_at_one_by_one() -> None:
    for looked, pays in ((1, True), (2, False)):
        patience = BoundsPayoff()
        answers = []
        for _ in range(WINDOW + 1):
            patience.begin(2)
            answers.append(patience.pays)
            patience.look(looked)
        assert answers[WINDOW - 1] is pays
        assert all(answers[: WINDOW - 1]), "asked once per window only"


def test_asking_whether_it_pays_changes_nothing() -> None:
    patience = BoundsPayoff()
    for _ in range(WINDOW):
        patience.begin(1)
        patience.look(1)
    assert [patience.pays for _ in range(3)] == [False] * 3


def test_many_rows_to_look_at_in_one_decision_are_added_up_together() -> None:
    patience = BoundsPayoff()
    patience.begin(1)
    patience.look(MOST_LOOKS)
    assert not patience.overtaxed
    patience.look(1)
    assert patience.overtaxed
    patience.begin(1)
    assert not patience.overtaxed


def test_each_loss_doubles_the_rest_until_it_went_well_for_long_enough() -> None:
    patience = BoundsPayoff()
    for expected in (REST, 2 * REST, 4 * REST):
        assert patience.lose()
        assert pause(patience) == expected
    for _ in range(SOON):
        patience.begin(1)
    assert not patience.lose()
    patience.added_up()
    assert patience.lose()
    assert pause(patience) == REST
