"""What a simulator says of the recorded motion: linearised about it, over windows of it, and PyBullet itself."""
