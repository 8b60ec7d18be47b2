"""A real SocketCAN bus for one command, of the host or of a guest kernel.

Many machines on which tests run have no CAN in their kernel. User-Mode Linux is a Linux kernel that runs as an ordinary
process without rights, and brings the module `vcan`; the folders of the host are its root, read-only, so programs need
no installation.
"""
