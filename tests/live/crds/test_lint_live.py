"""What `lint` says without a cluster is what kubectl and the real API server say: nothing more, nothing less."""

import json

import pytest
from tests.support.seeds import choose_for_today

from robotapp_api.model.names import Reason
from robotapp_cli.lint.findings import Severity
from robotapp_cli.lint.linter import lint
from robotapp_cli.lint.reading import read
from robotapp_testbed import ControlPlane
from robotapp_testbed.failures import CommandError

pytestmark = pytest.mark.live

_OPERATORS = frozenset(Reason)
APP = """\
apiVersion: robotics.io/v1alpha1
kind: RobotApp
metadata: {name: peculiar}
spec:
  ros: {distro: jazzy}
  components:
  - name: driver
    image: i
"""
PECULIAR = {
    "a list that is null": "  edges:\n",
    "a default that is null": "  suspend:\n",
    "an object that is null": "  placement: ~\n",
    "a required field that is null": "  ros2: {shareWith: [{name: }]}\n",
    "an entry that is null": "    args: [null]\n",
    "an entry of a map that is null": "    resources: {limits: {cpu: }}\n",
    "a whole number with a fraction of none": "    replicas: 2.0\n",
    "a whole number with an exponent": "    replicas: 1e1\n",
    "a whole number in octal": "    replicas: 010\n",
    "a number with a fraction": "    replicas: 2.5\n",
    "a quantity with a fraction": "    resources: {limits: {cpu: 0.5}}\n",
    "a quantity with a fraction in quotes": '    resources: {limits: {cpu: "0.5"}}\n',
    "a quantity that is a number": "    resources: {limits: {cpu: 2, memory: 1e9}}\n",
    "a quantity that is none": "    resources: {limits: {cpu: 2 cores}}\n",
    "a truth value in words": "  suspend: off\n",
    "a truth value in a letter": "  suspend: n\n",
    "text that is a truth value": "    workingDir: on\n",
    "text that is a number": "    workingDir: 7\n",
    "text that looks like a time": "    workingDir: 12:30\n",
    "text that looks like a date": "    workingDir: 2026-01-01\n",
    "text with a line end": '    command: ["a\\n"]\n',
    "a name with a line end": '  ros2: {pool: "a\\n"}\n',
    "letters of several bytes": f"    workingDir: {'ä' * 1024}\n",
    "too many letters": f"    workingDir: {'ä' * 1025}\n",
    "an unsigned number": "    securityContext: {runAsUser: 9223372036854775808}\n",
    "a number of 32 bits": "    livenessProbe: {periodSeconds: 2147483648}\n",
    "a set with the same twice": "    colocateWith: [driver, driver]\n",
    "a map with the same key twice": "    env: [{name: A}, {name: A}]\n",
    "keys that differ by a default": "    ports: [{containerPort: 80}, {containerPort: 80, protocol: UDP}]\n",
    "keys that are the same by a default": "    ports: [{containerPort: 80}, {containerPort: 80, protocol: TCP}]\n",
    "an unknown field": "    hostNetwork: true\n",
    "an unknown field in a field of core": "    securityContext: {runasuser: 7}\n",
    "an alias": "    env: &a [{name: A}]\n    template: {spec: {initContainers: [{name: b, env: *a}]}}\n",
    "a merged mapping": "  ros2: &a {pool: b}\n  ros1: {<<: {master: Managed}}\n",
    "an unknown merged field": "  ros1: {<<: {pool: b}}\n",
    "a status": "status: {phase: 7}\n",
    "metadata with an unknown field": 'status: {}\n"metadata2": {}\n',
    "a label that is a number": "    template: {metadata: {labels: {a: 1}}}\n",
    "a label that is none": "    template: {metadata: {labels: {a: -}}}\n",
    "an empty image": '    initContainers: []\n    policies: {deadline: ""}\n',
}


def refusal(plane: ControlPlane, text: str) -> str:
    """What kubectl and the server say against the text, "" when they would take it."""
    try:
        plane.kubectl("create", "--dry-run=server", "--validate=strict", "-f", "-", stdin=text)
    except CommandError as error:
        return str(error)
    return ""


@pytest.mark.parametrize("what", choose_for_today(PECULIAR))  # each starts a kubectl
def test_lint_refuses_exactly_what_the_server_refuses(control_plane: ControlPlane, what: str) -> None:
    text = APP + PECULIAR[what]
    errors = [
        each
        for each in lint(text.encode()).findings
        if each.severity is Severity.ERROR and each.reason not in _OPERATORS
    ]
    said = refusal(control_plane, text)
    assert bool(errors) == bool(said), (errors, said)


SCALARS = """\
y Y yes On off N No true ~ 0x1F 0o17 017 08 09.5 0b11 -7 +7 1_000 1e3 2.0 .5 5. 1.5e-3 12:30 1:20:30 2026-01-01
2026-01-01T00:00:00Z 9223372036854775807 -9223372036854775808 0777777 1e400 . 8086:0b3a 0x 1__0 ''
"""


def test_plain_scalars_mean_to_lint_what_they_mean_to_kubectl(control_plane: ControlPlane) -> None:
    words = SCALARS.split()
    lines = [f"  k{at}: {word}" for at, word in enumerate(words)]
    text = "\n".join(["apiVersion: v1", "kind: ConfigMap", "metadata: {name: a}", "data:", *lines])
    shown = control_plane.kubectl(
        "create", "--dry-run=client", "--validate=ignore", "-o", "json", "-f", "-", stdin=text
    )
    (document,) = read(text)
    theirs, ours = json.loads(shown)["data"], document.root.value["data"]
    assert {word: repr(value) for word, value in zip(words, ours.values(), strict=True)} == {
        word: repr(theirs[key]) for key, word in zip(ours, words, strict=True)
    }
