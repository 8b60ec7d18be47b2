"""A run: the loop, the session around it, and changes during the run."""
