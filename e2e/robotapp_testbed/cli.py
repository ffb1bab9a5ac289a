"""`python -m robotapp_testbed build | up | env | status | link | replay | down | doctor`: a cluster by hand."""

import argparse
import os
import shlex
import sys
import time
from collections.abc import Sequence
from contextlib import ExitStack
from itertools import chain
from pathlib import Path

from robotapp_testbed import cli_nodes
from robotapp_testbed.binaries import pins, programs
from robotapp_testbed.binaries.assets import Assets
from robotapp_testbed.control_plane import components_as_pods, product
from robotapp_testbed.control_plane.controlplane import ControlPlane
from robotapp_testbed.failures import TestbedError
from robotapp_testbed.machines import fleet_file, resource_slices, topology
from robotapp_testbed.machines.telemetry import SimulatedTelemetry
from robotapp_testbed.processes.detached import Cluster, State
from robotapp_testbed.processes.process import cpu_seconds, rss_bytes

_EXAMPLES = """examples:
  python -m robotapp_testbed build                       get or compile everything, once (safe to interrupt)
  python -m robotapp_testbed build --for simulated       what clusters of simulated nodes and the demo run
  python -m robotapp_testbed build etcd kubectl          these two
  python -m robotapp_testbed up --install --fleet 2,2,1  a cluster with our CRDs and five simulated nodes
  python -m robotapp_testbed up --run --fleet FILE.yaml  with operator and scheduler, and the nodes of a file
  eval "$(python -m robotapp_testbed env)"               use it from this shell
  python -m robotapp_testbed status
  python -m robotapp_testbed down

real nodes:
"""
_BUILD_EXAMPLES = """examples:
  python -m robotapp_testbed build                   everything
  python -m robotapp_testbed build --for simulated   for `up --fleet …`, the demo and most tests: no kubelet, no kube-proxy
  python -m robotapp_testbed build --for real        for `up --nodes …`
  python -m robotapp_testbed build etcd kubectl      these two
"""
_PROGRAMS = programs.FOLDERS | programs.TOOLS
_PURPOSES = {
    "simulated": tuple(name for name in pins.NAMES if name not in pins.REAL_ONLY),
    "real": (*(name for name in pins.NAMES if name not in pins.SIMULATED_ONLY), *programs.FOLDERS),
}


def main(argv: Sequence[str] | None = None) -> int:
    """Exit status: 0 done, 1 it failed with a message for a person, 3 nothing runs, 141 nobody reads what it prints."""
    arguments = _parser().parse_args(argv)
    try:
        return _run(arguments)
    except BrokenPipeError:  # `… | head`: nobody wants the rest
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 141
    except (TestbedError, OSError) as error:  # such as: no space left on device
        print(error, file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("interrupted: what is finished stays, run it again to go on", file=sys.stderr)
        return 130


def _run(arguments: argparse.Namespace) -> int:
    status = int(arguments.run(arguments))
    sys.stdout.flush()
    return status


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m robotapp_testbed",
        description="A real Kubernetes control plane on this machine, without containers and without root; or, as root, with real nodes.",
        epilog=_EXAMPLES + cli_nodes.EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    commands = parser.add_subparsers(required=True, metavar="COMMAND")

    _add_build(commands)
    up = _add_up(commands)
    env = commands.add_parser("env", help="print the shell lines that point KUBECONFIG and PATH at the cluster")
    env.add_argument(
        "--identity", default="admin", help="whose kubeconfig: admin, operator, scheduler, labeller, tenant, tenant-b"
    )
    env.set_defaults(run=_env)

    status = commands.add_parser("status", help="what runs, with CPU and memory")
    status.set_defaults(run=_status)
    down = commands.add_parser("down", help="end the cluster and remove its files")
    down.set_defaults(run=_down)
    cli_nodes.add_doctor(commands)
    link = cli_nodes.add_link(commands)
    link.set_defaults(run=_link)
    replay = cli_nodes.add_replay(commands)
    replay.set_defaults(run=_replay)
    for command in (up, env, status, down, link, replay):
        command.add_argument("--name", default="default", help="several clusters can run side by side")
    return parser


def _add_build(commands: cli_nodes.Commands) -> None:
    build = commands.add_parser(
        "build",
        help="get the binaries: cache, official releases, or compile them",
        description="Gets binaries from the cache, from official releases, or by compiling them, and prints where each is. "
        "`up` and the tests get what they need themselves: this is for doing it ahead.",
        epilog=_BUILD_EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    program_names = ", ".join((*pins.NAMES, *_PROGRAMS))
    build.add_argument(
        "names",
        nargs="*",
        type=_program,
        metavar="NAME",
        help=f"only these of {program_names}; none and no --for: all but cel-cost",
    )
    build.add_argument(
        "--for",
        dest="purposes",
        action="append",
        default=[],
        choices=_PURPOSES,
        help="only what clusters of simulated, or of real nodes run; repeatable, and adds to the names",
    )
    _add_release_option(build)
    build.set_defaults(run=_build)


def _add_up(commands: cli_nodes.Commands) -> argparse.ArgumentParser:
    up = commands.add_parser("up", help="start a cluster that stays until `down`")
    _add_release_option(up)
    up.add_argument("--install", action="store_true", help="apply our CRDs, default pool, RBAC and policies")
    up.add_argument(
        "--run",
        dest="programs",
        action="store_true",
        help="--install, and run operator and scheduler; on real nodes as pods, with agents",
    )
    up.add_argument(
        "--fleet",
        metavar="R,E,C|FILE",
        type=_fleet,
        help="simulated robots, edge servers and clouds, for example 2,2,1, or a YAML file that names them: docs/testbed.md",
    )
    up.add_argument(
        "--slices",
        action="store_true",
        help="publish the fleet's devices as ResourceSlices, as nodes with our driver do",
    )
    up.add_argument("--audit", action="store_true", help="keep an audit log")
    up.add_argument(
        "--kube-scheduler", nargs="?", const=True, default=False, metavar="FILE", help="run kube-scheduler as well"
    )
    cli_nodes.add_options(up)
    up.add_argument("--hold", action="store_true", help="stay in the foreground until interrupted")
    up.set_defaults(run=_up)
    return up


def _add_release_option(parser: argparse.ArgumentParser) -> None:
    sources = ", ".join(pins.BASE_URLS)
    text = f"base URL of the official releases of one source ({sources}); empty: never download from it. Repeatable"
    parser.add_argument(
        "--release-url", action="append", default=[], type=_release_url, metavar="SOURCE=URL", help=text
    )


def _release_url(text: str) -> tuple[str, str]:
    source, separator, url = text.partition("=")
    if source not in pins.BASE_URLS or not separator:
        raise argparse.ArgumentTypeError(f"{text!r} is not SOURCE=URL with SOURCE one of {', '.join(pins.BASE_URLS)}")
    return source, url


def _fleet(text: str) -> cli_nodes.Fleet:
    if fleet_file.is_file(text):
        return cli_nodes.fleet_of_file(text)
    parts = text.split(",")
    if len(parts) != 3 or not all(part.isdecimal() for part in parts):
        raise argparse.ArgumentTypeError(f"{text!r} is not three numbers such as 2,2,1, nor a file that ends in .yaml")
    robots, edges, clouds = map(int, parts)
    return cli_nodes.Fleet(text, topology.fleet(robots, edges, clouds))


def _program(text: str) -> str:
    if text not in (*pins.NAMES, *_PROGRAMS):
        raise argparse.ArgumentTypeError(f"there is no {text!r}, known are {', '.join((*pins.NAMES, *_PROGRAMS))}")
    return text


def _build(arguments: argparse.Namespace) -> int:
    chosen = [*arguments.names, *chain.from_iterable(_PURPOSES[purpose] for purpose in arguments.purposes)]
    names = dict.fromkeys(chosen or (*pins.NAMES, *programs.FOLDERS))
    assets = Assets(base_urls=dict(arguments.release_url))
    paths = assets.resolve([name for name in names if name in pins.NAMES])
    paths |= {name: programs.build(name) for name in names if name in _PROGRAMS}
    for name, path in paths.items():
        print(f"{name:24} {path}")
    return 0


def _up(arguments: argparse.Namespace) -> int:
    cluster = Cluster(arguments.name)
    running = None if arguments.hold else cluster.state()
    if running:
        print(
            f"the cluster {cluster.name!r} runs already and stays as it is; to start another one in its place, `down` it first",
            file=sys.stderr,
        )
        return _tell(running, arguments.name)
    cli_nodes.check(arguments)
    plane = _plane(arguments, Assets(base_urls=dict(arguments.release_url)))
    plane.get_binaries()  # here, so that the user sees the progress
    if arguments.hold:
        cluster.hold(plane, prepare=lambda cp, stack: _prepare(cp, stack, arguments))
        return 0
    if arguments.nodes:
        cli_nodes.prepare(arguments)
    began_s = time.monotonic()
    state = cluster.up(_passed_on(arguments))
    return _tell(state, arguments.name, cli_nodes.advice(arguments, began_s) if arguments.nodes else "")


def _tell(state: State, name: str, advice: str = "") -> int:
    print(f"{state.server_url} serves, logs in {state.run_dir}/logs", file=sys.stderr)
    option = _name_option(name)
    print(
        advice
        or f'next: eval "$(python -m robotapp_testbed env{option})", then kubectl and kubectl robotapp work; `down{option}` ends it. '
        "Simulated nodes run no programs: kubectl logs and exec have nothing to answer",
        file=sys.stderr,
    )
    print(f"export KUBECONFIG={shlex.quote(str(state.kubeconfig('admin')))}")
    return 0


def _plane(arguments: argparse.Namespace, assets: Assets) -> ControlPlane:
    if arguments.nodes:
        return cli_nodes.plane(arguments, assets)
    return ControlPlane(assets=assets, audit=arguments.audit, kube_scheduler=arguments.kube_scheduler)


def _passed_on(arguments: argparse.Namespace) -> list[str]:
    """The options of `up` for the holder it starts."""
    options = [f"--release-url={source}={url}" for source, url in arguments.release_url]
    flags = (
        ("--install", arguments.install),
        ("--run", arguments.programs),
        ("--audit", arguments.audit),
        ("--slices", arguments.slices),
    )
    options += [flag for flag, wanted in flags if wanted]
    options += [f"--fleet={arguments.fleet.text}"] if arguments.fleet else []
    if arguments.kube_scheduler:
        options.append(
            "--kube-scheduler" if arguments.kube_scheduler is True else f"--kube-scheduler={arguments.kube_scheduler}"
        )
    return options + cli_nodes.passed_on(arguments)


def _prepare(cp: ControlPlane, stack: ExitStack, arguments: argparse.Namespace) -> None:
    if arguments.install or arguments.programs:
        product.install(cp)
    if arguments.fleet:
        topology.apply(cp, arguments.fleet.nodes)
        if arguments.install or arguments.programs:  # without our CRDs there is nowhere to write telemetry
            stack.enter_context(SimulatedTelemetry(cp, arguments.fleet.nodes))
        if arguments.slices:
            resource_slices.publish(cp, arguments.fleet.nodes)
    if arguments.programs and arguments.nodes:
        components_as_pods.run(cp)
    elif arguments.programs:
        product.start_operator(cp)
        product.start_scheduler(cp)


def _env(arguments: argparse.Namespace) -> int:
    state = _running(arguments.name)
    if state is None:
        return 3
    kubeconfig = state.kubeconfig(arguments.identity)
    if not kubeconfig.exists():
        raise TestbedError(
            f"no identity {arguments.identity!r}, there are {', '.join(sorted(path.stem for path in kubeconfig.parent.iterdir()))}"
        )
    print(f"export KUBECONFIG={shlex.quote(str(kubeconfig))}")
    own = Path(
        sys.executable
    ).parent  # kubectl-robotapp is there; last, so that no other program of the user's is hidden
    print(f'export PATH={shlex.quote(f"{state.run_dir}/bin")}:"$PATH":{shlex.quote(str(own))}')
    if state.scheduler_url:
        print(f"export ROBOTAPP_SCHEDULER_URL={shlex.quote(state.scheduler_url)}")
    return 0


def _status(arguments: argparse.Namespace) -> int:
    state = _running(arguments.name)
    if state is None:
        return 3
    print(f"{arguments.name}: {state.server_url}, files in {state.run_dir}, held by pid {state.holder_pid}")
    print(f"{'PROGRAM':26}{'PID':>8}{'CPU S':>9}{'RSS MB':>9}")
    for name, pid in state.processes.items():
        print(f"{name:26}{pid:>8}{cpu_seconds(pid):>9.1f}{rss_bytes(pid) / 1e6:>9.0f}")
    return 0


def _down(arguments: argparse.Namespace) -> int:
    if not Cluster(arguments.name).down():
        print(f"no cluster {arguments.name!r} runs", file=sys.stderr)
    return 0


def _link(arguments: argparse.Namespace) -> int:
    state = _running(arguments.name)
    return 3 if state is None else cli_nodes.link(arguments, state)


def _replay(arguments: argparse.Namespace) -> int:
    state = _running(arguments.name)
    return 3 if state is None else cli_nodes.replay(arguments, state)


def _name_option(name: str) -> str:
    return "" if name == "default" else f" --name {name}"


def _running(name: str) -> State | None:
    state = Cluster(name).state()
    if state is None:
        print(
            f"no cluster {name!r} runs: start one with `python -m robotapp_testbed up{_name_option(name)}`",
            file=sys.stderr,
        )
    return state
