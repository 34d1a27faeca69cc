"""The physics: airframes, rotors, rigid body, battery, wind, sensors. Independent of autopilot and maps."""
