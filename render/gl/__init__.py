"""OpenGL contexts and the mesh renderer that makes truth."""
