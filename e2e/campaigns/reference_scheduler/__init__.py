"""kube-scheduler's decisions, one pod and one node at a time: the slow, obvious reference the product must equal.

    cluster = ClusterDump.of(items)                 # objects as `kubectl get ... -o json` prints them
    decision = decide(cluster, pod)                 # the default profile of kube-scheduler 1.37
    decision = decide(cluster, pod, Config(compat_version="1.35", added_affinity=...))
    decision.feasible, .rejections, .raw, .normalized, .weighted, .totals, .best, .message, .preemption

Plain dicts and Python integers; floats only where upstream computes in float64. Nothing here imports the product,
keeps a cache between decisions or uses an array. The rooms nodes, topology and volumes have one module per plugin
family; each names the filter or score it is, and `cycle` holds them in upstream's order. Written from the behaviour of kube-scheduler 1.37.1, not from its code.

Left out on purpose: allocation of devices (a pod with unallocated resource claims is refused), sampling of nodes.
"""

from campaigns.reference_scheduler.cycle import decide
from campaigns.reference_scheduler.model import ClusterDump, Config, Json, Rejection
from campaigns.reference_scheduler.outcome import Decision, Preemption

__all__ = ["ClusterDump", "Config", "Decision", "Json", "Preemption", "Rejection", "decide"]
