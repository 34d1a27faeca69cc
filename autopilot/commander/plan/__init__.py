"""What a ground station loads before or during a flight: mission, geofence, rally points."""
