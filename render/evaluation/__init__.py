"""The prior judged against the reference renderer."""
