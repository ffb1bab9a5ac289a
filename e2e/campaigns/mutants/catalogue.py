"""The faults: what a user would suffer, the text that is replaced, and the tests to run first."""

import os
from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from suite.plan import QUICK_FOLDERS

_SCHEDULER: Final = "scheduler/robotapp_scheduler"
_OPERATOR: Final = "operator/robotapp_operator"
_CHART: Final = "helm/robotapp"


@dataclass(frozen=True, slots=True, kw_only=True)
class Fault:
    """One replacement of text in one file.

    tests: paths of the touched package's tests, which run first. live: only tests on a control plane, or of the rendered
    chart, can notice it.
    """

    name: str
    harm: str
    file: str
    old: str
    new: str
    tests: tuple[str, ...]
    live: bool = False

    @property
    def quick_tests(self) -> tuple[str, ...]:
        return tuple(test for test in self.tests if test.startswith(QUICK_FOLDERS))

    @property
    def live_tests(self) -> tuple[str, ...]:
        return tuple(test for test in self.tests if not test.startswith(QUICK_FOLDERS))


class MissingTextError(ValueError):
    """The text of a fault is not in its file exactly once: the product has changed."""


def put_in(fault: Fault, tree: Path) -> str:
    """Writes the faulty file into `tree` and returns the text it had before."""
    path = tree / fault.file
    text = path.read_text(encoding="utf-8")
    _replace_text(path, faulty_text(fault, text))
    return text


def take_out(fault: Fault, tree: Path, text: str) -> None:
    """Writes the file's former text, which `put_in` returned."""
    _replace_text(tree / fault.file, text)


def _replace_text(path: Path, text: str) -> None:
    """Writes the text with a later time in whole seconds: Python recognises stale bytecode by that and the size alone."""
    later_s = int(path.stat().st_mtime) + 2
    path.write_text(text, encoding="utf-8")
    os.utime(path, (later_s, later_s))


def faulty_text(fault: Fault, text: str) -> str:
    """Returns `text` with the fault in it. Raises `MissingTextError`."""
    if (count := text.count(fault.old)) != 1:
        raise MissingTextError(
            f"{fault.name}: its text stands {count} times in {fault.file}; renew it in the catalogue"
        )
    return text.replace(fault.old, fault.new)


def select_faults(names: Collection[str]) -> list[Fault]:
    """Returns the faults of these names, all where there are none. Those that quick tests may notice come first."""
    faults = [fault for fault in FAULTS if not names or fault.name in names]
    return sorted(faults, key=lambda fault: fault.live)


FAULTS: Final = (
    # The scheduler
    Fault(
        name="filter-always-passes",
        harm="A component starts on a node whose round trips exceed its latency budget.",
        file=f"{_SCHEDULER}/plugins/ros/latency_filter.py",
        old="mask = np.equal(codes, _PASS)",
        new="mask = np.ones(nodes.n, dtype=np.bool_)",
        tests=("tests/unit/plugins", "tests/unit/core"),
    ),
    Fault(
        name="score-sign-turned",
        harm="Of all nodes that keep a deadline, the slowest is preferred.",
        file=f"{_SCHEDULER}/plugins/ros/deadline_score.py",
        old="margin = 1.0 - nearest_us(nodes, endpoint, percentile=95) / float(pod.ros.deadline_us)",
        new="margin = nearest_us(nodes, endpoint, percentile=95) / float(pod.ros.deadline_us) - 1.0",
        tests=("tests/unit/plugins", "tests/unit/core"),
    ),
    Fault(
        name="bind-check-left-out",
        harm="A pod starts with a ROS_DOMAIN_ID that another app owns, and two robots obey one command.",
        file=f"{_SCHEDULER}/shell/binding/claim_reserver.py",
        old="            if not answer.allowed:\n",
        new="            if not answer:\n",
        tests=("tests/unit/shell/binding", "tests/unit/claims", "tests/live/scheduling", "tests/live/claims"),
    ),
    Fault(
        name="hint-never-wakes",
        harm="A waiting pod is not tried again when a node offers what it needs; it waits minutes for the next round.",
        file=f"{_SCHEDULER}/shell/informers/informers.py",
        old="on_change(Event(plural, change, seen.old, seen.new))",
        new="on_change(Event(plural, change, seen.new or seen.old, seen.new))",
        tests=("tests/unit/shell", "tests/unit/watch", "tests/live/scheduling"),
        live=True,
    ),
    Fault(
        name="device-not-given-back",
        harm="A pod that gets one of two devices keeps it while it waits for the other, and nobody else can use it.",
        file=f"{_SCHEDULER}/shell/binding/claim_reserver.py",
        old="await give_back(self._client, stored, found.in_vain)",
        new="await give_back(self._client, stored, ())",
        tests=("tests/unit/shell/binding", "tests/unit/claims", "tests/live/scheduling"),
    ),
    # The operator and the claims
    Fault(
        name="condition-swallowed",
        harm="Two apps that use one device or domain are both shown as allocated.",
        file=f"{_OPERATOR}/main.py",
        old="on_conflicts=self.conflicts.take,",
        new="on_conflicts=lambda _: None,",
        tests=("tests/unit/operating", "tests/live/operating"),
        live=True,
    ),
    Fault(
        name="owner-reference-lost",
        harm="After an app is deleted its Deployments and Services stay, and the robot drives on.",
        file=f"{_OPERATOR}/plan/render/child.py",
        old='"ownerReferences": [owner_reference(app)],',
        new='"ownerReferences": [],',
        tests=("tests/unit/plan", "tests/unit/operating", "tests/live/operating"),
    ),
    Fault(
        name="pacing-off-by-one",
        harm="The first sign of progress of a starting app is shown four seconds late.",
        file=f"{_OPERATOR}/plan/status/pace.py",
        old="START_REST_S[min(self.steps, len(START_REST_S) - 1)]",
        new="START_REST_S[min(self.steps + 1, len(START_REST_S) - 1)]",
        tests=("tests/unit/plan/status", "tests/unit/operating"),
    ),
    Fault(
        name="status-written-for-ever",
        harm="The operator writes every status once a second for ever, and the API server is busy with nothing else.",
        file="crds/robotapp_api/model/conditions.py",
        old='"lastTransitionTime": old["lastTransitionTime"] if same else now,',
        new='"lastTransitionTime": now,',
        tests=("tests/unit/plan/status", "tests/unit/operating", "tests/unit/api", "tests/live/operating"),
    ),
    Fault(
        name="domain-reused-too-soon",
        harm="A domain goes to another app while nodes of its last one may still speak in it.",
        file="claims/robotapp_claims/rules/release.py",
        old="return Release.DELETE if rested else Release.WAIT",
        new="return Release.DELETE",
        tests=("tests/unit/claims", "tests/property/claims", "tests/live/claims"),
    ),
    # The chart
    Fault(
        name="right-missing",
        harm="A pod that cannot be placed shows no reason, because the scheduler may not write its condition.",
        file=f"{_CHART}/templates/_rules.tpl",
        old="  resources: [pods/status]\n  verbs: [patch]\n",
        new="  resources: [pods/status]\n  verbs: [get]\n",
        tests=("tests/live/chart",),
        live=True,
    ),
    Fault(
        name="chart-value-wrong",
        harm="Where agents measure, no pod is ever moved to a node that meets its latency budget.",
        file=f"{_CHART}/templates/scheduler/deployment.yaml",
        old='ternary "on" "off"',
        new='ternary "off" "on"',
        tests=("tests/live/chart",),
        live=True,
    ),
    Fault(
        name="policy-left-out",
        harm="Any user makes a pod a member of somebody else's app, past the check of its domain.",
        file=f"{_CHART}/templates/policies/membership.yaml",
        old="{{- if .Values.policies.enabled }}",
        new="{{- if not .Values.policies.enabled }}",
        tests=("tests/live/chart", "tests/live/attacks"),
        live=True,
    ),
    # The client
    Fault(
        name="conflict-taken-for-success",
        harm="Of two schedulers that want the lease at the same time both lead.",
        file="client/robotapp_client/tools/leader_election.py",
        old="            self._lease = None\n            return False\n        except ClientError as error:\n            # A write",
        new="            self._lease = None\n        except ClientError as error:\n            # A write",
        tests=("tests/unit/client", "tests/live/client"),
    ),
    Fault(
        name="watch-never-lists-again",
        harm="After an outage the operator and the scheduler act for ever on what they saw before it.",
        file="client/robotapp_client/informer/reflector.py",
        old='        self.resource_version = ""\n\n    async def _check_history(',
        new="        self._backoff.reset()\n\n    async def _check_history(",
        tests=("tests/unit/client", "tests/property/client", "tests/live/client"),
    ),
    # The programs on robots and on the user's machine, and the API
    Fault(
        name="round-trip-in-wrong-unit",
        harm="Every round trip is reported a thousand times too short, and every budget seems to be met.",
        file="agent/robotapp_agent/probe/prober.py",
        old="(trip_ns + 500) // 1000)",
        new="(trip_ns + 500_000) // 1_000_000)",
        tests=("tests/unit/agent", "tests/property/agent", "tests/live/agent"),
    ),
    Fault(
        name="budget-in-wrong-unit",
        harm="A latency budget of a Rigelfile becomes a thousand times as long.",
        file="rigel_bridge/rigel_bridge/render/scheduling.py",
        old='draft.put((*at, "policies", field), policies.text_of(node), node)',
        new='draft.put((*at, "policies", field), policies.text_of(node).replace("ms", "s"), node)',
        tests=("tests/unit/bridge", "tests/live/bridge"),
    ),
    Fault(
        name="sensor-served-last",
        harm="The profile of a camera or lidar driver has the class that is served last.",
        file="ros_profile/ros_profile/decide/classify/weights.py",
        old='"pub:sensor": (0.0, 2.0, 0.0, 0.0),',
        new='"pub:sensor": (0.0, 0.0, 0.0, 2.0),',
        tests=("tests/unit/ros_profile", "tests/unit/bridge"),
    ),
    Fault(
        name="exit-code-wrong",
        harm="A pipeline that runs `kubectl robotapp lint` goes on with a file that has errors.",
        file="cli/robotapp_cli/commands/linting.py",
        old="return Exit.REFUSED if _count(checked)[Severity.ERROR] else Exit.OK",
        new="return Exit.OK",
        tests=("tests/unit/cli", "tests/live/cli"),
    ),
    Fault(
        name="rule-dropped",
        harm="The API server accepts two replicas that share an exclusive device, of which one never starts.",
        file="crds/robotapp_api/model/app/component.py",
        old="rule=\"self.replicas <= 1 || (has(self.replicaIdentity) && self.replicaIdentity == 'Ordinal') || !has(self.devices) || self.devices.all(d, d.sharing != 'Exclusive')\",",
        new='rule="true",',
        tests=("tests/unit/api", "tests/unit/cli", "tests/live/crds"),
    ),
)
