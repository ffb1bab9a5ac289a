"""The thesis' scenarios on a live control plane: random clusters, our scheduler and kube-scheduler side by side."""
