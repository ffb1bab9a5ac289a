"""Python sources by `ast`: nothing is imported or run."""
