"""Simulated drives on CAN: a `node` is the way to each drive, and both together are a `slave`.

What happens, from the outside in: a program opens a `bus`, or drives are put on a real one (`hosting`); the `world`
behind the former makes events happen, at its `pace`; a `rack` holds the slaves (`channel` and `model` say which) and
the faults that befall them (`injection`). Below are the `services` of a node and the `link`: frames, their bits, and
arbitration. All is pure but `bus`, `hosting`, `pace` and `world`.
"""
