"""Input and output: one file a bus, all with the same five verbs."""
