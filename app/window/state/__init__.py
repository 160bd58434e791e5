"""What the window knows: the memory shared with the loop, its own state, keys and places."""
