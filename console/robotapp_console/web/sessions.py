"""Sessions: in encrypted cookies, or of the one person the console was started by."""

import hashlib
import hmac
import json
import secrets
import time
from base64 import urlsafe_b64encode
from dataclasses import dataclass, field
from typing import Final

from cryptography.fernet import Fernet, InvalidToken

from robotapp_client import Endpoint

LONGEST_S: Final = 8 * 3600
MOST_COOKIE: Final = 3800
"""Browsers drop cookies above 4096 bytes, the name and attributes included."""


@dataclass(frozen=True, slots=True)
class Caller:
    """The maker of a request. `key` distinguishes callers and reveals no token; `session` is what the CSRF token belongs to."""

    key: str
    endpoint: Endpoint = field(repr=False)
    session: str = field(repr=False)
    user: str = ""
    home: str = ""
    """Namespace to show where all of them may not be read."""
    ends_s: float = float("inf")
    """Seconds since 1970 at which the session ends."""
    may_sign_out: bool = False


@dataclass(frozen=True, slots=True)
class Session:
    """The content of a signed-in user's cookie."""

    token: str = field(repr=False)
    user: str
    home: str
    id: str
    ends_s: float


class Seal:
    """Encrypts sessions for cookies and signs CSRF tokens, with keys made of one secret."""

    def __init__(self, secret: bytes) -> None:
        self._fernet = Fernet(urlsafe_b64encode(_derive(secret, b"cookie")))
        self._signing = _derive(secret, b"csrf")
        self._ended: dict[str, float] = {}
        """Sessions that were signed out, until they would have ended anyway."""

    def __repr__(self) -> str:
        return "<Seal>"

    def open_session(self, token: str, *, user: str, home: str) -> tuple[Session, str]:
        """Returns a new session and its cookie. Raises ValueError when the token is too long for one."""
        session = Session(token, user, home, secrets.token_urlsafe(18), time.time() + LONGEST_S)
        content = {"t": token, "u": user, "h": home, "i": session.id, "e": session.ends_s}
        cookie = self._fernet.encrypt(json.dumps(content).encode()).decode()
        if len(cookie) > MOST_COOKIE:
            raise ValueError(f"the token has {len(token)} characters, which is too long for a cookie")
        return session, cookie

    def read_session(self, cookie: str) -> Session | None:
        """Returns the session of a cookie; None when it was not made here, was changed, has ended or was signed out."""
        try:
            content = json.loads(self._fernet.decrypt(cookie.encode(), ttl=LONGEST_S))
        except (InvalidToken, ValueError):
            return None
        session = Session(content["t"], content["u"], content["h"], content["i"], content["e"])
        return session if session.ends_s > time.time() and session.id not in self._ended else None

    def end_session(self, session: Session) -> None:
        """Makes the session's cookie worthless, also a copy of it.

        This process alone knows that: with a secret from a file, a copy is good in another replica and after a restart, until the
        session would have ended.
        """
        now_s = time.time()
        self._ended = {key: until_s for key, until_s in self._ended.items() if until_s > now_s}
        self._ended[session.id] = session.ends_s

    def sign(self, session: str) -> str:
        """Returns the CSRF token of a session."""
        return hmac.new(self._signing, session.encode(), hashlib.sha256).hexdigest()

    def is_signed(self, session: str, signature: str) -> bool:
        return hmac.compare_digest(self.sign(session).encode(), signature.encode("utf-8", "replace"))


def _derive(secret: bytes, purpose: bytes) -> bytes:
    return hmac.new(secret, purpose, hashlib.sha256).digest()


def hash_token(token: str) -> str:
    """Returns a key for what belongs to a token; the token cannot be found from it."""
    return hashlib.sha256(token.encode("utf-8", "surrogateescape")).hexdigest()


class LocalDoor:
    """The one-time addresses of the local console, and the sessions they opened."""

    def __init__(self) -> None:
        self._secret = secrets.token_urlsafe(24)
        self._sessions: set[str] = set()

    def __repr__(self) -> str:
        return f"<LocalDoor {len(self._sessions)} sessions>"

    @property
    def path(self) -> str:
        """The path that opens a session once."""
        return f"/open?pass={self._secret}"

    def open_session(self, secret: str) -> str | None:
        """Returns a new session's id for the secret of the newest address, which opens no second one; None for another secret."""
        if not hmac.compare_digest(secret.encode("utf-8", "replace"), self._secret.encode()):
            return None
        self._secret = secrets.token_urlsafe(24)
        session = secrets.token_urlsafe(24)
        self._sessions.add(session)
        return session

    def is_open(self, session: str) -> bool:
        return session in self._sessions
