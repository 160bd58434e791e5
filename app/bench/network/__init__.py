"""What leaving the machine costs: protocols, the page, hostile clients."""
