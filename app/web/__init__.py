"""The headset page and its server: one process beside the loop, one page without a build step."""
