"""The hooks of a profile from the choice of a node on: reserve, permit, pre_bind, bind, post_bind.

A hook may be a plain function or a coroutine. One that raises is an error of the pod, never of the process. Whatever way
an attempt ends but with the bind, everything that was reserved is given back in reverse order.
"""

import asyncio
import inspect
import logging
from collections.abc import Awaitable, Callable, Mapping, Sequence
from types import MappingProxyType, TracebackType
from typing import Any, Final, NamedTuple, Self

import msgspec

from robotapp_api.model.names import GRANTED_PREFIX, PodReason
from robotapp_scheduler.core.api.core_v1 import Pod
from robotapp_scheduler.core.dynamic_resources.claims_of_pods import ClaimPlan
from robotapp_scheduler.core.explain.record import histogram
from robotapp_scheduler.core.framework.handle import BindOutcome, BindResult, Handle, Readiness, Reserved
from robotapp_scheduler.core.framework.interface import BindContext, Code, PluginError, Status
from robotapp_scheduler.core.framework.plugin_calls import Overdue, PluginCall
from robotapp_scheduler.core.framework.profiles import Profile, pre_flight_of
from robotapp_scheduler.core.framework.registered_plugin import RegisteredPlugin
from robotapp_scheduler.core.framework.third_party import is_ours, odd_status
from robotapp_scheduler.core.pods.pod_info import PodInfo
from robotapp_scheduler.core.queue.queued_pod_info import Rejection
from robotapp_scheduler.core.robotics.device_index import DeviceGrant
from robotapp_scheduler.core.volumes.volume_cache import VolumePlan
from robotapp_scheduler.plugins.kubernetes.common.arguments import QUALIFIED
from robotapp_scheduler.shell.metrics.timing import PointTimer

log = logging.getLogger(__name__)

WAITING: Final = frozenset({"permit", "pre_bind"})
Nominate = Callable[[Pod, str], Awaitable[None]]
HOOK_S: Final = 600.0
"""Limit of an `async` hook of a third-party plugin: one that never returned would hold its pod's room for ever."""
REJECTED: Final = frozenset({Code.UNSCHEDULABLE, Code.UNRESOLVABLE, Code.PENDING})
NO_ANNOTATIONS: Final[Mapping[str, str]] = MappingProxyType({})
FINE: Final = frozenset({Code.SUCCESS, Code.SKIP})


class Refused(NamedTuple):
    """Why a pod is not bound: the rejection for the queue, reason and message for the user.

    readiness: BUSY = another node may do, GONE = the pod no longer exists.
    """

    rejection: Rejection
    reason: str
    message: str
    readiness: Readiness = Readiness.ERROR


def is_bound(outcome: BindOutcome | Refused) -> bool:
    return isinstance(outcome, BindOutcome) and outcome.result is BindResult.BOUND


class ExtensionPoints:
    """The steps of one attempt: `async with` it, `run` on the chosen node, `bind`, and `finish` once the pod is bound.

    Built-in plugins are trusted and called directly. Those whose `pre_flight` is Skip are not called.
    """

    def __init__(
        self, profile: Profile, pod: PodInfo, timer: PointTimer, nominate: Nominate, *, handle: Handle
    ) -> None:
        """`nominate` is called with the node before the pod waits for an `async` permit or pre_bind."""
        self._profile = profile
        self._pod = pod
        self._handle = handle
        self._timer = timer
        self._nominate = nominate
        self._nominated = ""
        self._node = ""
        self._bound = False
        self._reserved: list[RegisteredPlugin] = []
        self._waited_on: set[tuple[str, str]] = set()
        """Plugins whose pre_bind has waited, with the node."""
        self._outcome: BindOutcome | None = None
        """The BindOutcome that a third-party bind plugin returned, if any."""
        self.context = BindContext(handle)
        self.binder = profile.binds[0].name
        """The bind plugin that was called last."""
        self.stale = False
        """True when the grants were given back before a slow pre_bind: `run` has to be called again."""

    def __repr__(self) -> str:
        return f"<ExtensionPoints of {self._pod.key} on {self._node or 'no node yet'}>"

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if not self._bound:
            # After a cancellation or a bug it is unknown whether a Binding was sent.
            self.context.sent |= kind is not None
            await self.give_back()

    # --- Before the bind -----------------------------------------------------------------------------------------

    async def run(
        self,
        node: str,
        *,
        grants: Sequence[DeviceGrant] = (),
        volumes: VolumePlan | None = None,
        claims: ClaimPlan | None = None,
        annotations: Mapping[str, str] = NO_ANNOTATIONS,
    ) -> Refused | None:
        """Call all hooks before the bind; None when the pod may be bound to this node, or `stale`.

        `annotations` go into the Binding beside those of the plugins. May be called again after `give_back`.
        """
        self._node, self.stale = node, False
        self.context = BindContext(self._handle, grants=grants, volumes=volumes, claims=claims)
        self.context.annotations.update(annotations)
        return (
            await self._run_point("Reserve", "reserve", self._profile.reserves)
            or await self._run_point("Permit", "permit", self._profile.permits)
            or await self._pre_bind()
            or _forged(self.context)
        )

    async def _pre_bind(self) -> Refused | None:
        """Call pre_bind. When it may take minutes and the pod has a grant, the grant is given back before, and `stale` is set.

        A grant is valid for one version of the pod only, and other pods may be able to use the device meanwhile.
        """
        todo = [loaded for loaded in self._profile.pre_binds if (loaded.name, self._node) not in self._waited_on]
        slow = [loaded for loaded in todo if self._pre_flight(loaded) is Code.WAIT]
        self._waited_on.update((loaded.name, self._node) for loaded in slow)
        self.stale = bool(slow and self.context.reserved.annotations)
        if self.stale:
            await self.give_back()
            todo = slow
        return await self._run_point("PreBind", "pre_bind", todo)

    def _pre_flight(self, loaded: RegisteredPlugin) -> Code | None:
        """None for a plugin without `pre_flight`: it is called for every pod."""
        pre_flight = pre_flight_of(loaded)
        return None if pre_flight is None else pre_flight(self._pod, self.context)

    async def _run_point(self, point: str, hook: str, chain: Sequence[RegisteredPlugin]) -> Refused | None:
        for loaded in chain:
            if self._pre_flight(loaded) is Code.SKIP:
                continue
            if hook == "reserve":
                self._reserved.append(loaded)  # before the call: `unreserve` also cleans up after a failed `reserve`
            refused = self._rejected(point, loaded, await self._call(loaded, point, hook))
            if refused is not None:
                return refused
        return None

    def _rejected(self, point: str, loaded: RegisteredPlugin, answer: Status | Reserved | None) -> Refused | None:
        """The refusal that a hook's result stands for, None to go on. Grants are kept in the context."""
        if isinstance(answer, Reserved):
            if answer.readiness is not Readiness.READY:
                return Refused(Rejection(answer.waits_for), answer.reason, answer.message, answer.readiness)
            self.context.reserved = answer
            return None
        return None if answer is None or answer.code in FINE else _rejection(point, loaded.name, answer)

    async def give_back(self) -> None:
        """Call `unreserve` of the plugins whose `reserve` was called, in reverse order."""
        while self._reserved:
            loaded = self._reserved.pop()
            if hasattr(loaded.plugin, "unreserve"):
                await self._call(loaded, "Unreserve", "unreserve")

    # --- The bind, and after it ------------------------------------------------------------------------------------

    async def bind(self, node: str, *, began_s: float | None = None) -> BindOutcome | Refused:
        """Call the bind plugins until one does not skip the pod. `began_s`: when the first try without waiting began."""
        self._node, self.context.sent = node, True
        if self.context.refused is None:
            began_s = self._timer.begin("Bind")
        answer = await self._bind()
        bound = is_bound(answer)
        if bound and self.context.reserved.annotations and not self.context.annotations_read:
            log.error(
                "plugin %s bound %s without its grants (%s), so other pods may be granted the same: a bind hook has to send "
                "ctx.binding_annotations",
                *(self.binder, self._pod.key, ", ".join(sorted(self.context.reserved.annotations))),
            )
        code = Code.SUCCESS if bound else Code.ERROR
        self._timer.end("Bind", self._pod.scheduler_name, began_s, code=code)
        return answer

    async def _bind(self) -> BindOutcome | Refused:
        for loaded in self._profile.binds:
            self.binder, self._outcome = loaded.name, None
            answer = await self._call(loaded, "Bind", "bind")
            outcome = answer if isinstance(answer, BindOutcome) else self._outcome
            if outcome is not None:
                return outcome
            if answer.code is Code.SUCCESS:
                return BindOutcome(BindResult.BOUND, node=self._node)
            if answer.code is not Code.SKIP:
                return self.bind_rejected(answer)
            if forged := _forged(self.context):  # the next one would send what this one wrote
                return forged
        return self.bind_rejected(Status(Code.ERROR, "every bind plugin of the profile skipped the pod"))

    def bind_rejected(self, status: Status) -> Refused:
        """The refusal for a pod that the last bind plugin did not bind."""
        refused = _rejection("Bind", self.binder, status)
        if refused.rejection.plugins:
            return refused
        return refused._replace(message=f"binding rejected: {refused.message}")

    async def finish(self) -> None:
        """Call the post_bind hooks. The pod is bound, so their errors are only logged."""
        self._bound = True
        for loaded in self._profile.post_binds:
            try:
                if self._pre_flight(loaded) is not Code.SKIP:
                    await self._call(loaded, "PostBind", "post_bind")
            except Exception:  # the pod is bound whatever a bug does here
                log.exception("post_bind of plugin %s failed for %s", loaded.name, self._pod.key)

    # --- Calls -----------------------------------------------------------------------------------------------------

    async def _call(self, loaded: RegisteredPlugin, point: str, hook: str) -> Any:
        """The result of a hook. An exception of a built-in plugin is a bug and passes to the caller."""
        if not is_ours(loaded.plugin):
            return await self._call_third_party(loaded, point, hook)
        if hook not in WAITING or self._pre_flight(loaded) is not Code.WAIT:
            return await getattr(loaded.plugin, hook)(self._pod, self._node, self.context)
        await self._show_node(hook)
        began_s = self._timer.begin(point)
        answer: Status | None = await getattr(loaded.plugin, hook)(self._pod, self._node, self.context)
        code = Code.SUCCESS if answer is None else answer.code
        self._timer.end(point, self._pod.scheduler_name, began_s, code=code)
        return answer

    async def _call_third_party(self, loaded: RegisteredPlugin, point: str, hook: str) -> Status:
        """The result of a third-party plugin's hook, timed; an exception becomes an Error."""
        started_s, pod = self._timer.clock(), self._pod
        try:
            with PluginCall(loaded.name, hook, pod, loaded.journal):
                answer: Any = getattr(loaded.plugin, hook)(pod, self._node, self.context)
            if inspect.isawaitable(answer):
                await self._show_node(hook)
                async with asyncio.timeout(HOOK_S):
                    with PluginCall(loaded.name, hook, pod):
                        answer = await answer
            if hook == "bind" and isinstance(answer, BindOutcome):
                answer = self._bind_status(answer)
            status = _status(answer, self.context)
        except TimeoutError as error:
            log.warning("%s of plugin %s for %s: %r", hook, loaded.name, pod.key, error)
            status = Status(
                Code.ERROR, f"no answer within {HOOK_S:.0f} s" if not str(error) else f"TimeoutError: {error}"
            )
        except PluginError as error:
            status = Status(Code.ERROR, str(error))
        except (
            Exception,
            SystemExit,
            Overdue,
            asyncio.CancelledError,
        ) as error:  # third-party code: only its pod fails, with the reason
            if isinstance(error, asyncio.CancelledError) and _is_cancelled():
                raise
            log.exception("%s of plugin %s failed for %s", hook, loaded.name, pod.key)
            status = Status(Code.ERROR, f"{type(error).__name__}: {error}")
        self._timer.plugin(loaded.name, point, status.code, started_s)
        return status

    def _bind_status(self, outcome: BindOutcome) -> Status | None:
        """The Status of what a third-party plugin found out about its bind, which is kept unless it cannot be used."""
        result: object = outcome.result
        texts: tuple[object, ...] = (outcome.message, outcome.node)
        if not isinstance(result, BindResult) or not all(isinstance(text, str) for text in texts):
            return Status(Code.ERROR, f"answered {outcome!r:.200}, expected a BindResult and texts in it")
        bound = result is BindResult.BOUND
        self._outcome = msgspec.structs.replace(outcome, node=outcome.node or self._node) if bound else outcome
        return None if bound else Status(Code.ERROR, outcome.message)

    async def _show_node(self, hook: str) -> None:
        """Write the pod's nominatedNodeName before it waits with room on the node: users and other schedulers look there."""
        if hook in WAITING and self._nominated != self._node:
            self._nominated = self._node
            await self._nominate(self._pod.pod, self._node)


def _is_cancelled() -> bool:
    """Is the attempt itself cancelled? If not, what a plugin awaited was: that is an error of the plugin."""
    task = asyncio.current_task()
    return task is not None and task.cancelling() > 0


def _status(answer: object, context: BindContext) -> Status:
    """The Status of a hook's result: Success for None, an Error for a result or annotations that cannot be used."""
    odd = odd_status(answer) if answer is not None else ""
    if odd:
        return Status(Code.ERROR, f"answered {odd}, expected a Status or None")
    given: object = context.annotations
    if not isinstance(given, dict):
        return Status(Code.ERROR, f"ctx.annotations must stay a dict, got {type(given).__name__}")
    for key, value in given.items():
        if not isinstance(key, str) or QUALIFIED.fullmatch(key) is None or not isinstance(value, str):
            return Status(
                Code.ERROR,
                f"ctx.annotations must be texts under names like lab.example/dock, got {key!r}: {value!r:.80}",
            )
    return answer if isinstance(answer, Status) else Status(Code.SUCCESS)


def _rejection(point: str, plugin: str, status: Status) -> Refused:
    """The refusal in upstream's words: a rejection reads like one node of one, an error names point and plugin."""
    if status.code in REJECTED:
        pending = frozenset({plugin}) if status.code is Code.PENDING else frozenset[str]()
        text = histogram(1, {status.reason or f"node(s) were rejected by {plugin}": 1})
        return Refused(Rejection(frozenset({plugin}), pending), PodReason.UNSCHEDULABLE, text)
    text = status.reason or f"answered {status.code}"  # retried after back-off
    return Refused(Rejection(), PodReason.SCHEDULER_ERROR, f'running {point} plugin "{plugin}": {text}')


def _forged(context: BindContext) -> Refused | None:
    """A refusal when a plugin wrote annotations of grants, which only the scheduler may write from claims."""
    named = sorted(key for key in context.annotations if key.startswith(GRANTED_PREFIX))
    if not named:
        return None
    text = f"annotations {', '.join(named)} are written by the scheduler alone"
    return Refused(Rejection(), PodReason.SCHEDULER_ERROR, text)
