"""One module a kind, named as the kind; each has a `SHEET`."""
