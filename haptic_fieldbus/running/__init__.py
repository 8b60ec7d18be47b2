"""A run: the loop, the session around it, changes while it goes."""
