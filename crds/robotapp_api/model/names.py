"""Every name other people may match on: group, labels, annotations, conditions, reasons, field managers.

A name that appears in an object, event or metric label is written here and nowhere else, because dashboards,
policies and users' scripts depend on it. `docs/names.md` is generated from this module.
"""

from enum import StrEnum
from typing import Final

GROUP: Final = "robotics.io"
VERSION: Final = "v1alpha1"
API_VERSION: Final = "robotics.io/v1alpha1"

SCHEDULER_NAME: Final = "ros-aware-scheduler"
THESIS_SCHEDULER_NAME: Final = "kubernetes-scheduler"
"""Second profile name: the Rigelfiles of the thesis ask for it."""
OUR_SCHEDULERS: Final = (SCHEDULER_NAME, THESIS_SCHEDULER_NAME)

OPERATOR_MANAGER: Final = "robotapp-operator"
SCHEDULER_MANAGER: Final = "robotapp-scheduler"
BRIDGE_MANAGER: Final = "rigel-bridge"
SYSTEM_NAMESPACE: Final = "robotapp-system"
"""Where the chart is installed unless told otherwise."""
FLEET_CONFIG_MAP: Final = "robot-fleet-assignments"
PARAMETERS_VOLUME: Final = "robotapp-parameters"
"""Volume of a component's ROS parameter files."""
PARAMETERS_PATH: Final = "/etc/robotapp/parameters"
"""Where that volume is mounted."""
WAITING_STEP: Final = "wait-for-names"
"""Init container that waits for the names discovery needs."""
SAFE_IDS: Final = "1-101,215-232"
"""Domain ids anybody may ask for: 0 is everybody's default, and the ports of 102-214 meet Linux ephemeral ports."""
ROBOT_END: Final = "@robot"
"""End of an edge that is the robot's node itself rather than a component."""
GPU: Final = "gpu"
"""A device type our scheduler never claims: its device plugin hands it out as an extended resource, the node only has to have one."""


class Label(StrEnum):
    """Labels on children, claims and nodes."""

    APP = "robotics.io/app"
    APP_UID = "robotics.io/app-uid"
    COMPONENT = "robotics.io/component"
    INSTANCE = "robotics.io/instance"
    ROLE = "robotics.io/role"
    """Instead of a component, on infrastructure of an instance: discovery, router or master."""
    PART = "robotics.io/part"
    """Number of one of several equal infrastructure pods."""
    NAME = "app.kubernetes.io/name"
    PART_OF = "app.kubernetes.io/part-of"
    MANAGED_BY = "app.kubernetes.io/managed-by"
    TIER = "robotics.io/tier"
    ROBOT = "robotics.io/robot"
    ROBOT_PRIMARY = "robotics.io/robot-primary"
    """On one node of a robot with several computers, with the value "true": this node is `@robot`."""
    ZONE = "topology.kubernetes.io/zone"
    HOSTNAME = "kubernetes.io/hostname"
    CLAIM = "robotics.io/claim"
    POOL = "robotics.io/pool"
    HOLDER_UID = "robotics.io/holder-uid"
    SIMULATED = "robotics.io/simulated"
    """On Node and NodeTelemetry objects that no machine stands behind (tests and the demo)."""


HARDWARE_PREFIX: Final = "hardware.robotics.io/"
HARDWARE_SOURCE: Final = "hardware.robotics.io/source"
"""On nodes whose hardware labels were made from their NodeTelemetry: they are capabilities, and the devices are only there."""
FROM_TELEMETRY: Final = "telemetry"


class Annotation(StrEnum):
    """Annotations read or written by our components."""

    POLICIES = "scheduler.robotics.io/policies"
    TOPOLOGY = "scheduler.robotics.io/topology"
    AFFINITY = "scheduler.robotics.io/affinity"
    SHARED_DATA = "scheduler.robotics.io/shared-data"
    DDS_DOMAIN = "scheduler.robotics.io/dds-domain"
    GRACEFUL_SHUTDOWN = "scheduler.robotics.io/graceful-shutdown"
    GRANTED_DOMAIN = "granted.robotics.io/dds-domain"
    GRANTED_DEVICES = "granted.robotics.io/devices"
    GRANTED_SHARED = "granted.robotics.io/shared-devices"
    """Devices the pod uses together with others (sharing Namespace or Cluster): nobody gets them alone meanwhile."""
    ALLOWED_NAMESPACES = "robotics.io/allowed-namespaces"
    ADMITTED_NODES = "robotics.io/admitted-nodes"
    """On pods of other schedulers: which terms of its node affinity the operator ended with the names of the nodes that admit it."""
    PODS_GONE = "robotics.io/pods-gone"
    """On a Parked RobotClaim: its status.attempt, written by an admin who knows that none of its pods runs any more."""
    APPROVE_UPDATE = "robotics.io/approve-update"
    RENDERED_BY = "robotics.io/rendered-by"
    """Operator version that wrote a template: a lower version never overwrites it (claims.md rule 5)."""
    APP_GENERATION = "robotics.io/app-generation"
    SPEC_HASH = "robotics.io/spec-hash"
    """On children: hash of what the user wrote for them, so that another operator version can tell an edit from its own news."""
    CONTENT_HASH = "robotics.io/content-hash"
    """On children: hash of the labels and spec they were written with."""
    PARAMETERS_HASH = "robotics.io/parameters-hash"
    """On pods: hash of the ConfigMap keys that are their parameter files."""
    FIRST_NODE = "robotics.io/first-node"
    """On a RobotClaim: the node of the pod it was made for, which counts as one of status.nodes."""
    MOMENTARY = "robotics.io/momentary"
    """On a RobotClaim of a device: its holder is just being bound to share that device, and gives the claim up then."""
    THING = "robotics.io/thing"
    HOLDER = "robotics.io/holder"
    DOMAIN_CLAIM = "robotics.io/domain-claim"
    """On templates of RobotApp children: name of the RobotClaim whose id ROS_DOMAIN_ID carries."""
    BETTER_NODE = "robotics.io/better-node"
    """On pods, written by the scheduler: where the pod would be placed now that an edge of it is over its budget."""
    FALLBACK = "robotics.io/fallback"
    """On pods, written by the scheduler when it binds them: Preferred budgets and tiers of runsOn that were given up for the node."""
    MOVES = "robotics.io/moves"
    """On a component's Deployment: when its pods were evicted to start elsewhere, written before each eviction."""
    LINK_BANDWIDTH = "robotics.io/link-bandwidth"
    """On nodes, written by an admin: bit/s that the node's access link carries, such as 40M."""
    OVERRIDES = "robotics.io/overrides"
    """On a component's Deployment: names of the overrides it was rendered with, which count while the robot's node is out of sight."""
    CONFIG = "robotics.io/config"
    """On a component's Deployment: which contents of ConfigMaps and Secrets its pods were started with, and when the last change was rolled out."""
    CONFIG_HASH = "robotics.io/config-hash"
    """On pods: hash of the ConfigMaps and Secrets that they mount or read as environment, once it is another than at first."""
    LOST_DEVICES = "robotics.io/lost-devices"
    """On a component's Deployment: claims of devices that vanished, each with the uid of the pod that had it."""


PARAMETERS_PREFIX: Final = "robotics.io/parameters-"
"""On pods, followed by the position of an inline parameter file: its text."""
GRANTED_PREFIX: Final = "granted.robotics.io/"
SCHEDULING_GATE: Final = "robotics.io/domain"
"""Set by the operator on pods of schedulers that cannot do the bind check (claims.md rule 6)."""


class Condition(StrEnum):
    """Condition types of a RobotApp; all exist from creation by schema default."""

    READY = "Ready"
    ACCEPTED = "Accepted"
    ALLOCATED = "Allocated"
    PLACED = "Placed"
    BUDGET_MET = "BudgetMet"
    PROGRESSING = "Progressing"
    STALLED = "Stalled"


class Reason(StrEnum):
    """Reasons of RobotApp conditions."""

    PENDING = "Pending"
    # Accepted
    ACCEPTED = "Accepted"
    INVALID_SPEC = "InvalidSpec"
    UNKNOWN_DISTRO = "UnknownDistro"
    TOO_LARGE = "TooLarge"
    """The spec counts more than an app may take of the operator's memory."""
    ROBOT_NODE_UNCLEAR = "RobotNodeUnclear"
    """A robot has several nodes, and none or more than one of them is labelled as its primary one."""
    NO_MATCHING_ROBOT = "NoMatchingRobot"
    # Allocated
    ALLOCATED = "Allocated"
    DOMAIN_EXHAUSTED = "DomainExhausted"
    DOMAIN_TAKEN = "DomainTaken"
    QUOTA_EXCEEDED = "QuotaExceeded"
    POOL_NOT_FOUND = "PoolNotFound"
    POOL_OVERLAPS = "PoolOverlaps"
    """An older pool of the same network lists ids of this one, so this one gives none."""
    CLAIM_CONFLICT = "ClaimConflict"
    DEVICE_BUSY = "DeviceBusy"
    DEVICE_LOST = "DeviceLost"
    """A running pod holds a device that its node no longer has."""
    WAITING_FOR_DEVICES = "WaitingForDevices"
    NOT_OUR_SCHEDULER = "NotOurScheduler"
    NOTHING_TO_ALLOCATE = "NothingToAllocate"
    # Placed
    PLACED = "Placed"
    FALLBACK_USED = "FallbackUsed"
    """All pods are on nodes, and placement.fallback or the order of runsOn gave something up for that."""
    UNSCHEDULABLE = "Unschedulable"
    WAITING_FOR_PODS = "WaitingForPods"
    # BudgetMet
    WITHIN_BUDGET = "WithinBudget"
    BUDGET_EXCEEDED = "BudgetExceeded"
    NO_BUDGET = "NoBudget"
    NOT_MEASURED = "NotMeasured"
    # Ready, Progressing, Stalled
    ALL_READY = "AllComponentsReady"
    COMPONENTS_NOT_READY = "ComponentsNotReady"
    ROBOT_NOT_READY = "RobotNotReady"
    """Of its node; not yet for connectivity.grace."""
    ROBOT_OFFLINE = "RobotOffline"
    FAILED_CREATE = "FailedCreate"
    QUOTA_REFUSED = "QuotaRefused"
    IMAGE_PULL = "ImagePullFailed"
    CRASH_LOOP = "CrashLoop"
    SUSPENDED = "Suspended"
    ROLLING_OUT = "RollingOut"
    UP_TO_DATE = "UpToDate"
    UPDATE_HELD = "UpdateHeld"
    CONFIG_HELD = "ConfigHeld"
    """ConfigMaps keep changing, so the next restart for them waits."""
    NEWER_VERSION = "NewerVersion"
    NOT_STALLED = "NotStalled"
    RECONCILE_ERROR = "ReconcileError"
    RESTART_NEEDED = "RestartNeeded"


class PoolCondition(StrEnum):
    """Condition types of a DomainPool."""

    USABLE = "Usable"
    """Some namespace may get an id of the pool."""
    NEARLY_FULL = "NearlyFull"
    """At least four fifths of the ids are claimed."""
    FULL = "Full"
    """Every id is claimed."""
    OVERLAPPING = "Overlapping"
    """Another pool of the same network lists ids of this one."""


class PoolReason(StrEnum):
    """Reasons of DomainPool conditions."""

    USABLE = "Usable"
    QUOTA_IS_ZERO = "QuotaIsZero"
    IDS_LEFT = "IdsLeft"
    FEW_IDS_LEFT = "FewIdsLeft"
    NO_IDS_LEFT = "NoIdsLeft"
    OWN_IDS = "OwnIds"
    SHARED_IDS = "SharedIds"


class Phase(StrEnum):
    """Values our operator writes to RobotApp status.phase (a plain string in the schema, so it may grow)."""

    PENDING = "Pending"
    PLACING = "Placing"
    RUNNING = "Running"
    DEGRADED = "Degraded"
    OFFLINE = "Offline"
    SUSPENDED = "Suspended"
    STOPPING = "Stopping"
    FAILED = "Failed"


class ClaimPhase(StrEnum):
    """RobotClaim status.phase."""

    RESERVED = "Reserved"
    DRAINING = "Draining"
    PARKED = "Parked"


class EventReason(StrEnum):
    """Reasons of Events our components write (upstream's Scheduled and FailedScheduling included)."""

    DOMAIN_ALLOCATED = "DomainAllocated"
    DOMAIN_EXHAUSTED = "DomainExhausted"
    DOMAIN_TAKEN = "DomainTaken"
    QUOTA_EXCEEDED = "QuotaExceeded"
    POOL_NOT_FOUND = "PoolNotFound"
    POOL_OVERLAPS = "PoolOverlaps"
    DEVICE_CLAIMED = "DeviceClaimed"
    DEVICE_BUSY = "DeviceBusy"
    DEVICE_LOST = "DeviceLost"
    DEVICE_RETURNED = "DeviceReturned"
    NODE_REJECTED = "NodeRejected"
    PLACED = "Placed"
    FALLBACK_USED = "FallbackUsed"
    BUDGET_EXCEEDED = "BudgetExceeded"
    RESCHEDULED = "Rescheduled"
    CLAIM_CONFLICT = "ClaimConflict"
    EOL_DISTRO = "EolDistro"
    INVALID_SPEC = "InvalidSpec"
    UNKNOWN_DISTRO = "UnknownDistro"
    TOO_LARGE = "TooLarge"
    NO_MATCHING_ROBOT = "NoMatchingRobot"
    ROBOT_NOT_READY = "RobotNotReady"
    ROBOT_OFFLINE = "RobotOffline"
    CHILD_FAILED = "ChildFailed"
    CONFIG_CHANGED = "ConfigChanged"
    NEWER_VERSION = "NewerVersion"
    SCHEDULED = "Scheduled"
    FAILED_SCHEDULING = "FailedScheduling"
    CONFIG_RELOADED = "ConfigReloaded"
    CONFIG_INVALID = "ConfigInvalid"
    CONFIG_RESTART_NEEDED = "ConfigRestartNeeded"
    PLUGIN_NOT_ASKED = "PluginNotAsked"
    PREEMPTED = "Preempted"
    KUBELET_REJECTED = "KubeletRejected"
    LABEL_TAKEN = "LabelTaken"


class PodReason(StrEnum):
    """Reasons of a pod's PodScheduled=False condition."""

    UNSCHEDULABLE = "Unschedulable"
    SCHEDULER_ERROR = "SchedulerError"
    INVALID_ANNOTATION = "InvalidAnnotation"
    WAITING_FOR_GROUP = "WaitingForGroup"
    WAITING_FOR_PREDECESSOR = "WaitingForPredecessor"
    WAITING_FOR_DOMAIN = "WaitingForDomain"
    WAITING_FOR_KINDS = "WaitingForKinds"
