from robotapp_scheduler.core.explain.record import histogram, pre_filter_message


def test_the_histogram_sorts_its_entries_as_strings() -> None:
    counts = {"b": 2, "a": 10, "c": 2, "none": 0}
    assert histogram(14, counts) == "0/14 nodes are available: 10 a, 2 b, 2 c."
    assert histogram(0, {}) == "no nodes available to schedule pods"
    assert pre_filter_message(5, "x") == "0/5 nodes are available: x."
