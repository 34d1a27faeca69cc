"""The flight controller: estimator, control cascade, modes, failsafes and MAVLink services. Never sees the truth."""
