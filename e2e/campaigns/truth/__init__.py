"""Is what the screen shows so? Situations on a live cluster, and a judge that reads the cluster and not our status."""
