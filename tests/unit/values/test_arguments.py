"""Names, seconds and ports as people write them."""

from argparse import ArgumentTypeError

import pytest

from robotapp_api.values import arguments


def test_what_is_right_is_converted() -> None:
    assert arguments.names(" a, b.c ,,") == ("a", "b.c")
    assert (arguments.name(""), arguments.name("robotapp-system")) == ("", "robotapp-system")
    assert (arguments.seconds("0.5"), arguments.seconds("30")) == (0.5, 30.0)
    assert (arguments.port("0"), arguments.port("65535")) == (0, 65535)


@pytest.mark.parametrize("text", ["0", "-1", "nan", "inf", "x", ""])
def test_a_period_that_would_be_a_loop_without_a_pause_is_refused(text: str) -> None:
    with pytest.raises(ArgumentTypeError, match="is not a number of seconds above zero"):
        arguments.seconds(text)


@pytest.mark.parametrize("text", ["65536", "-1", "http", "", "1.5", "²"])
def test_what_is_no_port_is_refused(text: str) -> None:
    with pytest.raises(ArgumentTypeError, match="ports are 0 to 65535"):
        arguments.port(text)


@pytest.mark.parametrize("text", ["a b", "a/b", "A", "-a", "a..b", ".", "é"])
def test_what_is_no_name_is_refused(text: str) -> None:
    with pytest.raises(ArgumentTypeError, match="is not a name"):
        arguments.names(f"fine,{text}")
