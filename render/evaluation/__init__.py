"""Heads judged: the prior against the reference renderer, those made from photographs, pupils."""
