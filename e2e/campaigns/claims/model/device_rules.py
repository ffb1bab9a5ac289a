"""The product's decisions on devices, asked with model states, and weakened ones that must be caught."""

from functools import cache

import msgspec
from tests.support.claims import objects as make

from robotapp_claims.rules.device import PodUse, Take, pod_use, release_device, take_device, wants_devices
from robotapp_claims.rules.objects import App, AppSpec, Claim, Component, DeviceRequirement, Holder, Meta
from robotapp_claims.rules.release import Release, preconditions
from robotapp_scheduler.core.api.core_v1 import Pod
from robotapp_scheduler.core.api.robotics_v1alpha1 import RobotApp
from robotapp_scheduler.core.pods.pod_info import Member
from robotapp_scheduler.core.robotics.app_index import AppIndex

FREE = -1
"""No pod, no device."""
Who = tuple[int, int]
"""(group, holder): holders of one group are instances of one app."""
DEVICE_NODE = "edge-1"
HOME, ABROAD = "team", "attacker"
ELSEWHERE, OWNED, ALONE = "elsewhere", "owned", "alone"
"""Look-alikes: in another namespace, there with an owner reference to the app, and in the app's own without any owner."""


class DeviceRules:
    def __init__(self) -> None:
        for name in ("take", "use", "release", "forged_take", "waits"):
            setattr(self, name, cache(getattr(self, name)))

    def holder(self, who: Who) -> Holder:
        return make.app_holder(f"uid-{who[0]}", instance=f"i{who[1]}", component="driver")

    def claim(self, who: Who, pod: int, device: int = 0) -> Claim:
        phase = "Draining" if pod == FREE else "Reserved"
        uid = "" if pod == FREE else f"pod-{pod}"
        return make.device_claim(f"d{device}", self.holder(who), node=DEVICE_NODE, phase=phase, pod=uid)

    def take(self, claimed_by: Who | None, user: int, who: Who, pod: int) -> Take:
        claim = None if claimed_by is None else self.claim(claimed_by, user)
        return take_device(claim, holder=self.holder(who), pod_uid=f"pod-{pod}")

    # The attacker: labels and owners as anybody may write them

    def index(self, who: Who, *pods: Pod) -> AppIndex:
        """What the scheduler knows: the app, and the pods with its labels that somebody has bound."""
        holder, found = self.holder(who), AppIndex()
        meta = {"name": holder.name, "namespace": HOME, "uid": holder.uid}
        found.apply_app(msgspec.convert({"metadata": meta, "spec": {"components": [{"name": "driver"}]}}, RobotApp))
        for pod in pods:
            found.place(pod, DEVICE_NODE)
        return found

    def forged_pod(self, who: Who, how: str) -> Pod:
        holder = self.holder(who)
        owner = {"kind": "RobotApp", "name": holder.name, "uid": holder.uid, "controller": True}
        meta = {
            "name": "look-alike",
            "namespace": HOME if how == ALONE else ABROAD,
            "uid": f"forged-{how}",
            "labels": make.labels(holder.uid, holder.instance, app=holder.name),
            "ownerReferences": [owner] if how == OWNED else [],
        }
        return msgspec.convert({"metadata": meta}, Pod)

    def forged_take(self, claimed_by: Who | None, user: int, who: Who, how: str) -> Take:
        """What a look-alike that asks our scheduler may do about a device."""
        pod, holder = self.forged_pod(who, how), self.holder(who)
        if not self.belongs(pod, who):
            return Take.BUSY
        claim = None if claimed_by is None else self.claim(claimed_by, user)
        own = msgspec.structs.replace(holder, namespace=pod.metadata.namespace)
        return take_device(claim, holder=own, pod_uid=pod.metadata.uid)

    def belongs(self, pod: Pod, who: Who) -> bool:
        """Whether the scheduler tries the pod at all (PreEnqueue of groups)."""
        return self.index(who).belongs(pod, self.holder(who).uid)

    def waits(self, who: Who, forged: tuple[str, ...]) -> bool:
        """Whether a pod of this component waits for these look-alikes, which run."""
        holder = self.holder(who)
        index = self.index(who, *(self.forged_pod(who, how) for how in forged))
        return bool(self.predecessors(index, Member(holder.uid, holder.instance, holder.component)))

    def predecessors(self, index: AppIndex, member: Member) -> int:
        return len(index.labelled(member))

    def use(self, who: Who, pod: int, device: int, phase: str, granted: int) -> PodUse:
        """phase of the named pod: P pending, R running, T terminating, anything else gone."""
        if phase not in {"P", "R", "T"}:
            return pod_use(self.claim(who, pod, device), None)
        annotations = {"granted.robotics.io/devices": f"d{granted}"} if granted != FREE else {}
        node = "" if phase == "P" else DEVICE_NODE
        found = make.pod(uid=f"pod-{pod}", node=node, phase="Running" if node else "Pending", annotations=annotations)
        return pod_use(self.claim(who, pod, device), found)

    def release(self, use: PodUse, live: bool, handed_over: bool) -> Release:
        holder = self.holder((0, 0))
        component = Component(name="driver", devices=(DeviceRequirement(name="can", type="can"),))
        app = App(metadata=Meta(uid=holder.uid), spec=AppSpec(suspend=not live, components=(component,)))
        return release_device(use=use, wanted=wants_devices(app, holder), handed_over=handed_over)

    def precondition(self) -> str:
        found = preconditions(self.claim((0, 0), 0))
        return "rv" if found.resource_version else "uid" if found.uid else "none"

    def compares(self) -> bool:
        """Whether taking over carries the version that was read: the same preconditions as every other write."""
        return bool(preconditions(self.claim((0, 0), 0)).resource_version)


class Anyone(DeviceRules):
    """DM1, and D5 for instances of one component: whoever comes may take a Draining device."""

    def take(self, claimed_by: Who | None, user: int, who: Who, pod: int) -> Take:
        return super().take(None if claimed_by is None else who, user, who, pod)


class UidOnly(DeviceRules):
    """DM2: deletes carry the uid but not the version."""

    def precondition(self) -> str:
        return "uid"


class NoCompare(DeviceRules):
    """DM3: taking over does not carry the version."""

    def compares(self) -> bool:
        return False


class FreedWithItsApp(DeviceRules):
    """DM4: the device of an app that is gone is freed although its pod still terminates."""

    def release(self, use: PodUse, live: bool, handed_over: bool) -> Release:
        return Release.DELETE if not live else super().release(use, live, handed_over)


class TerminatingIsGone(DeviceRules):
    """DM5: a terminating pod counts as gone."""

    def use(self, who: Who, pod: int, device: int, phase: str, granted: int) -> PodUse:
        return super().use(who, pod, device, "G" if phase == "T" else phase, granted)


class LabelsProve(DeviceRules):
    """DA1: whose labels a pod wears, to whom it belongs, wherever it is: its device, and the turn of the true ones."""

    def belongs(self, pod: Pod, who: Who) -> bool:  # noqa: ARG002 - nobody looks
        return True


class LabelsHoldBack(DeviceRules):
    """DA2: a running pod with the labels is a predecessor, wherever it is."""

    def predecessors(self, index: AppIndex, member: Member) -> int:  # noqa: ARG002 - nobody looks
        return sum(map(len, index._replicas.values()))


class OwnersUnchecked(DeviceRules):
    """DA3: an owner reference is believed across namespaces."""

    def belongs(self, pod: Pod, who: Who) -> bool:
        return any(owner.uid == self.holder(who).uid for owner in pod.metadata.owner_references or ())
