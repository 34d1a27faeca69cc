"""What an experienced pilot looks at before a vehicle flies by offboard setpoints. Nothing here arms a vehicle."""
