"""Round trips of commands: which are on their way, how long the others took, and which came too late."""

import math
from collections import OrderedDict


class RoundTrips:
    """A command that is not answered within `given_up` deadlines counts as lost. Times are seconds of one clock."""

    def __init__(self, deadline_ms, given_up=20):
        self.deadline_ms = deadline_ms
        self._lost_after_s = given_up * deadline_ms / 1000
        self._pending = OrderedDict()
        self._rtts_ms = []
        self.sent = 0
        self.late = 0

    def send(self, key, now_s):
        """Notes a command under a key that its answer will carry."""
        self.sent += 1
        self._pending[key] = now_s

    def answer(self, key, now_s):
        """Returns the round trip in ms, or None for a key that waits for no answer."""
        sent_s = self._pending.pop(key, None)
        if sent_s is None:
            return None
        rtt_ms = (now_s - sent_s) * 1000
        self._rtts_ms.append(rtt_ms)
        self.late += rtt_ms > self.deadline_ms
        return rtt_ms

    def give_up(self, now_s):
        """Returns the keys of commands that are lost, and counts them as late."""
        lost_keys = [key for key, sent_s in self._pending.items() if now_s - sent_s > self._lost_after_s]
        for key in lost_keys:
            del self._pending[key]
        self.late += len(lost_keys)
        return lost_keys

    def percentile(self, share):
        """Returns the least round trip in ms that `share` percent do not exceed; NaN without any."""
        sorted_ms = sorted(self._rtts_ms)
        return sorted_ms[max(math.ceil(len(sorted_ms) * share / 100) - 1, 0)] if sorted_ms else math.nan

    def summary(self):
        answers = len(self._rtts_ms)
        return (
            f"{self.sent} commands, {answers} answered, {self.late} late (over {self.deadline_ms:g} ms or lost), "
            f"p50 {self.percentile(50):.2f} ms, p95 {self.percentile(95):.2f} ms, p99 {self.percentile(99):.2f} ms"
        )
