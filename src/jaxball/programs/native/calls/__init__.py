"""How a program is called: by XLA, and for many rows, by threads of a CPU or of a GPU."""
