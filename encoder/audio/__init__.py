"""Raw sound to audio features, causal to the bit (paper section 4.3)."""
