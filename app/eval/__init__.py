"""`livedrive eval`: what was trained, judged on what it never saw."""
