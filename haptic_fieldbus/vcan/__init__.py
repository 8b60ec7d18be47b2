"""A real SocketCAN bus for one command: the host's, else a guest kernel's.

Many machines on which tests run have no CAN in their kernel. User-Mode Linux is a Linux kernel that runs as an ordinary
process and brings the module `vcan`; the folders of the host are its root, read-only, so programs need no installation.
"""
