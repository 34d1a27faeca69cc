"""The MAVLink services above the commander: streams, commands, setpoints, parameters. Pure: bytes in, bytes out."""
