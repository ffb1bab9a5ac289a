"""What a campaign of random objects must keep to."""

from campaigns.fuzz.campaign import KEPT_BYTES, NOISE_BYTES, Samples, memory_problems, time_problems


def samples(*rss_mb: float) -> Samples:
    return Samples(0, [25 * (number + 1) for number in range(len(rss_mb))], [int(1e6 * each) for each in rss_mb])


def test_what_a_process_takes_to_get_warm_is_no_growth() -> None:
    assert list(memory_problems({"operator": samples(80, 100, 101, 101, 101, 101, 101, 101)})) == []


def test_growth_beyond_the_noise_and_what_is_kept_for_an_object_is_told() -> None:
    found = samples(80, 100, *range(101, 161, 4))
    assert found.since_warm[0] == 25 * (len(found.objects) - 1 - found.warm)
    assert found.allowed_bytes == NOISE_BYTES + KEPT_BYTES * found.since_warm[0]
    (problem,) = memory_problems({"scheduler": found})
    assert problem.startswith("scheduler grew by ")


def test_times_are_allowed_what_the_machine_needs_more_for_any_work() -> None:
    ready_s, held_s = [0.5, 2.5, 3.0], {"operator": 1.4}
    told = list(time_problems(ready_s, held_s, bare_s=[0.2, 0.3]))
    assert [text.split(",")[0] for text in told] == [
        "healthy apps were Ready after 2.50 s (median)",
        "the operator took 1.40 s to answer",
    ]
    assert list(time_problems(ready_s, held_s, bare_s=[1.3, 1.2, 4.0])) == []
