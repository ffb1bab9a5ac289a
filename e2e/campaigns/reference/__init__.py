"""The ten applications of examples/reference under our scheduler and kube-scheduler: where they go, and what they do through a fault."""
