"""Of a person in photographs: the face's points, and the geometry that they tell."""
