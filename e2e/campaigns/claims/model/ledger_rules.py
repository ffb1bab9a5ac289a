"""The rules of the device ledger as docs/claims.md states them, and weaker ones that the search must notice.

The ledger is the ResourceClaims of one node and the lock of its driver. A rule decides; what it decides about is in `ledger`.
"""


class LedgerRules:
    """The rules that hold."""

    compares = True
    """Status writes of claims carry the version that was read."""
    stands = True
    """Our scheduler's allocation carries the app as a consumer of its own, in the same write."""
    binds_first = False
    """A pod is bound before its claim is written."""
    release_order = "claim, pods, app"
    """Reads of whoever releases, before the write that carries the claim's version."""
    frees_first = False
    """A claim that the driver refuses is given back while its pod still exists."""
    locks_first = True
    """The driver writes its lock to the disk before it replies."""
    one_at_a_time = True
    """The driver reads the last claim of a device and locks it for the next with no other preparation of that device between."""
    drops_gone = True
    """The write that adds a pod to an allocated claim takes off those that are gone: what the driver refused them is no news of this one."""
    helps_all = True
    """A refused pod is replaced whoever placed it."""

    def may_reserve(self, others_exist: bool) -> bool:
        """Tells whether a pod may join an allocated claim. others_exist: another consumer of the claim is a pod that exists."""
        return not others_exist

    def may_release(self, wanted: bool, pods_exist: bool) -> bool:
        """Tells whether an allocated claim may be emptied. wanted: its app lives and is not suspended. pods_exist: one of its consumers does."""
        return not wanted and not pods_exist

    def grants(self, prepared: bool, holder_allocated: bool) -> bool:
        """Tells whether the driver prepares a device that another claim had last. prepared: it is prepared for that one.
        holder_allocated: that claim, read now, still has the device.
        """
        return not prepared and not holder_allocated


class LockEndsWithThePod(LedgerRules):
    """CM1: the driver forgets a claim once it is not prepared any more."""

    def grants(self, prepared: bool, holder_allocated: bool) -> bool:  # noqa: ARG002 - nobody reads it
        return not prepared


class NoLock(LedgerRules):
    """CM2: the driver prepares whatever was allocated."""

    def grants(self, prepared: bool, holder_allocated: bool) -> bool:  # noqa: ARG002 - nobody looks
        return True


class SuccessorJoins(LedgerRules):
    """CM3: the next pod of a component joins its claim while the previous one terminates."""

    def may_reserve(self, others_exist: bool) -> bool:  # noqa: ARG002 - nobody looks
        return True


class NoStandingConsumer(LedgerRules):
    """CM4: pods are the only consumers, as kube-scheduler writes them."""

    stands = False


class ReleasedUnderPods(LedgerRules):
    """CM5: a claim is emptied because its app does not want it, although a pod of it exists."""

    def may_release(self, wanted: bool, pods_exist: bool) -> bool:  # noqa: ARG002 - nobody looks
        return not wanted


class AppReadFirst(LedgerRules):
    """CM6: the app is read, then the claim."""

    release_order = "app, claim, pods"


class AppReadBeforePods(LedgerRules):
    """CM12: the app is read after the claim and before its pods."""

    release_order = "claim, app, pods"


class NoCompare(LedgerRules):
    """CM7: status writes of claims are unconditional."""

    compares = False


class FreedBeforeItsPod(LedgerRules):
    """CM8: a refused claim is given back first, then its pod is replaced."""

    frees_first = True


class LockedAfterwards(LedgerRules):
    """CM9: the driver replies, then writes its lock."""

    locks_first = False


class OwnPodsOnly(LedgerRules):
    """CM10: of the pods that the driver refuses, only those of our scheduler are replaced."""

    helps_all = False


class BoundFirst(LedgerRules):
    """CM11: a pod is bound, and its claim written afterwards."""

    binds_first = True


class OldRefusals(LedgerRules):
    """CM13: consumers that are gone stay in the claim, with what the driver refused them."""

    drops_gone = False


class LockChangedUnseen(LedgerRules):
    """CM14: two preparations of one device go on beside each other."""

    one_at_a_time = False
