"""Discovery modes per middleware (rmw): what `Auto` means, and which combinations do not work."""

from typing import Final

FAST_DDS: Final = frozenset({"rmw_fastrtps_cpp", "rmw_fastrtps_dynamic_cpp"})
CYCLONE: Final = frozenset({"rmw_cyclonedds_cpp"})
ZENOH: Final = frozenset({"rmw_zenoh_cpp"})
CONNEXT: Final = frozenset({"rmw_connextdds"})
GURUM: Final = frozenset({"rmw_gurumdds_cpp"})
KNOWN: Final = FAST_DDS | CYCLONE | ZENOH | CONNEXT | GURUM
BEFORE_IRON: Final = frozenset({"foxy", "galactic", "humble", "eloquent", "dashing", "crystal", "bouncy", "ardent"})

CYCLONE_11: Final = frozenset({"lyrical", "rolling"})
"""Distributions with Cyclone DDS 11 (rolling since April 2026); the others have 0.10 or older, which refuses elements it does not know."""


def resolve_mode(mode: str, rmw: str) -> str:
    """`Auto` by middleware: Server for Fast DDS, Peers for Cyclone and Connext, Router for Zenoh, else Multicast."""
    if mode != "Auto":
        return mode
    if rmw in FAST_DDS:
        return "Server"
    if rmw in CYCLONE | CONNEXT:
        return "Peers"
    return "Router" if rmw in ZENOH else "Multicast"


def external_problem(mode: str) -> str:
    """Why nobody outside of the cluster can join with this discovery mode, and what to write instead; "" when somebody can."""
    if mode in ("Server", "Router"):
        return ""
    return (
        f"discovery {mode} has no address that could be opened to the outside; use rmw_zenoh_cpp, whose router carries all data, or "
        "rmw_fastrtps_cpp with discovery servers, or give a component that bridges to one port a service (docs/how-to/reach-a-component.md)"
    )


def mode_problem(*, mode: str, rmw: str, distro: str) -> str:
    """Why this middleware cannot use this discovery mode and what to write instead, "" when it can."""
    if mode == "Server" and rmw not in FAST_DDS:
        return f"discovery mode Server exists for Fast DDS only, not {rmw}; write mode: Auto"
    if mode == "Router" and rmw not in ZENOH:
        return f"discovery mode Router exists for rmw_zenoh_cpp only, not {rmw}; write mode: Auto"
    if rmw in ZENOH and mode not in ("Router", "Localhost"):
        return f"rmw_zenoh_cpp finds its peers through a router, not by {mode}; write mode: Auto or Router"
    if mode == "Peers" and rmw in FAST_DDS and distro in BEFORE_IRON:
        return f"Fast DDS of {distro} takes no peer list from the environment (ROS_STATIC_PEERS came with Iron); write mode: Server"
    return ""
