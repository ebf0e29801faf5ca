"""What acts on a body besides its weight and its ground: forces, wrenches, and resistance to its motion."""
