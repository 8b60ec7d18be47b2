"""A real SocketCAN bus for one command: of the host, else of a guest kernel that needs no rights.

Many machines on which tests run have no CAN in their kernel. User-Mode Linux is a Linux kernel that runs as an ordinary
process and brings the module `vcan`; the folders of the host are its root, read-only, so programs need no installation.
"""
