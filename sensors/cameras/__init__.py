"""Eye cameras of every kind."""
