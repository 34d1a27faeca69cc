"""The flight controller: estimator, control cascade, modes, failsafes, MAVLink. It never gets the true state."""
