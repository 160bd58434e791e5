"""Is rule-made data like real data, and what else would have been true of it?"""
