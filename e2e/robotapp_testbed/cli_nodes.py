"""The part of the command line that is about real nodes: options of `up`, `doctor` and `link`."""

import argparse
import itertools
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple, TypeAlias

from robotapp_testbed import images
from robotapp_testbed.binaries import container_runtime
from robotapp_testbed.binaries.assets import Assets
from robotapp_testbed.control_plane import components_as_pods
from robotapp_testbed.failures import TestbedError
from robotapp_testbed.machines import fleet_file
from robotapp_testbed.machines.network import Topology
from robotapp_testbed.machines.nodes import SimulatedNode, cloud, edge, robot
from robotapp_testbed.processes.detached import State
from robotapp_testbed.real import RealNodes, cluster, parts, prerequisites
from robotapp_testbed.switch.control import Control
from robotapp_testbed.switch.links import LIMITS, Link, problem_of
from robotapp_testbed.switch.replay import Replay
from robotapp_testbed.switch.traces import Step, Trace

EXAMPLES = """\
  python -m robotapp_testbed doctor                      can this machine run real nodes, and what is missing
  python -m robotapp_testbed up --nodes 4                four real nodes with containers (root)
  python -m robotapp_testbed up --nodes robot-1,edge-1 --delay robot-1,edge-1=15
  python -m robotapp_testbed link robot-1 edge-1 --delay-ms 60 --loss 0.01
  python -m robotapp_testbed replay trace.yaml           the same over time
"""
_TIERS: dict[str, Callable[[str], SimulatedNode]] = {"robot": robot, "edge": edge, "cloud": cloud}
Commands: TypeAlias = "argparse._SubParsersAction[argparse.ArgumentParser]"  # noqa: SLF001 - it has no public name
_EXPECTED_S = 4.0
_PER_NODE_S = 0.6
_PROGRAMS_S = 20.0


class Fleet(NamedTuple):
    """Nodes as they were asked for on the command line."""

    text: str
    """That says the same to the holder that `up` starts."""
    nodes: Topology


class Nodes(NamedTuple):
    """Real nodes as they were asked for on the command line."""

    text: str
    nodes: Sequence[str | SimulatedNode]
    delays: Mapping[tuple[str, str], float] = {}
    """One-way milliseconds of those pairs that no --delay names."""

    @property
    def names(self) -> list[str]:
        return [each if isinstance(each, str) else each.name for each in self.nodes]


def add_options(up: argparse.ArgumentParser) -> None:
    up.add_argument(
        "--nodes",
        metavar="NAMES|N|FILE",
        type=_nodes,
        help="real nodes: names with commas between, or how many, or a fleet file, whose devices and distances they get. "
        "Names that begin with robot-, edge- or cloud- get that tier's labels",
    )
    up.add_argument(
        "--delay",
        action="append",
        default=[],
        type=_delay,
        metavar="A,B=MS",
        help="one-way milliseconds between two real nodes; repeatable",
    )
    up.add_argument(
        "--image",
        action="append",
        default=[],
        choices=[name for name in images.RECIPES if name != "pause"],
        help="an image to have on every real node besides tools; repeatable",
    )
    up.add_argument(
        "--cdi",
        action="store_true",
        help="real nodes with a containerd that hands out devices of ResourceClaims; compiled first, about four minutes",
    )


def add_doctor(commands: Commands) -> None:
    doctor = commands.add_parser("doctor", help="what this machine has and lacks for real nodes")
    doctor.set_defaults(run=_doctor)


def add_link(commands: Commands) -> argparse.ArgumentParser:
    link = commands.add_parser("link", help="show or set delay, jitter, loss and bandwidth between two real nodes")
    link.add_argument("node", nargs="*", metavar="NODE", help="two nodes, or one for all its links; none shows all")
    for name, most in LIMITS.items():
        link.add_argument(f"--{name.replace('_', '-')}", type=float, metavar="X", help=f"0 to {most:g}")
    link.add_argument("--down", choices=["yes", "no"], help="cut the link, or mend it")
    link.add_argument("--one-way", action="store_true", help="only from the first to the second node")
    return link


def add_replay(commands: Commands) -> argparse.ArgumentParser:
    replay = commands.add_parser("replay", help="change links over time, as a YAML trace says; until its end or Ctrl-C")
    replay.add_argument("trace", metavar="TRACE.yaml", type=Path, help="steps with at_s and links: docs/real-nodes.md")
    return replay


def plane(arguments: argparse.Namespace, assets: Assets) -> RealNodes:
    return RealNodes(
        arguments.nodes.nodes,
        delays=_delays(arguments),
        images=_images(arguments),
        cdi=arguments.cdi,
        audit=arguments.audit,
        kube_scheduler=arguments.kube_scheduler or True,
        kwok=bool(arguments.fleet),
        assets=assets,
    )


def check(arguments: argparse.Namespace) -> None:
    """TestbedError for what cannot be started as it was asked for, before anything is downloaded or compiled."""
    if arguments.nodes:
        cluster.check(arguments.nodes.names, arguments.delay)
        prerequisites.require()
        return
    options = (("--delay", arguments.delay), ("--image", arguments.image), ("--cdi", arguments.cdi))
    idle = [option for option, given in options if given]
    if idle:
        raise TestbedError(f"{' and '.join(idle)} without real nodes: say which with --nodes")


def prepare(arguments: argparse.Namespace) -> None:
    """Before a cluster is started: make what it needs while the user looks on."""
    parts.prepare(_images(arguments))
    if arguments.cdi:
        container_runtime.build()
    names = arguments.nodes.names
    expected_s = _EXPECTED_S + _PER_NODE_S * len(names) + (_PROGRAMS_S if arguments.programs else 0)
    print(f"starting {len(names)} real nodes ({', '.join(names)}): about {expected_s:.0f} s", file=sys.stderr)


def passed_on(arguments: argparse.Namespace) -> list[str]:
    """The options for the holder that `up` starts."""
    options = [f"--nodes={arguments.nodes.text}"] if arguments.nodes else []
    options += [f"--delay={one},{other}={delay_ms:g}" for (one, other), delay_ms in arguments.delay]
    options += ["--cdi"] if arguments.cdi else []
    return options + [f"--image={name}" for name in arguments.image]


def advice(arguments: argparse.Namespace, began_s: float) -> str:
    """What a person may want to do next."""
    command = "python -m robotapp_testbed"
    named = "" if arguments.name == "default" else f" --name {arguments.name}"
    ends = " ".join(arguments.nodes.names[:2])
    return (
        f"{len(arguments.nodes.nodes)} nodes Ready after {time.monotonic() - began_s:.1f} s. Next:\n"
        f'  eval "$({command} env{named})"; kubectl get nodes -o wide\n'
        f"  {command} link{named} {ends} --delay-ms 15\n"
        f"  {command} down{named}"
    )


def _switch(state: State) -> Control:
    socket = Path(state.run_dir, "switch.sock")
    if not socket.exists():
        raise TestbedError("this cluster has no latency switch: start one with `up --nodes …`")
    return Control(socket)


def replay(arguments: argparse.Namespace, state: State) -> int:
    """Replay a trace in the foreground; what it has set stays."""
    try:
        trace = Trace.read(arguments.trace)
    except (OSError, UnicodeDecodeError) as error:
        raise TestbedError(f"{arguments.trace} cannot be read: {error}") from error
    with _answering(state), Replay(trace, _switch(state), told=_tell_step) as running:
        running.join()
    print(running, file=sys.stderr)
    return 0


def _tell_step(step: Step) -> None:
    changes = "; ".join(
        f"{change.node or '-'.join(change.nodes())} {' '.join(f'{name}={value}' for name, value in change.values.items())}"
        for change in step.changes
    )
    print(f"{step.at_s:8.1f} s  {changes}", flush=True)


@contextmanager
def _answering(state: State) -> Iterator[None]:
    """A switch that does not serve is a sentence, not a stack."""
    try:
        yield
    except OSError as error:
        raise TestbedError(
            f"the latency switch does not answer ({error}): see {state.run_dir}/latency-switch.log, then `down` and `up` again"
        ) from error


def _doctor(_: argparse.Namespace) -> int:
    """Exit status 0 when real nodes can run, else 1."""
    absent = prerequisites.missing_packages()
    for package in prerequisites.PACKAGES:
        print(f"{'missing' if package.name in absent else 'ok':8}{package.name}")
    problem = prerequisites.missing()
    print(problem or "real nodes can run here: python -m robotapp_testbed up --nodes 3")
    return 1 if problem else 0


def link(arguments: argparse.Namespace, state: State) -> int:
    """Set what was asked for, then show the links of the named nodes."""
    switch = _switch(state)
    values = _values(arguments)
    _check_ends(arguments, values)
    with _answering(state):
        _check_known(arguments.node, switch)
        if values:
            _set(switch, arguments, values)
        _show(switch.links(), set(arguments.node))
    return 0


def _check_ends(arguments: argparse.Namespace, values: Mapping[str, object]) -> None:
    if len(arguments.node) > 2:
        raise TestbedError(f"a link has two ends, not {len(arguments.node)}")
    if values and not arguments.node:
        raise TestbedError("name the node or the two nodes whose links are to change")
    if arguments.one_way and (not values or len(arguments.node) != 2):
        raise TestbedError("--one-way is about what is set from one node to another: name both, and a value")


def _check_known(names: Sequence[str], switch: Control) -> None:
    known = switch.known()
    unknown = [name for name in names if name not in known]
    if unknown:
        raise TestbedError(f"there is no node {' or '.join(unknown)}; the cluster has {', '.join(known)}")


def _show(links: Mapping[tuple[str, str], Link], wanted: set[str]) -> None:
    print(f"{'FROM':16}{'TO':16}{'DELAY MS':>9}{'JITTER MS':>10}{'LOSS':>7}{'MBIT/S':>8}  STATE")
    for (origin, target), each in sorted(links.items()):
        if wanted <= {origin, target}:
            speed = f"{each.mbit_s:g}" if each.mbit_s else "-"
            cut = "down" if each.down else "up"
            print(f"{origin:16}{target:16}{each.delay_ms:>9g}{each.jitter_ms:>10g}{each.loss:>7g}{speed:>8}  {cut}")


def _values(arguments: argparse.Namespace) -> dict[str, float | bool]:
    given = {name: getattr(arguments, name) for name in LIMITS}
    values: dict[str, float | bool] = {name: value for name, value in given.items() if value is not None}
    for name, value in values.items():
        problem = problem_of(name, value)
        if problem:
            raise TestbedError(f"--{name.replace('_', '-')}: {problem}")
    return {**values, "down": arguments.down == "yes"} if arguments.down else values


def _set(switch: Control, arguments: argparse.Namespace, values: dict[str, float | bool]) -> None:
    origin, *target = arguments.node
    if target:
        switch.set_link(origin, target[0], one_way=arguments.one_way, **values)
    else:
        switch.set_node(origin, **values)


def _images(arguments: argparse.Namespace) -> Sequence[str]:
    programs = components_as_pods.IMAGES if arguments.programs else ()
    return tuple(dict.fromkeys(["tools", *arguments.image, *programs]))


def _delays(arguments: argparse.Namespace) -> dict[tuple[str, str], float]:
    """Those of --delay, and of the fleet file for other pairs."""
    given = dict(arguments.delay)
    named = set(map(frozenset, given))
    return {pair: ms for pair, ms in arguments.nodes.delays.items() if frozenset(pair) not in named} | given


def _described(name: str) -> str | SimulatedNode:
    tier = _TIERS.get(name.partition("-")[0])
    return tier(name) if tier else name


def _nodes(text: str) -> Nodes:
    if fleet_file.is_file(text):
        fleet = fleet_of_file(text)
        pairs = itertools.combinations(fleet.nodes.nodes, 2)
        return Nodes(fleet.text, list(fleet.nodes), {pair: fleet.nodes.rtt_ms(*pair) / 2 for pair in pairs})
    names = _names(text)
    return Nodes(",".join(names), [_described(name) for name in names])


def fleet_of_file(text: str) -> Fleet:
    """The nodes of a fleet file."""
    path = Path(text).absolute()
    try:
        return Fleet(str(path), fleet_file.read(path))
    except TestbedError as error:
        raise argparse.ArgumentTypeError(str(error)) from error


def _names(text: str) -> list[str]:
    names = [f"node-{number}" for number in range(1, int(text) + 1)] if text.isdecimal() else text.split(",")
    wrong = [name for name in names if not cluster.NAME.fullmatch(name)]
    if wrong or not names:
        raise argparse.ArgumentTypeError(f"{text!r} is neither a number nor node names with commas between")
    return names


def _delay(text: str) -> tuple[tuple[str, str], float]:
    pair, _, value = text.partition("=")
    one, _, other = pair.partition(",")
    try:
        delay_ms = float(value)
    except ValueError:
        delay_ms = -1.0
    if not one or not other or problem_of("delay_ms", delay_ms):
        raise argparse.ArgumentTypeError(f"{text!r} is not A,B=MS such as robot-1,edge-1=15")
    return (one, other), delay_ms
