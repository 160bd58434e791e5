"""What is printed: tables, and measured values against their thresholds."""
