"""What becomes of a connection that nobody wants any more while it is being made."""

import asyncio
import gc
import socket
from typing import Any

import pytest

from robotapp_client.transport import connect
from robotapp_client.transport.connect import Dialer, handle_loop_error
from robotapp_client.transport.kubeconfig import Endpoint


class Speaker:
    """Ended, or not."""

    ended = False

    def end(self) -> None:
        self.ended = True


@pytest.mark.parametrize("fails", [True, False], ids=["fails", "succeeds"])
async def test_a_handshake_that_outlasts_who_broke_it_off_is_ended_without_a_word(
    monkeypatch: pytest.MonkeyPatch, fails: bool
) -> None:
    loop, begun, over, speaker = asyncio.get_running_loop(), asyncio.Event(), asyncio.Event(), Speaker()
    reported: list[dict[str, Any]] = []
    ours, theirs = socket.socketpair()

    async def connected(*_: object) -> socket.socket:
        return ours

    async def create_connection(*_: object, **__: object) -> tuple[None, Speaker]:
        begun.set()
        await over.wait()
        if fails:
            raise ConnectionResetError
        return None, speaker

    monkeypatch.setattr(connect, "CLOSE_S", 0.0)
    monkeypatch.setattr(connect, "_connected_socket", connected)
    monkeypatch.setattr(loop, "create_connection", create_connection)
    loop.set_exception_handler(lambda _, context: reported.append(context))
    dialer = Dialer(Endpoint("http://server.example"))
    connecting = asyncio.create_task(dialer.connect(Speaker, timeout_s=60.0))
    await begun.wait()
    connecting.cancel()
    with pytest.raises(asyncio.CancelledError):
        await connecting
    over.set()
    for _ in range(3):
        await asyncio.sleep(0)
    gc.collect()
    assert reported == []
    assert speaker.ended != fails
    ours.close()
    theirs.close()


class Told:
    def __init__(self) -> None:
        self.contexts: list[dict[str, object]] = []

    def default_exception_handler(self, context: dict[str, object]) -> None:
        self.contexts.append(context)


class Transport:
    def __init__(self, closed: bool) -> None:
        self.closed = closed

    def __repr__(self) -> str:
        return f"<TCPTransport closed={self.closed} reading=False>"


def test_only_connections_that_we_aborted_ourselves_are_silent() -> None:
    told = Told()
    message = "Fatal error on SSL protocol"
    for context in (
        {"message": message, "transport": Transport(closed=True)},
        {"message": message, "transport": Transport(closed=False)},
        {"message": "Task exception was never retrieved"},
    ):
        handle_loop_error(told, context)  # type: ignore[arg-type]
    assert [each["message"] for each in told.contexts] == [message, "Task exception was never retrieved"]
