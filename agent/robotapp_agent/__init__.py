"""The node agent: measures latency to other nodes, finds devices, reports load, all into its own node's NodeTelemetry."""
