"""The physics: airframes, rotors, rigid body, battery, wind, sensors. Knows neither the autopilot nor the world."""
