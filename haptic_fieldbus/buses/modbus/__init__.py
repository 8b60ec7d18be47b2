"""The Modbus master: RTU on serial lines and TCP, behind the same `Bus` as every other protocol."""
