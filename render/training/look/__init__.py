"""What people look like: maps of skin and eyes, strands of brows, lashes and hair."""
