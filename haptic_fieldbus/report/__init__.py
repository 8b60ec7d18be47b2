"""Words and pictures of plans, runs, stability and responses."""
