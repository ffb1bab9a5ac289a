"""Devices of the node: what a snapshot of sysfs shows, their ids and names, the admin's rules. Pure; reading is in `shell`."""
