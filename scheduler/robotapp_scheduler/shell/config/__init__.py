"""Where the configuration comes from while the process runs."""
