"""Round trips to other nodes: datagrams, keys, which peers, what a round measured. Pure; sockets are in `shell`."""
