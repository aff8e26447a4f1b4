"""A user's folder: what lies in it, and a rig for the robot file there."""
