"""Two agents' ends of a probe without sockets, and their keys."""

from collections.abc import Callable

from robotapp_agent.probe.keys import KeyRing
from robotapp_agent.probe.prober import Prober
from robotapp_agent.probe.responder import Responder

SECRET = b"0123456789abcdef" * 2
OTHER_SECRET = b"fedcba9876543210" * 2
SESSION = b"session1"
PROBERS_SECRET = b"of the prober"
TIMEOUT_NS = 2_000_000_000


def ring(*secrets: bytes) -> KeyRing:
    made = KeyRing()
    made.update({f"key-{index}": secret for index, secret in enumerate(secrets or (SECRET,))}, now_s=0)
    return made


def prober(name: str = "a", *, keys: KeyRing | None = None, secret: bytes = PROBERS_SECRET) -> Prober:
    return Prober(own_name=name, keys=keys or ring(), secret=secret)


def responder(name: str = "b", *, keys: KeyRing | None = None, clock_ns: Callable[[], int] = lambda: 0) -> Responder:
    return Responder(own_name=name, keys=keys or ring(), clock_ns=clock_ns)


def reply_of(end: Responder, request: bytes, *, source: str = "10.0.0.1", received_ns: int = 0) -> bytes:
    """Its reply; fails when there is none."""
    reply = end.answer(request, source=source, received_ns=received_ns)
    assert reply
    return reply


def request_of(sender: Prober, peer: str = "b", *, at_ns: int = 0) -> bytes:
    """The next request as it leaves."""
    request = sender.request(peer)
    assert request is not None
    sender.sent(request, peer=peer, at_ns=at_ns)
    return request.data


def state(end: Responder | Prober) -> str:
    """All that an end remembers, as text."""
    return repr(sorted((name, repr(_inside(value))) for name, value in vars(end).items()))


def _inside(value: object) -> object:
    return getattr(value, "__dict__", value)
