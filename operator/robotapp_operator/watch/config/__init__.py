"""Contents and versions of the ConfigMaps and Secrets that apps name."""
