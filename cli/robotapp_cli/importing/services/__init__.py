"""One service of a compose file to one component."""
