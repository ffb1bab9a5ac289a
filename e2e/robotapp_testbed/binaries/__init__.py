"""The programs a cluster runs: which versions, where they come from, how they are compiled and kept."""
