"""The estimator: an error-state Kalman filter over all sensors, and the estimate that it hands on."""
