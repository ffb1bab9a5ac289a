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
    assert "[2/2] compiling kube-apiserver: about 47 s left" in stream.getvalue()


def test_a_long_step_says_every_twenty_seconds_that_it_lives() -> None:
    progress, stream, clock = started()
    with progress.step("compiling etcd"):
        for _ in range(5):
            clock.now_s += 9
            progress.redraw()
    assert stream.getvalue().count("compiling etcd: 27 s, ") == 1
    assert len(stream.getvalue().splitlines()) == 3


def test_a_terminal_gets_one_bar_that_is_redrawn() -> None:
    progress, stream, clock = started(interactive=True)
    with progress.step("compiling etcd") as note:
        clock.now_s += 12.5
        note("net/http")
        progress.redraw()
    assert "\r\x1b[2K[1/2] compiling etcd ████████████░░░░░░░░░░░░ about 4 min left net/http" in stream.getvalue()
    assert stream.getvalue().endswith("\r\x1b[2K[1/2] compiling etcd: done in 12 s\n")
