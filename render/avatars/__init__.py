"""Making, showing and exporting avatars."""
