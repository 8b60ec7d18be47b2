"""Elements that act on the handle, one a file, and ready scenes in `library/`."""
