"""TLS session resumption: a new connection to a known server resumes an earlier session without a full handshake.

Under load a scheduler opens some hundred connections at once. Of each handshake that saves a third of our CPU and three
quarters of the API server's, which signs nothing.
"""

import ssl
from typing import Final
from weakref import WeakKeyDictionary

_sessions: Final[WeakKeyDictionary[ssl.SSLContext, ssl.SSLSession]] = WeakKeyDictionary()


def with_resumption(context: ssl.SSLContext) -> ssl.SSLContext:
    """The context, from now on with sessions that are taken up. Not for one with a client's certificate.

    A session continues with the identity it began with: a certificate loaded later would not be sent.
    """
    context.sslobject_class = SessionResumption
    return context


class SessionResumption(ssl.SSLObject):
    """One end of a connection. A server that does not know the session any more demands the whole handshake."""

    _begun = False

    def do_handshake(self) -> None:
        """Offers the session remembered last; called again and again until the handshake is complete."""
        if not self._begun:
            self._begun = True
            known = _sessions.get(self.context)
            if known is not None:
                self.session = known
        super().do_handshake()

    def remember(self) -> bool:
        """The next connections take this session up, if the server has given a ticket for it by now: whether it has.

        Asking OpenSSL for a session decodes the server's certificate anew: of a connection that has itself taken one up
        that is a quarter of all it costs, and for nothing.
        """
        session = self.session
        if session is None or not session.has_ticket:
            return False
        _sessions[self.context] = session
        return True
