"""Random small clusters with a pod to place, by named feature families: for the reference and for the live oracle.

    case = seeded_case("7", number=12, families=list(FAMILIES))     # a pure function of its arguments
    @given(cases(["taints", "hard-spread"]))                        # hypothesis draws and shrinks the same cases
    case.objects            # everything to create on an API server, the pod to place last
    case.cluster, case.pod  # the same as the API server would give it back

1 to 12 nodes, up to 30 placed pods, one family at the centre and up to two more mixed in. Names and uids depend on the
position only. Objects are valid for an API server; statuses, deletion and priority classes are for the feeder to set up.
"""

from campaigns.cluster_cases.case import Case, build_case, cases, seeded_case
from campaigns.cluster_cases.catalogue import ALL_FAMILIES, DEVICE_FAMILIES, FAMILIES, Family

__all__ = ["ALL_FAMILIES", "DEVICE_FAMILIES", "FAMILIES", "Case", "Family", "build_case", "cases", "seeded_case"]
