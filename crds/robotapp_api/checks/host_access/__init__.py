"""Access to the node: the fields that Pod Security `baseline` forbids, and which right each of them takes."""
