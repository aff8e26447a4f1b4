"""What is known: the rig that the simulator believes in, and recordings that are checked and put side by side."""
