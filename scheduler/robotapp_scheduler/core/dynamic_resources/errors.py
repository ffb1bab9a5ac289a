"""Reasons why an allocation is given up."""


class AllocationError(ValueError):
    """A claim, class or selector is wrong, or needs what this scheduler does not serve: no node is worth trying."""


class NodeAllocationError(ValueError):
    """Devices of this node are not described well enough, or need what this scheduler does not serve; another node may do."""
