import io

from robotapp_testbed.progress import Progress

PLAN = [("compiling etcd", 25.0), ("compiling kube-apiserver", 235.0)]


class Clock:
    def __init__(self) -> None:
        self.now_s = 100.0

    def __call__(self) -> float:
        return self.now_s


def started(*, interactive: bool = False) -> tuple[Progress, io.StringIO, Clock]:
    stream, clock = io.StringIO(), Clock()
    progress = Progress(stream, interactive=interactive, clock=clock)
    progress.plan(PLAN)
    return progress, stream, clock


def test_lines_name_step_number_and_time_left() -> None:
    progress, stream, clock = started()
    with progress.step("compiling etcd"):
        clock.now_s += 5
    assert stream.getvalue() == "[1/2] compiling etcd: about 4 min left\n[1/2] compiling etcd: done in 5 s\n"


def test_what_finished_steps_took_corrects_the_rest() -> None:
    progress, stream, clock = started()
    with progress.step("compiling etcd"):
        clock.now_s += 5  # a fifth of what was expected: the compiler's cache is warm
    with progress.step("compiling kube-apiserver"):
        pass
    assert "[2/2] compiling kube-apiserver: about 78 s left" in stream.getvalue()


def test_a_long_step_says_every_twenty_seconds_that_it_lives() -> None:
    progress, stream, clock = started()
    with progress.step("compiling kube-apiserver") as note:
        for package in ("net/http", "k8s.io/api/core/v1", "k8s.io/api/apps/v1"):
            note(package)
            clock.now_s += 9
            progress.redraw()
    _, alive, done = stream.getvalue().splitlines()
    assert alive == "[2/2] compiling kube-apiserver: 27 s, about 3 min left (k8s.io/api/apps/v1)"
    assert done == "[2/2] compiling kube-apiserver: done in 27 s"


def test_a_terminal_gets_one_bar_that_is_redrawn() -> None:
    progress, stream, clock = started(interactive=True)
    with progress.step("compiling etcd") as note:
        clock.now_s += 12.5
        note("net/http")
        progress.redraw()
    assert "\r\x1b[2K[1/2] compiling etcd ████████████░░░░░░░░░░░░ about 4 min left net/http" in stream.getvalue()
    assert stream.getvalue().endswith("\r\x1b[2K[1/2] compiling etcd: done in 12 s\n")


def test_a_late_step_says_how_long_it_has_run_and_not_that_it_is_nearly_done() -> None:
    progress, stream, clock = started()
    with progress.step("compiling etcd"):
        for _ in range(4):
            clock.now_s += 20
            progress.redraw()
    first, *late, _ = [line.removeprefix("[1/2] compiling etcd: ") for line in stream.getvalue().splitlines()]
    assert first == "about 4 min left"
    assert late == [
        "20 s, about 4 min left",
        "longer than expected, 40 s so far, then about 6 min",
        "longer than expected, 60 s so far, then about 8 min",
        "longer than expected, 80 s so far, then about 11 min",
    ]


def test_the_bar_of_a_late_step_is_full() -> None:
    progress, stream, clock = started(interactive=True)
    with progress.step("compiling kube-apiserver"):
        clock.now_s += 1000
        progress.redraw()
    assert f"kube-apiserver {'█' * 24} longer than expected, 1000 s so far " in stream.getvalue()
