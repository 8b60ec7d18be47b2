"""SDO, the service that reads and writes the object dictionary: the server and its kinds of transfer."""
