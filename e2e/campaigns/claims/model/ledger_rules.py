"""The product's decisions on devices as ResourceClaims, asked with model states, and weaker ones that the search must notice.

The ledger is the ResourceClaims of one node and the lock of its driver. A rule decides; what it decides about is in `ledger`. The order
of reads and writes is no function of the product, so it is stated here.
"""

from functools import cache
from typing import Any, Final

import msgspec

from robotapp_agent.driver.rules.ledger import Ledger, PreparedClaim, PreparedDevice
from robotapp_api.model.names import API_VERSION, GROUP, Label
from robotapp_scheduler.core.api.robotics_v1alpha1 import RobotApp
from robotapp_scheduler.core.dynamic_resources.objects import ResourceClaim
from robotapp_scheduler.core.dynamic_resources.standing_consumers import (
    find_release_reason,
    list_next_users,
    list_predecessors,
)

_BOOT: Final = "boot-1"
_NODE: Final = "robot-1"
_APP: Final = {"name": "patrol", "uid": "uid-app"}
_APP_USER: Final = {"apiGroup": GROUP, "resource": "robotapps", **_APP}


class LedgerRules:
    """The rules that hold."""

    compares = True
    """Status writes of claims carry the version that was read."""
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
    stands = True
    """A claim of ours has no finalizer, by which the controller would empty it when its last pod has gone."""
    helps_all = True
    """A refused pod is replaced whoever placed it."""

    def __init__(self) -> None:
        for name in ("list_users", "may_reserve", "may_release", "grants"):
            setattr(self, name, cache(getattr(self, name)))

    def list_users(
        self, pods: tuple[int, ...], is_standing: bool, pod: int, allocates: bool
    ) -> tuple[frozenset[int], bool]:
        """Lists the pods that are consumers of a claim of ours when this one is entered, and whether its app is one. allocates: in the
        same write.
        """
        claim = _make_claim(pods, is_standing=is_standing, is_allocated=not allocates)
        users = list_next_users(claim, name=str(pod), uid=str(pod), allocates=allocates)
        has_app = any(user.resource == "robotapps" for user in users)
        return frozenset(int(user.name) for user in users if user.resource == "pods"), has_app

    def may_reserve(self, others: tuple[int, ...], is_standing: bool, pod: int) -> bool:
        """Tells whether a pod may join an allocated claim of ours. others: consumers of the claim that are pods that exist."""
        claim = _make_claim(others, is_standing=is_standing, is_allocated=True)
        return not list_predecessors(claim, str(pod))

    def may_release(self, wanted: bool, pods_exist: bool) -> bool:
        """Tells whether an allocated claim may be emptied. wanted: its app lives and is not suspended. pods_exist: one of its consumers does."""
        claim = _make_claim((0,) if pods_exist else (), is_standing=True, is_allocated=True)
        component = {"name": "driver", "devices": [{"name": "arm", "type": "serial"}]}
        app = {"metadata": {**_APP, "namespace": "team"}, "spec": {"components": [component], "suspend": not wanted}}
        return bool(find_release_reason(claim, msgspec.convert(app, RobotApp), exists=lambda node: node == _NODE))

    def grants(self, prepared: bool, holder_allocated: bool) -> bool:
        """Tells whether the driver prepares a device that another claim had last. prepared: it is prepared for that one.
        holder_allocated: that claim, read now, still has the device.
        """
        ledger = Ledger().prepare(_make_entry("holder"))
        assert isinstance(ledger, Ledger)
        ledger = ledger if prepared else ledger.release("holder")
        if "holder" in ledger.claims:
            allocated = {"arm"} if holder_allocated else set()
            ledger = ledger.forget_unallocated("holder", allocated=allocated, boot_id=_BOOT)
        return isinstance(ledger.prepare(_make_entry("next")), Ledger)


def _make_claim(pods: tuple[int, ...], *, is_standing: bool, is_allocated: bool) -> ResourceClaim:
    users = [{"resource": "pods", "name": str(pod), "uid": str(pod)} for pod in pods]
    term = {"matchFields": [{"key": "metadata.name", "operator": "In", "values": [_NODE]}]}
    allocation = {"devices": {"results": []}, "nodeSelector": {"nodeSelectorTerms": [term]}}
    status: dict[str, Any] = {"reservedFor": [*users, *([_APP_USER] if is_standing else [])]}
    owner = {**_APP, "apiVersion": API_VERSION, "kind": "RobotApp", "controller": True}
    metadata = {
        "name": "driver",
        "namespace": "team",
        "ownerReferences": [owner],
        "labels": {Label.COMPONENT.value: "driver"},
    }
    body = {"metadata": metadata, "status": status | ({"allocation": allocation} if is_allocated else {})}
    return msgspec.convert(body, ResourceClaim)


def _make_entry(uid: str) -> PreparedClaim:
    device = PreparedDevice(request="arm", pool=_NODE, device="arm", variable="ARM")
    return PreparedClaim(uid=uid, namespace="team", name=uid, boot_id=_BOOT, devices=(device,))


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

    def may_reserve(self, others: tuple[int, ...], is_standing: bool, pod: int) -> bool:  # noqa: ARG002 - nobody looks
        return True


class NoStandingConsumer(LedgerRules):
    """CM4: pods are the only consumers, as kube-scheduler writes them; the next one waits for them all the same."""

    stands = False

    def may_reserve(self, others: tuple[int, ...], is_standing: bool, pod: int) -> bool:  # noqa: ARG002 - none stands
        return not others

    def list_users(
        self,
        pods: tuple[int, ...],
        is_standing: bool,  # noqa: ARG002 - none stands
        pod: int,
        allocates: bool,  # noqa: ARG002 - none stands
    ) -> tuple[frozenset[int], bool]:
        return frozenset({*pods, pod}), False


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

    def list_users(
        self, pods: tuple[int, ...], is_standing: bool, pod: int, allocates: bool
    ) -> tuple[frozenset[int], bool]:
        return frozenset({*pods, pod}), is_standing or allocates


class LockChangedUnseen(LedgerRules):
    """CM14: two preparations of one device go on beside each other."""

    one_at_a_time = False
