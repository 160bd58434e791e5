"""Of a person in photographs: the skin, the colours of hair and eyes, the light taken off."""
