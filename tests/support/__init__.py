"""What the tests share: the paper's systems, random systems, and an independent version of the equations."""
