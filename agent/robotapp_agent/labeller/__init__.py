"""The labeller: one program per cluster that writes the devices of NodeTelemetry as labels of the nodes; off by default."""
