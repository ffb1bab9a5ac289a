"""What each reference application does on real nodes, and whether it keeps what its README promises through a fault."""
