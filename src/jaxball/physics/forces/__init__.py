"""What acts on a body from outside, besides its weight and its ground: forces, wrenches, and resistance to its motion."""
