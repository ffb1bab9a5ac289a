"""How far a simulation is: told on a terminal, twice a second, and gone in the end."""

import io

from tests.support.scheduling import Clock

from robotapp_scheduler.simulation.report import CLEAR, Progress, replace_line


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def test_a_terminal_is_told_twice_a_second_and_the_line_goes_in_the_end() -> None:
    clock, terminal = Clock(), Terminal()
    progress = Progress(terminal, clock=clock)
    for decided in range(1, 7):
        clock.forward(0.25)
        progress(decided, 4)
    progress.end()
    assert terminal.getvalue().split(CLEAR) == [
        "",
        "2 of 4 pods decided",
        "4 of 4 pods decided",
        "4 of 4 pods decided, trying 2 refused ones again",
        "",
    ]


def test_what_is_done_now_replaces_what_was_before_on_a_terminal_only() -> None:
    terminal, pipe = Terminal(), io.StringIO()
    for stream in (terminal, pipe):
        for text in ("first", "second", ""):
            replace_line(stream, text)
    assert terminal.getvalue().split(CLEAR) == ["", "first", "second", ""]
    assert pipe.getvalue() == ""


def test_neither_a_pipe_nor_a_short_simulation_shows_anything() -> None:
    clock, pipe, terminal = Clock(), io.StringIO(), Terminal()
    for stream in (pipe, terminal):
        progress = Progress(stream, clock=clock)
        if stream is pipe:
            clock.forward(10)
        progress(1, 1)
        progress.end()
        assert stream.getvalue() == ""
