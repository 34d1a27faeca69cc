"""The MAVLink services of the autopilot: streams, commands, setpoints, parameters. They work on bytes and do no I/O."""
