"""Session folders: format, recording, replay, repair."""
