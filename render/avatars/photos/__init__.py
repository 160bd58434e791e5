"""From photographs of a face to its geometry and skin."""
