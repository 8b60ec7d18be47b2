"""A real SocketCAN bus for one command, on the host or in a guest kernel.

Many machines that run tests have no CAN in their kernel. User-Mode Linux is a Linux kernel that runs as an ordinary
process without rights, and brings the module `vcan`; the folders of the host are its root, read-only, so programs need
no installation.
"""
