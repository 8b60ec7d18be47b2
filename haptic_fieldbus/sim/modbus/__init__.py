"""Simulated drives on Modbus: a `unit` is a drive behind its `registers`.

From the outside in: a master talks through a `line` in virtual time, or `hosting` puts drives behind a real server.
Both bring octets to a `RequestServer` (`station`), which gives the requests to the units in `drives`.
"""
