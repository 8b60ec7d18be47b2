"""Golden texts: what `plan` says of each library scene on each profile.

`python -m tests.golden` writes them anew; read the difference before you commit it.
"""
