"""How long each link of somebody's own chain takes, from the camera to the setpoint: measured, to be simulated."""
