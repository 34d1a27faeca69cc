"""The link to a PX4, real or simulated: transport, conversation, and commands for flying."""
