"""Where driven frames go: video, pictures, motion, ARKit tables. One file a sink."""
