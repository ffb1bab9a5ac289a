"""The cluster as the user's own kubectl reaches it. The bridge holds no credentials and speaks to no server itself."""
