"""The link to any MAVLink autopilot: transport, conversation, and commands for flying."""
