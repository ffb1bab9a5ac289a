"""Programs that run alone in namespaces: each is started as a file, without the rest of the testbed."""
