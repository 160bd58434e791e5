"""The render side: expression codes to a head of mesh and splats, and those to pictures."""
