"""The simulated world in virtual time: motor and hand, CiA 402 drive, CAN wire. All is pure but `bus`, `pace`, `world`.

What happens stands here, from the outside in: a program opens a `bus`; the `world` behind it makes events happen, at
its `pace`; its `rack` holds each `drive` (`channel`, `settings`, `quirks` and `vendor` say which one), the `plant` that
it turns, the `hand` that holds on to it, and the `faults` that befall it (`injection`). What these are made of stands
in four folders, each of which imports only those below it, as an import contract says in pyproject.toml:

- `cia402`: automaton, objects, power stage and modes of operation of the drive;
- `canopen`: object dictionary and services of the node;
- `mechanics`: the motion of a shaft, followed exactly;
- `link`: frames, their bits, and arbitration.
"""
