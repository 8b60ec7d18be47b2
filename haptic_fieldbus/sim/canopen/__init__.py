"""Simulated drives on CAN: a `slave` is a drive together with the CANopen `node` that gives access to it.

From the outside in: a program opens a `bus`, or `hosting` puts drives on a real one. The `world` behind a simulated bus
runs the events, at its pace. `drives` holds the slaves (named by `channel`, built by `model`) and applies their
faults. Below are the `services` of a node and the `link`: frames, bit lengths and arbitration. All
modules are pure except `bus`, `hosting` and `world`.
"""
