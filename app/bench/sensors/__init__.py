"""Long runs and faults of sensors, on stand-in devices."""
