"""The estimator: an error-state Kalman filter over all sensors, and the commander's view of its estimate."""
